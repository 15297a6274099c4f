"""From bytes to columns: the adapter of a content type, found by name or by first bytes, behind bounded inflation."""

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
from service.ingest.inflate import GZIP_MAGIC, inflated
from service.ingest.raw import Limits, RawRecord, TextDialect

_ADAPTERS: tuple[ModuleType, ...] = (
    parquet_format,
    hdf5_format,
    mdf4_format,
    tdms_format,
    matlab_format,
    json_format,
    csv_format,
)
"""One file per format; the order is that of recognition by first bytes, CSV being what remains."""
_GZIP_TYPES = ("application/gzip", "application/x-gzip")
ANY_TYPE = "application/octet-stream"
CONTENT_TYPES: tuple[str, ...] = (*(t for a in _ADAPTERS for t in a.CONTENT_TYPES), _GZIP_TYPES[0], ANY_TYPE)
"""Every content type that an upload may have."""


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
    if kind not in (*CONTENT_TYPES, *_GZIP_TYPES):
        offered = ", ".join(CONTENT_TYPES)
        fault = Fault("content-type", f"{kind or 'none'} is not one of {offered}")
        raise UnknownType(f"content type {kind or '(none)'} is not understood; send one of {offered}", [fault])


def parsed(
    content: bytes, content_type: str, content_encoding: str, limits: Limits, dialect: TextDialect | None = None
) -> RawRecord:
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
    zipped = kind in _GZIP_TYPES or encoding in ("gzip", "x-gzip")
    if zipped and not content.startswith(GZIP_MAGIC):
        raise Undecodable("the body is said to be gzip and is not", [Fault("body", "no gzip mark at its start")])
    if zipped or (kind == ANY_TYPE and content.startswith(GZIP_MAGIC)):
        content = inflated(content, limits.inflated_bytes)
        if not content.strip():
            raise Undecodable("the gzip file is empty", [Fault("body", "is empty")])
    named = [a for a in _ADAPTERS if kind in a.CONTENT_TYPES]
    adapter = named[0] if named else next(a for a in _ADAPTERS if a.recognises(content))
    return _read(adapter, content, limits, dialect or TextDialect())


def _names(content_type: str, content_encoding: str) -> tuple[str, str]:
    return content_type.partition(";")[0].strip().lower(), content_encoding.strip().lower()


def _read(adapter: ModuleType, content: bytes, limits: Limits, dialect: TextDialect) -> RawRecord:
    try:
        raw: RawRecord = (
            csv_format.parsed(content, limits, dialect) if adapter is csv_format else adapter.parsed(content, limits)
        )
    except Problem:
        raise
    except MemoryError:
        raise TooLarge("the file needs more memory to decode than the limit allows: split the record") from None
    except Exception as error:  # readers of foreign binary formats raise whatever damaged bytes lead them to
        what = f"{type(error).__name__}: {error}"[:200]
        name = adapter.CONTENT_TYPES[0]
        raise Undecodable(f"the body is not readable as {name}", [Fault("body", what)]) from None
    return raw
