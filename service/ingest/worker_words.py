"""What the service and its parser process say to each other, one JSON document a line."""

from typing import NotRequired, TypedDict

from service.answers.documents import JsonObject
from service.ingest.raw import ForeignMetadata

Column = tuple[str, int]
"""Name and number of samples; the samples themselves stand in the file of channels, in this order."""


class LimitsSaid(TypedDict):
    """``service.ingest.raw.Limits``: bytes and counts."""

    inflated_bytes: int
    rows: int
    metadata_names: int
    metadata_bytes: int


class Asked(TypedDict):
    """What every request says: a file, how much memory it may take [bytes], where the answer's bulk goes."""

    path: str
    memory_bytes: int
    output: str


class FileAsked(Asked):
    """One record; ``dialect`` holds the fields of a ``TextDialect`` by name."""

    content_type: str
    content_encoding: str
    limits: LimitsSaid
    dialect: JsonObject | None
    with_texts: bool


class ArchiveAsked(Asked):
    """An upload of many records, ``zip`` or ``ndjson``."""

    archive: str


class TableSaid(TypedDict):
    """A table without its samples; ``start`` in RFC 3339."""

    channels: list[Column]
    time: Column | None
    times: list[Column]
    texts: dict[str, list[str | None]]
    name: str
    start: str | None
    units: dict[str, str]
    attributes: ForeignMetadata


class FileSaid(TypedDict):
    """A file that was read; faults as place and problem."""

    metadata: ForeignMetadata
    tables: list[TableSaid]
    faults: list[tuple[str, str]]
    not_kept: dict[str, str]
    flags: list[str]


class IndexSaid(TypedDict):
    """An archive whose index was written: how many members it has (a count)."""

    members: int


class Refused(TypedDict):
    """Why there is no answer: the name of a class of ``service.errors``; ``memory`` where the limit of memory is why."""

    problem: str
    detail: NotRequired[str]
    errors: NotRequired[list[tuple[str, str]]]
    memory: NotRequired[bool]


Answer = FileSaid | IndexSaid | Refused
