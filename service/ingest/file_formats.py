"""The one table of file formats: name, content types, suffixes, first bytes. Which module reads one, ``parse`` says."""

from dataclasses import dataclass
from pathlib import PurePath

ANY_TYPE = "application/octet-stream"
"""A file of any format, recognised by its first bytes."""


@dataclass(frozen=True, slots=True)
class FileFormat:
    """One format of a flight record.

    ``content_types`` are media types, the first is the one that is offered; ``marks`` are beginnings, none for a
    format that text alone cannot tell; ``after_blanks`` says whether blanks may stand before a mark.
    """

    name: str
    content_types: tuple[str, ...]
    suffixes: tuple[str, ...]
    marks: tuple[bytes, ...] = ()
    after_blanks: bool = False

    def begins(self, content: bytes) -> bool:
        """Whether bytes begin like a file of this format; any bytes do where it has no mark."""
        start = content.lstrip() if self.after_blanks else content
        return not self.marks or start.startswith(self.marks)


PARQUET = FileFormat("Parquet", ("application/vnd.apache.parquet",), (".parquet",), (b"PAR1",))
HDF5 = FileFormat("HDF5", ("application/x-hdf5",), (".h5", ".hdf5"), (b"\x89HDF\r\n\x1a\n",))
MDF4 = FileFormat("MDF4", ("application/x-mdf4",), (".mf4",), (b"MDF     4", b"UnFinMF 4"))
TDMS = FileFormat("TDMS", ("application/x-tdms",), (".tdms",), (b"TDSm",))
MATLAB = FileFormat(
    "MATLAB", ("application/x-matlab-data",), (".mat",), (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file")
)
JSON = FileFormat("JSON", ("application/json",), (".json",), (b"{",), after_blanks=True)
CSV = FileFormat("CSV", ("text/csv",), (".csv",))
GZIP = FileFormat("gzip", ("application/gzip", "application/x-gzip"), (".gz",), (b"\x1f\x8b",))
"""A wrapping around one of the others."""

FORMATS: tuple[FileFormat, ...] = (PARQUET, HDF5, MDF4, TDMS, MATLAB, JSON, CSV)
"""In the order of recognition by first bytes, CSV being what remains."""
CONTENT_TYPES: tuple[str, ...] = (*(t for f in FORMATS for t in f.content_types), GZIP.content_types[0], ANY_TYPE)
"""Every content type that an upload may have."""
SUFFIXES: tuple[str, ...] = tuple(s for f in (*FORMATS, GZIP) for s in f.suffixes)
"""Suffixes of flight records."""


def by_suffix(path: PurePath) -> FileFormat | None:
    """Format that a file's suffix names; None for another suffix."""
    return next((f for f in (*FORMATS, GZIP) if path.suffix.lower() in f.suffixes), None)
