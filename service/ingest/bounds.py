"""Bounds on what a file says beside its samples: foreign metadata and names, whatever format they come in."""

from collections.abc import Iterable
from typing import Any

from service.errors import Fault, TooLarge
from service.ingest.raw import METADATA, Limits, RawFile

MOST_NAME_BYTES = 2**20
"""All names of columns together: ten thousand columns of a hundred letters. They go into answers and into every look."""
_SHOWN = 40


def check_words(file: RawFile, limits: Limits) -> None:
    """Refuse a file whose words beside its samples would cost more than they can say.

    Metadata that mean something do not count as names, their bytes do. One value in many groups counts once, as it is kept.

    Raises
    ------
    TooLarge
        naming the limit, and by name what says the most.
    """
    names, size, largest = 0, 0, ("", 0)
    for name, value in _metadata(file):
        names += name not in METADATA
        cost = _bytes(name) + _bytes(value)
        size += cost
        largest = max(largest, (name, cost), key=lambda item: item[1])
    if names > limits.metadata_names:
        raise TooLarge(
            f"the file has {names} foreign metadata, more than {limits.metadata_names}: leave out what no analysis reads",
            [Fault("metadata", f"has {names} names, more than {limits.metadata_names}")],
        )
    if size > limits.metadata_bytes:
        where = largest[0][:_SHOWN]
        raise TooLarge(
            f"the metadata take {size} bytes, more than {limits.metadata_bytes}: leave out what no analysis reads",
            [Fault(f"metadata.{where}", f"takes {largest[1]} of {size} bytes; {limits.metadata_bytes} are allowed")],
        )
    of_columns = sum(map(_bytes, _columns(file)))
    if of_columns > MOST_NAME_BYTES:
        raise TooLarge(
            f"the names of the columns take {of_columns} bytes, more than {MOST_NAME_BYTES}: leave out columns",
            [Fault("channels", f"names take {of_columns} bytes")],
        )


def _metadata(file: RawFile) -> Iterable[tuple[str, Any]]:
    """Metadata as a record keeps them: a name that tables use for different values counts once for each table."""
    said = dict(file.metadata)
    yield from said.items()
    for number, table in enumerate(file.tables):
        for name, value in table.attributes.items():
            if name not in said:
                said[name] = value
                yield name, value
            elif said[name] is not value and _text(said[name]) != _text(value):
                yield f"{table.name or number}.{name}", value


def _columns(file: RawFile) -> Iterable[str]:
    yield from file.not_kept
    for table in file.tables:
        yield table.name
        yield from table.channels
        yield from table.texts
        yield from table.units.values()


def _text(value: Any) -> str:
    return value if isinstance(value, str) else repr(value)[:200]


def _bytes(value: Any) -> int:
    return len(_text(value).encode("utf-8", "replace"))
