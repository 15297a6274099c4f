"""Writes the list of every file in docs/architecture.md, each with the first sentence of its own docstring."""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
ARCHITECTURE = ROOT / "docs" / "architecture.md"
PACKAGES = ("twin", "detectors", "service", "benchmarks")
START, END = "<!-- files -->\n", "<!-- end of files -->"


def folders() -> list[Path]:
    """Packages and all packages below them, a package before its parts."""
    found = (p.parent for package in PACKAGES for p in (ROOT / package).rglob("__init__.py"))
    return sorted(found, key=lambda p: (PACKAGES.index(p.relative_to(ROOT).parts[0]), p.relative_to(ROOT).parts))


def first_sentence(file: Path) -> str:
    """What a file says of itself, in one line.

    Raises
    ------
    ValueError
        for a file that says nothing.
    """
    said = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8")))
    if not said:
        raise ValueError(f"{file.relative_to(ROOT)} has no docstring")
    return " ".join(said.partition("\n\n")[0].split()).replace("``", "`")


def lines() -> Iterator[str]:
    """The list, folder by folder."""
    for folder in folders():
        yield f"**{folder.relative_to(ROOT).as_posix()}/** {first_sentence(folder / '__init__.py')}"
        yield ""
        files = sorted(f for f in folder.glob("*.py") if f.name != "__init__.py")
        yield from (f"- `{f.name}`: {first_sentence(f)}" for f in files)
        yield from ("",) if files else ()


def written(document: str) -> str:
    """The document with the list of today in it."""
    before, _, rest = document.partition(START)
    _, _, after = rest.partition(END)
    return before + START + "\n".join(lines()) + "\n" + END + after


if __name__ == "__main__":
    ARCHITECTURE.write_text(written(ARCHITECTURE.read_text(encoding="utf-8")), encoding="utf-8")
    print(f"wrote {ARCHITECTURE.relative_to(ROOT)}")
