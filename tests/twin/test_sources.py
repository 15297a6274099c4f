"""Hashes of sources: what cannot change a number changes no hash, what can does, wherever it stands."""

import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from twin import sources

ROOT = Path(sources.__file__).resolve().parent.parent
UPPER = '''"""Upper."""
from twin import lower as below


def answer(x: float) -> float:
    """Say it."""
    return below.FACTOR * x
'''
LOWER = '"""Lower."""\n\nFACTOR = 2.0\n'

Edit = Callable[[str, str, str], str]


def forget() -> None:
    for cached in (sources.sources_hash, sources.package_hash, sources.imported_modules, sources._read):
        cached.cache_clear()


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A project of two modules, the upper importing the lower one, and one that nobody imports."""
    folder = tmp_path / "twin"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (folder / "upper.py").write_text(UPPER)
    (folder / "lower.py").write_text(LOWER)
    (folder / "apart.py").write_text("N = 1\n")
    monkeypatch.setattr(sources, "_ROOT", tmp_path)
    forget()
    yield folder
    monkeypatch.undo()
    forget()


def edited(folder: Path, module: str, old: str, new: str) -> str:
    """Hash of the upper module after an edit."""
    file = folder / f"{module}.py"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    forget()
    return sources.sources_hash("twin.upper")


@pytest.mark.parametrize(
    ("module", "old", "new"),
    [
        ("lower", "FACTOR = 2.0", "# why\n\n\nFACTOR = 2.0  # doubled"),
        ("lower", "FACTOR = 2.0", "FACTOR = 2.0\n'''Documents the factor.'''"),
        ("lower", "Lower", "Below"),
        ("upper", "Say it.", "Say it\n    at length."),
        ("upper", "    return below.FACTOR * x", "\n    return (\n        below.FACTOR * x\n    )"),
        ("apart", "N = 1", "N = 2"),
    ],
)
def test_what_changes_no_number_changes_no_hash(project: Path, module: str, old: str, new: str) -> None:
    before = sources.sources_hash("twin.upper")
    assert edited(project, module, old, new) == before


@pytest.mark.parametrize(
    ("module", "old", "new"),
    [
        ("lower", "2.0", "2.5"),
        ("lower", "2.0", "2"),
        ("lower", "FACTOR = 2.0", "FACTOR = 2.0\nOTHER = 'text'"),
        ("upper", "* x", "/ x"),
        ("upper", "x: float", "x: int"),
    ],
)
def test_an_edit_changes_it_wherever_it_stands(project: Path, module: str, old: str, new: str) -> None:
    before = sources.sources_hash("twin.upper")
    after = edited(project, module, old, new)
    assert after != before
    assert edited(project, module, new, old) == before  # and undone, it is as it was


def test_a_package_counts_whole_and_so_do_its_data(project: Path) -> None:
    before = sources.package_hash("twin"), sources.sources_hash("twin.upper")
    edited(project, "apart", "N = 1", "N = 2")
    assert sources.package_hash("twin") != before[0]
    assert sources.sources_hash("twin.upper") == before[1]
    (project / "fitted.json").write_text("[1.0]")
    forget()
    assert sources.sources_hash("twin.upper") != before[1]


def test_what_is_no_module_is_an_error_and_not_left_out(project: Path) -> None:
    for name in ("twin.moved_away", "numpy", "twin/upper.py"):
        with pytest.raises(ModuleNotFoundError, match=name):
            sources.sources_hash("twin.upper", name)
    with pytest.raises(ModuleNotFoundError, match="nothing"):
        sources.package_hash("nothing")


def test_another_folder_and_process_give_the_same(tmp_path: Path) -> None:
    for package in ("twin", "detectors"):
        shutil.copytree(ROOT / package, tmp_path / package, ignore=shutil.ignore_patterns("__pycache__"))
    words = "from twin.sources import *; print(sources_hash('detectors.judgement.assessment'), package_hash('twin', 'detectors'))"
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "PYTHONHASHSEED": "7"}
    said = subprocess.run(
        [sys.executable, "-c", words], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    expected = [sources.sources_hash("detectors.judgement.assessment"), sources.package_hash("twin", "detectors")]
    assert said.stdout.split() == expected
