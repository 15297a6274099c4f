"""Documents are true of what is there: rooms and files, versions, hooks, addresses."""

import re
import tomllib

import pytest

from service import __version__
from tests.code_map import ARCHITECTURE, PACKAGES, ROOT, START, folders, written

DOCUMENTS = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), ROOT / "CITATION.cff"])
NAMES = [d.relative_to(ROOT).as_posix() for d in DOCUMENTS]
HOSTS = {"127.0.0.1", "10.0.0.7", "test", "keepachangelog.com", "semver.org"}
"""Addresses that documents may name, besides those of example.org and its like."""
FILES = {p.name for part in (*PACKAGES, "tests", "migrations") for p in (ROOT / part).rglob("*.py")}


def commands(makefile: str, target: str) -> list[str]:
    """What a target runs, as a hook would say it."""
    found = re.search(rf"^{target}: .*\n((?:\t.*\n)+)", makefile, re.M)
    assert found is not None, target
    return [
        line.strip().removeprefix("@").replace('"$(BIN)/', ".venv/bin/").replace('"', "")
        for line in found[1].splitlines()
    ]


def test_the_list_of_files_is_the_files_of_today() -> None:
    text = ARCHITECTURE.read_text(encoding="utf-8")
    assert written(text) == text, "run `python tests/code_map.py` and commit"


def test_every_room_is_introduced_before_the_list() -> None:
    introduced = ARCHITECTURE.read_text(encoding="utf-8").partition(START)[0]
    rooms = [folder.relative_to(ROOT).as_posix() for folder in folders()]
    rooms += [f.relative_to(ROOT).as_posix() for f in (ROOT / "tests").iterdir() if (f / "__init__.py").exists()]
    assert [room for room in rooms if f"`{room}" not in introduced] == []


@pytest.mark.parametrize("document", NAMES)
def test_every_place_that_a_document_names_is_there(document: str) -> None:
    text = (ROOT / document).read_text(encoding="utf-8")
    names = re.findall(r"`((?:twin|detectors|service|benchmarks|tests|migrations|docs)/[\w/.-]*)`", text)
    known = [n for n in names if (ROOT / n).exists() or (ROOT / f"{n}.py").exists()]
    assert sorted(set(names) - set(known)) == []
    for name in re.findall(r"`((?:twin|detectors|service|benchmarks|tests)(?:\.\w+)+)(?<!\.py)`", text):
        assert _is_module_or_name_in_one(name), name
    assert sorted(set(re.findall(r"`(\w+\.py)`", text)) - FILES) == []
    for link in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", text):
        assert link.startswith("https:") or ((ROOT / document).parent / link).exists(), link


def _is_module_or_name_in_one(name: str) -> bool:
    parts = name.split(".")
    for n in range(len(parts), 0, -1):
        base = ROOT.joinpath(*parts[:n])
        file = base.with_suffix(".py") if base.with_suffix(".py").exists() else base / "__init__.py"
        if file.exists():
            return n == len(parts) or re.search(rf"\b{parts[n]}\b", file.read_text(encoding="utf-8")) is not None
    return False


@pytest.mark.parametrize("document", NAMES)
def test_documents_name_no_foreign_host_and_no_place_of_one_machine(document: str) -> None:
    text = (ROOT / document).read_text(encoding="utf-8")
    hosts = set(re.findall(r"https?://([\w.-]+)", text)) - HOSTS
    assert {h for h in hosts if not h.endswith((".example", "example.org", "example.com"))} == set()
    assert re.findall(r"(?<![\w.])/(?:home|root|tmp|work|Users)/\S+", text) == []


def test_what_is_cited_is_the_release() -> None:
    cited = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    (version,) = re.findall(r"^version: (\S+)$", cited, re.M)
    assert version == __version__
    (date,) = re.findall(r"^date-released: (\S+)$", cited, re.M)
    assert f"## [{version}] - {date}\n" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_the_changelog_begins_with_what_is_not_released_and_then_the_release() -> None:
    headings = re.findall(r"^## \[(.+?)\]", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.M)
    assert headings[:2] == ["Unreleased", __version__]


def test_hooks_run_what_ci_runs() -> None:
    hooks = re.findall(r"^ +entry: (.+)$", (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"), re.M)
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in ("lint", "types", "imports", "migrations"):
        assert f" make {target}\n" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")
        assert set(commands(makefile, target)) <= set(hooks), target
    for path in (word for hook in hooks for word in hook.split() if word.startswith("tests/")):
        assert (ROOT / path).exists(), path


def test_the_editor_and_the_formatter_agree() -> None:
    width = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["ruff"]["line-length"]
    assert f"max_line_length = {width}" in (ROOT / ".editorconfig").read_text(encoding="utf-8")
