"""Files to upload: found by name, folder or pattern, with the content type that their suffix says."""

from collections.abc import Sequence
from glob import glob
from pathlib import Path

SUFFIXES = (".csv", ".json", ".gz", ".parquet", ".h5", ".hdf5", ".mf4", ".tdms", ".mat")
"""What is taken from a folder; a file that is named is taken whatever it is called."""
_CONTENT_TYPES = {".csv": "text/csv", ".json": "application/json", ".gz": "application/gzip"}


def content_type_of(path: Path) -> str:
    """Content type by a file's suffix; binary formats are recognised by their first bytes."""
    return _CONTENT_TYPES.get(path.suffix.lower(), "application/octet-stream")


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
