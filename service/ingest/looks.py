"""What a file looks like that is none of ours: known by its first bytes, with what to do about it."""

import struct
from collections.abc import Callable
from dataclasses import dataclass

from service.errors import Fault, Undecodable
from service.ingest.file_formats import ANY_TYPE, CSV, FORMATS, GZIP, JSON, FileFormat

HEAD_BYTES = 8192
"""Bytes from the start that are looked at."""
_TEXT = bytes({7, 8, 9, 10, 12, 13, 27} | set(range(0x20, 0x100)) - {0x7F})
_AS_CSV = "save the sheet as CSV (UTF-8) and send that"
_UNPACK = "unpack it and send the records, or send them together as a ZIP archive to /records/bulk"
_EXPORT = "export it as CSV, Parquet, HDF5, MDF4, TDMS or MATLAB"


@dataclass(frozen=True, slots=True)
class Look:
    """A kind of file that is not read, and what to do with one."""

    name: str
    advice: str


_MDF3 = Look("an MDF 3 (or 2) measurement file", "convert it to MDF 4.10, e.g. with asammdf, and send that")
_MAT4 = Look("a MATLAB 4 file", "save it anew with save(…, '-v7') or '-v7.3'")
_ZIP = Look("a ZIP archive", "send it to /records/bulk, or unpack it and send its records")
_TEXTUAL: tuple[tuple[bytes, Look], ...] = (
    (b"%pdf-", Look("a PDF document", "send the recording that it was printed from")),
    (b"{\\rtf", Look("an RTF document", "save it as plain text")),
    (b"<!doctype html", Look("a web page", "send the file itself: this is often the sign-in page of a download")),
    (b"<html", Look("a web page", "send the file itself: this is often the sign-in page of a download")),
    (b"<?xml", Look("an XML document", _EXPORT)),
    (b"|cf,", Look("an imc FAMOS file", _EXPORT)),
    (b"diaem", Look("a DIAdem file", _EXPORT)),
)
"""Beginnings of text, in small letters, that no table has."""
_BINARY: tuple[tuple[bytes, Look], ...] = (
    (b"MDF     3", _MDF3),
    (b"MDF     2", _MDF3),
    (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", Look("an Excel 97 workbook or another old Office document", _AS_CSV)),
    (b"\x89PNG\r\n\x1a\n", Look("a PNG picture", "send the recording that it shows")),
    (b"\xff\xd8\xff", Look("a JPEG picture", "send the recording that it shows")),
    (b"GIF8", Look("a GIF picture", "send the recording that it shows")),
    (b"%PDF-", _TEXTUAL[0][1]),
    (b"7z\xbc\xaf\x27\x1c", Look("a 7-Zip archive", _UNPACK)),
    (b"Rar!\x1a\x07", Look("a RAR archive", _UNPACK)),
    (b"\xfd7zXZ\x00", Look("an xz file", "unpack it, or pack it with gzip instead")),
    (b"BZh", Look("a bzip2 file", "unpack it, or pack it with gzip instead")),
    (b"\x28\xb5\x2f\xfd", Look("a Zstandard file", "unpack it, or pack it with gzip instead")),
    (b"\x04\x22\x4d\x18", Look("an LZ4 file", "unpack it, or pack it with gzip instead")),
    (b"\x1f\x8b", Look("a gzip file", "pack it once: send it as application/gzip")),
    (b"SQLite format 3\x00", Look("an SQLite database", _EXPORT)),
    (b"CDF\x01", Look("a NetCDF 3 file", "save it as NetCDF 4 (which is HDF5), or as CSV")),
    (b"CDF\x02", Look("a NetCDF 3 file", "save it as NetCDF 4 (which is HDF5), or as CSV")),
    (b"CDF\x05", Look("a NetCDF 3 file", "save it as NetCDF 4 (which is HDF5), or as CSV")),
    (b"ARROW1", Look("an Arrow (Feather) file", "save it as Parquet")),
    (b"FEA1", Look("a Feather file", "save it as Parquet")),
    (b"ORC", Look("an ORC file", "save it as Parquet")),
    (b"Obj\x01", Look("an Avro file", "save it as Parquet")),
    (b"\x93NUMPY", Look("a NumPy array", "save it with names: as CSV, Parquet or HDF5")),
    (b"\x80\x04\x95", Look("a Python pickle", "save it as CSV, Parquet or HDF5: a pickle is never opened")),
    (b"\x80\x05\x95", Look("a Python pickle", "save it as CSV, Parquet or HDF5: a pickle is never opened")),
    (b"RIFF", Look("a WAV or AVI file", _EXPORT)),
    (b"\x25\xeb", Look("an IRIG 106 Chapter 10 recording", _EXPORT)),
    (b"MZ", Look("a program", "send the recording")),
    (b"\x7fELF", Look("a program", "send the recording")),
    (b"Salted__", Look("an encrypted file", "decrypt it")),
    (b"\x85\x01", Look("an encrypted file", "decrypt it")),
)
"""First bytes of files that are no text."""
_INSIDE_ZIP: tuple[tuple[bytes, Look], ...] = (
    (b"xl/", Look("an Excel workbook", _AS_CSV)),
    (b"opendocument.spreadsheet", Look("an OpenDocument spreadsheet", _AS_CSV)),
    (b"word/", Look("a Word document", "send the recording as a file of its own")),
    (b".npy", Look("a NumPy archive", "save it with names: as CSV, Parquet or HDF5")),
)


def foreign_look(head: bytes) -> Look | None:
    """What a file looks like by its first bytes; None for one of ours and for what cannot be told."""
    start = head[:HEAD_BYTES]
    if any(f.marks and f.begins(start) for f in FORMATS if f is not JSON):
        return None
    text = start.lstrip(b"\xef\xbb\xbf \t\r\n")[:32].lower()
    found = next((look for mark, look in _TEXTUAL if text.startswith(mark)), None)
    if found is not None or not start.translate(None, _TEXT):
        return found  # a table may begin with any letters
    if start.startswith(b"PK\x03\x04"):
        # a sheet's parts may come late: its list of contents is always named first or second
        inside = next((look for mark, look in _INSIDE_ZIP if mark in start), None)
        return inside or (_INSIDE_ZIP[0][1] if b"[Content_Types].xml" in start[:200] else _ZIP)
    if start[257:262] == b"ustar":
        return Look("a tar archive", _UNPACK)
    found = next((look for mark, look in _BINARY if start.startswith(mark)), None)
    return found or (_MAT4 if _is_matlab_4(start) else None)


def refuse_foreign(content: bytes, named: FileFormat | None) -> None:
    """Refuse a body that is recognised as something else than it is said to be.

    Raises
    ------
    Undecodable
        saying what it looks like and what to do.
    """
    if named is not None and named.marks and named.begins(content):
        return
    ours = next((f for f in (*FORMATS, GZIP) if f not in (JSON, CSV) and f.begins(content)), None)
    if ours is not None and ours is not named and (named is not None or ours is GZIP):
        said = f", not like {named.name}" if named is not None else " inside gzip"
        what = f"the body looks like {ours.name}{said}"
        advice = f"send it as {ours.content_types[0]} or {ANY_TYPE}" if ours is not GZIP else "pack it once"
        raise Undecodable(f"{what}: {advice}", [Fault("body", f"looks like {ours.name}: {advice}")])
    look = foreign_look(content)
    if look is not None:
        detail = f"the body looks like {look.name}, which is not read: {look.advice}"
        raise Undecodable(detail, [Fault("body", f"looks like {look.name}: {look.advice}")])


def _is_matlab_4(start: bytes) -> bool:
    """A MATLAB 4 file has no mark: five numbers that make sense, and a name."""
    if len(start) < 24:
        return False
    readers: tuple[Callable[[bytes], tuple[int, ...]], ...] = (
        lambda b: struct.unpack("<5i", b),
        lambda b: struct.unpack(">5i", b),
    )
    for read in readers:
        kind, rows, columns, imaginary, length = read(start[:20])
        order, rest = divmod(kind, 1000)
        precision, content = divmod(rest, 10)
        if not (0 <= order <= 4 and precision in (0, 10, 20, 30, 40, 50) and 0 <= content <= 2):
            continue
        name = start[20 : 20 + length]
        if rows > 0 and columns > 0 and imaginary in (0, 1) and 1 < length < 64 and name.endswith(b"\x00"):
            return name[:-1].isascii() and name[:-1].decode("ascii").isidentifier()
    return False
