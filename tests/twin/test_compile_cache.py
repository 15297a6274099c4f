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


def run(project: Path, home: Path | None, cache: Path | None, code: str = CALLS) -> Run:
    """Call both kernels in a process that obeys permissions; its ``HOME`` and named cache may be missing."""
    environment = {
        "PATH": os.environ["PATH"],
        "PYTHONPATH": str(project),
        "PYTHONDONTWRITEBYTECODE": "1",
        **({} if home is None else {"HOME": str(home)}),
        **({} if cache is None else {"CASEDRAIN_COMPILE_CACHE": str(cache)}),
    }
    command = [*(WITHOUT_RIGHTS if os.geteuid() == 0 else ()), sys.executable, "-c", code]
    done = subprocess.run(command, cwd=project, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    return Run(*json.loads(done.stdout), done.stderr)


def files(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def locked(folder: Path) -> Path:
    """A folder that nobody can write, with all below it."""
    for place in (folder, *folder.rglob("*")):
        place.chmod(0o555 if place.is_dir() else 0o444)
    return folder


@pytest.fixture(autouse=True, scope="module")
def _permissions_are_obeyed() -> None:
    if os.geteuid() == 0 and shutil.which("setpriv") is None:
        pytest.skip("root obeys no permissions, and setpriv is not here to give its rights up")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A package, and the cache that its first run filled."""
    project = package(tmp_path_factory.mktemp("project"))
    cache = tmp_path_factory.mktemp("cache")
    first = run(project, tmp_path_factory.mktemp("home"), cache)
    assert (first.values, first.hits, first.misses, first.complaints) == ([7.0, 6.0], 0, 2, "")
    return project, cache


@pytest.fixture
def filled(made: tuple[Path, Path], tmp_path: Path) -> Iterator[Path]:
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


def test_a_filled_cache_that_cannot_be_written_is_used(made: tuple[Path, Path], filled: Path, home: Path) -> None:
    before = files(locked(filled))
    found = run(made[0], home, filled)
    assert found == ([7.0, 6.0], 2, 0, "")
    assert files(filled) == before
    assert list(home.rglob("*")) == []


def test_a_cache_that_cannot_be_filled_is_said_once(made: tuple[Path, Path], tmp_path: Path, home: Path) -> None:
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
    unknown: bool, made: tuple[Path, Path], filled: Path, home: Path
) -> None:
    place, code = (None, NOBODY + CALLS) if unknown else (locked(home), CALLS)
    lost = run(made[0], place, None, code)
    assert (lost.values, lost.hits, lost.misses) == ([7.0, 6.0], 0, 2)
    assert lost.complaints.count(SENTENCE) == len(lost.complaints.splitlines()) == 1
    assert ("there is no home folder" if unknown else str(home)) in lost.complaints
    assert sorted(p.name for p in made[0].iterdir()) == ["twin"]
    assert run(made[0], place, locked(filled), code) == ([7.0, 6.0], 2, 0, "")


def test_a_caller_notices_an_edit_of_what_it_calls(filled: Path, tmp_path: Path, home: Path) -> None:
    project = package(tmp_path / "project")
    lower = project / "twin" / "lower.py"
    lower.write_text(LOWER.replace("FACTOR = 2.0", "FACTOR = 2.5"))
    assert run(project, home, filled)[:3] == ([8.5, 7.5], 0, 2)


def test_words_and_another_folder_cost_nothing(filled: Path, tmp_path: Path, home: Path) -> None:
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
    kind: str, spoilt: Callable[[bytes], bytes], made: tuple[Path, Path], filled: Path, home: Path
) -> None:
    touched = sorted(filled.rglob(f"*.{kind}"))
    assert len(touched) == 2
    for file in touched:
        file.write_bytes(spoilt(file.read_bytes()))
    assert run(made[0], home, filled) == ([7.0, 6.0], 0, 2, "")
    assert run(made[0], home, filled) == ([7.0, 6.0], 2, 0, "")


def test_a_spoilt_cache_that_cannot_be_mended_is_said_once(made: tuple[Path, Path], filled: Path, home: Path) -> None:
    for file in filled.rglob("*.nbi"):
        file.write_bytes(b"garbage")
    found = run(made[0], home, locked(filled))
    assert found[:3] == ([7.0, 6.0], 0, 2)
    assert found.complaints.count(SENTENCE) == len(found.complaints.splitlines()) == 1
