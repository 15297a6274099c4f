"""Look at a file of any format and propose its mapping: text is looked at before it is read."""

import zlib
from collections.abc import Callable
from pathlib import Path

from service.answers.mappings import MappingSuggestion
from service.ingest.file_formats import ANY_TYPE, CSV, FORMATS, GZIP
from service.ingest.raw import ForeignMetadata, RawFile, TextDialect
from service.ingest.suggestion import suggestion
from service.ingest.text_look import HEAD_BYTES, TAIL_BYTES, look


def proposed(
    path: Path,
    content_type: str,
    content_encoding: str,
    read: Callable[[TextDialect | None], RawFile],
    named: ForeignMetadata | None = None,
) -> MappingSuggestion:
    """A mapping for a file.

    Parameters
    ----------
    path, content_type, content_encoding
        The file, and what it is said to be.
    read
        Reads it by a dialect, within whatever limits hold.
    named
        Metadata of the request.

    Raises
    ------
    Problem
        where it cannot be read at all.
    """
    head, tail = _ends(path, content_encoding)
    kind = content_type.partition(";")[0].strip().lower()
    is_text = kind in CSV.content_types or next(f for f in FORMATS if f.begins(head)) is CSV
    if not is_text or (kind not in (*CSV.content_types, *GZIP.content_types, ANY_TYPE)):
        return suggestion(read(None), None, named)
    text = look(head, tail)
    return suggestion(read(text.rule.dialect), text, named)


def _ends(path: Path, content_encoding: str) -> tuple[bytes, bytes | None]:
    """First bytes of a file, inflated where it is gzip, and its last where these are not among them."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
        if GZIP.begins(head) or content_encoding.strip().lower() in ("gzip", "x-gzip"):
            inflater = zlib.decompressobj(wbits=31)
            try:
                whole = inflater.decompress(head, HEAD_BYTES)
            except zlib.error:
                return b"", None  # the reader says what is wrong
            return whole, None if inflater.eof else b""
        if size <= HEAD_BYTES:
            return head, None
        file.seek(max(size - TAIL_BYTES, 0))
        return head, file.read()
