"""The cache of compiled kernels: used where it can be read, silent but for one sentence, never stale, never in the way.

A package of two tiny kernels stands in for the twin, so that each compilation takes a second; the one that is looked at
is `twin/compiled.py` itself.
"""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import pytest

from twin import compiled, sources

LOWER = '''"""Lower."""
from twin.compiled import compiled

FACTOR = 2.0


@compiled
def scaled(x: float) -> float:
    """Say it."""
    return FACTOR * x
'''
UPPER = '''"""Upper."""
from twin.compiled import compiled
from twin.lower import scaled


@compiled
def shifted(x: float) -> float:
    return scaled(x) + 1.0
'''
CALLS = """
import json
from twin.lower import scaled
from twin.upper import shifted

values = [shifted(3.0), scaled(3.0)]
stats = [kernel.stats for kernel in (shifted, scaled)]
counts = [sum(sum(getattr(s, name).values()) for s in stats) for name in ("cache_hits", "cache_misses")]
print(json.dumps([values, *counts]))
"""
SERVER = """
import json, os, sys, traceback
import numba, platformdirs

numba.njit(lambda x: x + 1.0)(1.0)
for line in sys.stdin:
    asked = json.loads(line)
    child = os.fork()
    if child == 0:
        os.environ.clear()
        os.environ.update(asked["environment"])
        os.chdir(asked["folder"])
        sys.path.insert(0, asked["folder"])
        for stream, file in ((1, asked["output"]), (2, asked["complaints"])):
            os.dup2(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), stream)
        status = 0
        try:
            exec(asked["code"], {})
        except BaseException:
            traceback.print_exc()
            status = 1
        sys.stdout.flush()
        os._exit(status)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""
"""Has loaded numba, and forks a process for each run: what is looked at is the cache, not the import."""
NOBODY = """
import pwd
def getpwuid(uid):
    raise KeyError(uid)
pwd.getpwuid = getpwuid
"""
"""What a user sees whom the machine does not know: a container's numbered user without a home."""
SENTENCE = "compiled kernels are not kept"
WITHOUT_RIGHTS = ("setpriv", "--bounding-set=-all", "--inh-caps=-all")
"""Root that obeys the permissions of files."""


class Run(NamedTuple):
    """What one process found: values of both kernels, kernels loaded and compiled, and what it complained about."""

    values: list[float]
    hits: int
    misses: int
    complaints: str


def package(folder: Path) -> Path:
    """A folder with a package ``twin`` of two kernels, the upper one calling the lower one in another file."""
    twin = folder / "twin"
    twin.mkdir(parents=True)
    for module in (compiled, sources):
        shutil.copy(str(module.__file__), twin)
    (twin / "__init__.py").write_text("")
    (twin / "lower.py").write_text(LOWER)
    (twin / "upper.py").write_text(UPPER)
    return folder


@dataclass(frozen=True)
class Runs:
    """Runs code in processes of their own that obey permissions."""

    server: subprocess.Popen[str]
    folder: Path

    def __call__(self, project: Path, home: Path | None, cache: Path | None, code: str = CALLS) -> Run:
        """Call both kernels; ``HOME`` and the named cache may be missing."""
        asked = {
            "environment": {
                "PATH": os.environ["PATH"],
                **({} if home is None else {"HOME": str(home)}),
                **({} if cache is None else {"CASEDRAIN_COMPILE_CACHE": str(cache)}),
            },
            "folder": str(project),
            "code": code,
            "output": str(self.folder / "output"),
            "complaints": str(self.folder / "complaints"),
        }
        assert self.server.stdin is not None
        assert self.server.stdout is not None
        self.server.stdin.write(json.dumps(asked) + "\n")
        self.server.stdin.flush()
        status = self.server.stdout.readline().strip()
        complaints = (self.folder / "complaints").read_text()
        assert status == "0", complaints
        assert "Traceback" not in complaints
        return Run(*json.loads((self.folder / "output").read_text()), complaints)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Runs]:
    if os.geteuid() == 0 and shutil.which("setpriv") is None:
        pytest.skip("root obeys no permissions, and setpriv is not here to give its rights up")
    command = [*(WITHOUT_RIGHTS if os.geteuid() == 0 else ()), sys.executable, "-B", "-c", SERVER]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as server:
        yield Runs(server, tmp_path_factory.mktemp("runs"))


def files(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def locked(folder: Path) -> Path:
    """A folder that nobody can write, with all below it."""
    for place in (folder, *folder.rglob("*")):
        place.chmod(0o555 if place.is_dir() else 0o444)
    return folder


@pytest.fixture(scope="module")
def made(run: Runs, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A package, and the cache that its first run filled."""
    project = package(tmp_path_factory.mktemp("project"))
    cache = tmp_path_factory.mktemp("cache")
    first = run(project, tmp_path_factory.mktemp("home"), cache)
    assert (first.values, first.hits, first.misses, first.complaints) == ([7.0, 6.0], 0, 2, "")
    return project, cache


@pytest.fixture
def filled(run: Runs, made: tuple[Path, Path], tmp_path: Path) -> Iterator[Path]:
    """A copy of the filled cache, for a test to spoil."""
    folder = tmp_path / "filled"
    shutil.copytree(made[1], folder)
    yield folder
    for place in (folder, *folder.rglob("*")):
        place.chmod(0o755)  # or it could not be removed


@pytest.fixture
def home(tmp_path: Path) -> Path:
    folder = tmp_path / "home"
    folder.mkdir()
    return folder


def test_a_filled_cache_that_cannot_be_written_is_used(
    run: Runs, made: tuple[Path, Path], filled: Path, home: Path
) -> None:
    before = files(locked(filled))
    found = run(made[0], home, filled)
    assert found == ([7.0, 6.0], 2, 0, "")
    assert files(filled) == before
    assert list(home.rglob("*")) == []


def test_a_cache_that_cannot_be_filled_is_said_once(
    run: Runs, made: tuple[Path, Path], tmp_path: Path, home: Path
) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    found = run(made[0], home, locked(empty))
    assert (found.values, found.hits, found.misses) == ([7.0, 6.0], 0, 2)
    assert found.complaints.count(SENTENCE) == 1
    assert f"{empty}/compiled cannot be written (Permission denied)" in found.complaints
    assert len(found.complaints.splitlines()) == 1
    assert list(home.rglob("*")) == list(empty.rglob("*")) == []


@pytest.mark.parametrize("unknown", [True, False], ids=["no home", "a home that cannot be written"])
def test_without_a_home_it_works_and_says_so_once(
    run: Runs, unknown: bool, made: tuple[Path, Path], filled: Path, home: Path
) -> None:
    place, code = (None, NOBODY + CALLS) if unknown else (locked(home), CALLS)
    lost = run(made[0], place, None, code)
    assert (lost.values, lost.hits, lost.misses) == ([7.0, 6.0], 0, 2)
    assert lost.complaints.count(SENTENCE) == len(lost.complaints.splitlines()) == 1
    assert ("there is no home folder" if unknown else str(home)) in lost.complaints
    assert sorted(p.name for p in made[0].iterdir()) == ["twin"]
    assert run(made[0], place, locked(filled), code) == ([7.0, 6.0], 2, 0, "")


def test_a_caller_notices_an_edit_of_what_it_calls(run: Runs, filled: Path, tmp_path: Path, home: Path) -> None:
    project = package(tmp_path / "project")
    lower = project / "twin" / "lower.py"
    lower.write_text(LOWER.replace("FACTOR = 2.0", "FACTOR = 2.5"))
    assert run(project, home, filled)[:3] == ([8.5, 7.5], 0, 2)


def test_words_and_another_folder_cost_nothing(run: Runs, filled: Path, tmp_path: Path, home: Path) -> None:
    project = package(tmp_path / "elsewhere")
    lower = project / "twin" / "lower.py"
    lower.write_text(LOWER.replace("Say it.", "Say it\n    at length.").replace("2.0", "2.0  # doubled\n\n"))
    before = files(filled)
    assert run(project, home, filled) == ([7.0, 6.0], 2, 0, "")
    assert files(filled) == before


@pytest.mark.parametrize(
    ("kind", "spoilt"),
    [
        ("nbi", lambda b: b[: len(b) // 2]),
        ("nbi", lambda b: b""),
        ("nbi", lambda b: b"\x93garbage"),
        ("nbc", lambda b: b[:90]),
    ],
    ids=["a truncated index", "an empty index", "garbage", "truncated code"],
)
def test_a_spoilt_cache_is_as_good_as_none_and_is_mended(
    kind: str, spoilt: Callable[[bytes], bytes], run: Runs, made: tuple[Path, Path], filled: Path, home: Path
) -> None:
    touched = sorted(filled.rglob(f"*.{kind}"))
    assert len(touched) == 2
    for file in touched:
        file.write_bytes(spoilt(file.read_bytes()))
    assert run(made[0], home, filled) == ([7.0, 6.0], 0, 2, "")
    assert run(made[0], home, filled) == ([7.0, 6.0], 2, 0, "")


def test_a_spoilt_cache_that_cannot_be_mended_is_said_once(
    run: Runs, made: tuple[Path, Path], filled: Path, home: Path
) -> None:
    for file in filled.rglob("*.nbi"):
        file.write_bytes(b"garbage")
    found = run(made[0], home, locked(filled))
    assert found[:3] == ([7.0, 6.0], 0, 2)
    assert found.complaints.count(SENTENCE) == len(found.complaints.splitlines()) == 1
