"""The project keeps its own promises: bounds, file sizes, packaging, README commands."""

import os
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

from tests.fast_selection import FAST
from tests.study_selection import ON_POSTGRES_WITH_THE_STUDIES

ROOT = Path(__file__).resolve().parent.parent.parent
COMPILE_CACHE = {k: v for k, v in os.environ.items() if k == "CASEDRAIN_COMPILE_CACHE"}
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def sources() -> list[Path]:
    return [p for package in ("twin", "detectors", "service") for p in (ROOT / package).rglob("*.py")]


def test_every_dependency_has_a_lower_and_an_upper_bound() -> None:
    extras = [d for group in PROJECT["optional-dependencies"].values() for d in group]
    for dependency in (*PROJECT["dependencies"], *extras):
        if dependency.startswith("casedrain["):
            continue
        assert re.search(r">=\d", dependency), dependency
        assert re.search(r"<\d", dependency), dependency


def test_files_stay_readable() -> None:
    assert [str(p) for p in sources() if len(p.read_text().splitlines()) > 400] == []


def test_the_readme_names_commands_that_exist() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.M))
    readme = (ROOT / "README.md").read_text()
    named = set(re.findall(r"^make ([a-z-]+)", readme, re.M))
    assert {"demo", "test"} <= named <= targets
    for picture in re.findall(r"\]\((docs/[^)]+)\)", readme):
        assert (ROOT / picture).exists(), picture


@pytest.mark.parametrize("entry", FAST)
def test_the_fast_selection_names_what_there_is(entry: str) -> None:
    file, *names = entry.split("::")
    text = (ROOT / file).read_text()
    for name in names:
        assert re.search(rf"^ *(class|def) {name}\b", text, re.M), name


def test_the_study_selection_names_what_there_is() -> None:
    assert [file for file in ON_POSTGRES_WITH_THE_STUDIES if not (ROOT / file).is_file()] == []


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    from hatchling.builders.wheel import WheelBuilder

    return Path(next(WheelBuilder(str(ROOT)).build(directory=str(folder), versions=["standard"])))


def test_the_wheel_holds_migrations_pages_and_types(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    assert {
        "service/migrations/env.py",
        "service/migrations/versions/0001_first_tables.py",
        "service/web/dashboard/templates/fleet.html",
        "service/web/dashboard/static/casedrain.css",
        "twin/py.typed",
        "detectors/py.typed",
        "service/py.typed",
    } <= names
    assert not any(n.startswith("tests/") for n in names)


def test_the_wheel_migrates_a_database_from_any_folder(wheel: Path, tmp_path: Path) -> None:
    site, elsewhere = tmp_path / "site", tmp_path / "elsewhere"
    elsewhere.mkdir()
    zipfile.ZipFile(wheel).extractall(site)
    code = "from service.storage.database import upgrade, migrations_folder as f; upgrade('sqlite:///x.sqlite'); print(f())"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=elsewhere,
        env={"PYTHONPATH": str(site), "PATH": "/usr/bin:/bin", "HOME": str(tmp_path)} | COMPILE_CACHE,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == str(site / "service" / "migrations")
    assert (elsewhere / "x.sqlite").exists()
