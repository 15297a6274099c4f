"""From bytes to columns: the adapter of a content type, found by name or by first bytes, behind bounded inflation."""

from collections.abc import Mapping
from dataclasses import replace
from types import ModuleType

from service.errors import Fault, Problem, TooLarge, Undecodable, UnknownType
from service.ingest import (
    csv_format,
    hdf5_format,
    json_format,
    matlab_format,
    mdf4_format,
    parquet_format,
    tdms_format,
)
from service.ingest.bounds import check_words
from service.ingest.file_formats import (
    ANY_TYPE,
    CONTENT_TYPES,
    CSV,
    FORMATS,
    GZIP,
    HDF5,
    JSON,
    MATLAB,
    MDF4,
    PARQUET,
    TDMS,
    FileFormat,
)
from service.ingest.inflate import inflated
from service.ingest.looks import refuse_foreign
from service.ingest.raw import Limits, RawFile, TextDialect

_READERS: Mapping[FileFormat, ModuleType] = {
    PARQUET: parquet_format,
    HDF5: hdf5_format,
    MDF4: mdf4_format,
    TDMS: tdms_format,
    MATLAB: matlab_format,
    JSON: json_format,
    CSV: csv_format,
}


def check_type(content_type: str, content_encoding: str) -> None:
    """Refuse what no adapter reads.

    Raises
    ------
    UnknownType
        naming the types that are read.
    """
    kind, encoding = _names(content_type, content_encoding)
    if encoding not in ("", "identity", "gzip", "x-gzip"):
        raise UnknownType(f"content encoding {encoding!r} is not understood: send gzip or none")
    if kind not in (*CONTENT_TYPES, *GZIP.content_types):
        offered = ", ".join(CONTENT_TYPES)
        fault = Fault("content-type", f"{kind or 'none'} is not one of {offered}")
        raise UnknownType(f"content type {kind or '(none)'} is not understood; send one of {offered}", [fault])


def parsed(
    content: bytes, content_type: str, content_encoding: str, limits: Limits, dialect: TextDialect | None = None
) -> RawFile:
    """Columns and metadata of a file.

    Raises
    ------
    Undecodable, UnknownType, TooLarge
        whatever the bytes are: a reader never fails in another way.
    """
    check_type(content_type, content_encoding)
    if not content:
        raise Undecodable("the body is empty: send the record's bytes", [Fault("body", "is empty")])
    kind, encoding = _names(content_type, content_encoding)
    zipped = kind in GZIP.content_types or encoding in ("gzip", "x-gzip")
    if zipped and not GZIP.begins(content):
        raise Undecodable("the body is said to be gzip and is not", [Fault("body", "no gzip mark at its start")])
    is_cut = False
    if zipped or (kind == ANY_TYPE and GZIP.begins(content)):
        content, is_cut = inflated(content, limits.inflated_bytes)
        if not content or content.isspace():
            raise Undecodable("the gzip file is empty", [Fault("body", "is empty")])
    named = next((f for f in FORMATS if kind in f.content_types), None)
    refuse_foreign(content, named)
    named = named or next(f for f in FORMATS if f.begins(content))
    read = _whole_lines if is_cut else _read
    file = read(named, content, limits, dialect or TextDialect())
    check_words(file, limits)
    return file


def _whole_lines(named: FileFormat, content: bytes, limits: Limits, dialect: TextDialect) -> RawFile:
    """What a stream that was cut still holds: of a text table the lines that are whole."""
    fault = Fault("body", f"the gzip stream ends after {len(content)} inflated bytes without its end mark")
    whole = content[: content.rfind(b"\n") + 1]
    if named is not CSV or not whole:
        raise Undecodable("the gzip data is cut short: upload the whole file", [fault])
    file = _read(named, whole, limits, dialect)
    return replace(file, flags=["the gzip stream is cut: its whole lines are kept", *file.flags])


def _names(content_type: str, content_encoding: str) -> tuple[str, str]:
    return content_type.partition(";")[0].strip().lower(), content_encoding.strip().lower()


def _read(file_format: FileFormat, content: bytes, limits: Limits, dialect: TextDialect) -> RawFile:
    try:
        raw: RawFile = (
            csv_format.parsed(content, limits, dialect)
            if file_format is CSV
            else _READERS[file_format].parsed(content, limits)
        )
    except Problem:
        raise
    except MemoryError:
        raise TooLarge("the file needs more memory to decode than the limit allows: split the record") from None
    except Exception as error:  # readers of foreign binary formats raise whatever damaged bytes lead them to
        what = f"{type(error).__name__}: {error}"[:200]
        raise Undecodable(
            f"the body is not readable as {file_format.content_types[0]}", [Fault("body", what)]
        ) from None
    return raw
