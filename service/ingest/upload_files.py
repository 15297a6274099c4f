"""Files to upload: found by name, folder or pattern, with the content type that their suffix says."""

from collections.abc import Sequence
from glob import glob
from pathlib import Path

from service.ingest.file_formats import ANY_TYPE, CSV, FORMATS, GZIP, JSON, SUFFIXES, by_suffix
from service.ingest.looks import HEAD_BYTES, foreign_look


def content_type_of(path: Path) -> str:
    """Content type by a file's suffix; what has a mark of its own at its start is recognised by it."""
    named = by_suffix(path)
    return named.content_types[0] if named in (CSV, JSON, GZIP) else ANY_TYPE


def passed_over(places: Sequence[str]) -> list[tuple[Path, str]]:
    """Files in folders that are not sent, in order, with the reason; none of those that were named by themselves."""
    found = []
    for place in places:
        if Path(place).is_dir():
            others = sorted(p for p in Path(place).rglob("*") if p.is_file() and p.suffix.lower() not in SUFFIXES)
            found += [(path, _why_not(path)) for path in others]
    return found


def _why_not(path: Path) -> str:
    try:
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except OSError as error:
        return f"cannot be read: {error.strerror}"
    if not head:
        return "is empty"
    look = foreign_look(head)
    if look is not None:
        return f"looks like {look.name}: {look.advice}"
    ours = next((f for f in (*FORMATS, GZIP) if f.marks and f.begins(head)), None)
    if ours is not None:
        return f"looks like {ours.name}: name it {path.stem}{ours.suffixes[0]}, or give it by name"
    return f"{path.suffix or 'no suffix'} is none of {', '.join(SUFFIXES)}: give it by name if it is a record"


def files_of(places: Sequence[str]) -> tuple[list[Path], list[str]]:
    """Files in a fixed order, each once, and the places where there was none."""
    files: dict[Path, None] = {}
    missing = []
    for place in places:
        path = Path(place)
        if path.is_dir():
            found = sorted(p for p in path.rglob("*") if p.is_file() and p.suffix.lower() in SUFFIXES)
        elif path.is_file():
            found = [path]
        else:
            found = sorted(Path(name) for name in glob(place, recursive=True) if Path(name).is_file())
        if not found:
            missing.append(place)
        files |= dict.fromkeys(found)
    return list(files), missing
