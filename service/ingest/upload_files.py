"""Files to upload: found by name, folder or pattern, with the content type that their suffix says."""

from collections.abc import Sequence
from glob import glob
from pathlib import Path

from service.ingest.file_formats import ANY_TYPE, CSV, GZIP, JSON, SUFFIXES, by_suffix


def content_type_of(path: Path) -> str:
    """Content type by a file's suffix; what has a mark of its own at its start is recognised by it."""
    named = by_suffix(path)
    return named.content_types[0] if named in (CSV, JSON, GZIP) else ANY_TYPE


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
