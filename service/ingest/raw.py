"""What a reader hands over before anything is checked: tables of numbers and texts on clocks of their own, metadata.

A file goes through four hands: its reader makes a ``RawFile``; the mapping renames and converts inside each table;
``time_base`` brings all tables to one base, a ``RawRecord``; ``decode`` repairs and checks that.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from service.errors import Fault, TooLarge

Samples = NDArray[np.float64]
ForeignMetadata = dict[str, Any]
"""Names and values as a file gives them, or somebody beside it: numbers, texts and what readers make of the rest."""

METADATA = (
    "pump_serial",
    "aircraft",
    "position",
    "flight_id",
    "segment",
    "pump_type",
    "operator",
    "started_at",
    "flight_hours",
    "pressure_reference",
    "ambient_pressure_bar",
)
"""Metadata that mean something; any other is kept with the record."""
MOST_FAULTS_OF_A_KIND = 5
MOST_COLUMNS = 10_000
"""A recorder has hundreds; what holds more costs time by its names alone."""
MOST_METADATA = 1_000
_BYTES_PER_SAMPLE = 8


@dataclass(frozen=True, slots=True)
class Limits:
    """How much one upload may hold; metadata that mean something are not counted among the names."""

    inflated_bytes: int
    rows: int
    metadata_names: int = 200
    metadata_bytes: int = 2**16

    def without_words(self) -> "Limits":
        """For a record that was taken once: what later limits say of its metadata stays history."""
        return replace(self, metadata_names=MOST_METADATA, metadata_bytes=self.inflated_bytes)


@dataclass(frozen=True, slots=True)
class TextDialect:
    """How a text file writes its table; the defaults are those of the documented CSV.

    Attributes
    ----------
    delimiter
        Between fields; a blank means runs of blanks.
    decimal, thousands
        Decimal sign, and what stands between groups of three digits (empty: nothing does).
    encoding
        Text encoding.
    header_row
        Line number of the header, from 1; None: the first line that is neither blank nor a comment.
    header_rows
        Lines that the header takes, joined with a blank column by column.
    no_header
        There is none: columns are called ``names``, or by their number from ``1``.
    names
        Names of the columns instead of the header's.
    units_row
        Line number whose cells are the units of the columns, from 1.
    skip_rows
        Line numbers that say nothing.
    comment
        What a line of comment begins with; empty: nothing does.
    footer_rows
        Lines at the end that are no rows.
    missing
        Words for a missing sample beside the usual ones.
    """

    delimiter: str = ","
    decimal: str = "."
    encoding: str = "utf-8"
    thousands: str = ""
    header_row: int | None = None
    header_rows: int = 1
    no_header: bool = False
    names: tuple[str, ...] = ()
    units_row: int | None = None
    skip_rows: tuple[int, ...] = ()
    comment: str = "#"
    footer_rows: int = 0
    missing: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Table:
    """One table or group of a file: columns of equal or unequal length on one clock.

    Attributes
    ----------
    channels
        Name to samples as numbers, shape (n,) each; missing samples are NaN.
    texts
        Name to what no number says (words, instants as RFC 3339, enumerations by name), n entries, None where missing.
    name
        As the file calls the table; empty where it does not.
    time
        The format's own clock (a master channel, a waveform's increment) [s], shape (n,); None where the time can only
        be one of the columns.
    start
        Instant of ``time`` 0 where the format states one; without a zone where it states none.
    times
        Clocks of single columns that differ from the table's [s from ``start``], by name of the column.
    units
        Units that the file itself gives to columns.
    attributes
        Metadata of the table beside those of the file.
    """

    channels: dict[str, Samples]
    texts: dict[str, list[str | None]] = field(default_factory=dict)
    name: str = ""
    time: Samples | None = None
    start: datetime | None = None
    times: dict[str, Samples] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    attributes: ForeignMetadata = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class RawFile:
    """Decoded content of a file.

    Attributes
    ----------
    metadata
        Keys and values as the file gives them.
    tables
        One or more.
    faults
        What was wrong already in single cells, with the place of each.
    not_kept
        Columns that the record cannot hold, by name, with what they are.
    flags
        What was mended while reading.
    references
        ``gauge`` or ``absolute`` for those pressure channels whose reference is not the record's; a mapping says so.
    """

    metadata: ForeignMetadata
    tables: tuple[Table, ...] = ()
    faults: list[Fault] = field(default_factory=list)
    not_kept: dict[str, str] = field(default_factory=dict)
    flags: list[str] = field(default_factory=list)
    references: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class RawRecord:
    """A file on one time base, not checked yet.

    Attributes
    ----------
    metadata
        Keys and values as the file gives them.
    channels
        Name to samples as numbers, shape (n,) each but not yet of equal length; missing samples are NaN.
    faults
        What was wrong already in single cells, with the place of each.
    references
        ``gauge`` or ``absolute`` for those pressure channels whose reference is not the record's.
    not_kept, flags
        As in ``RawFile``.
    """

    metadata: ForeignMetadata
    channels: dict[str, Samples]
    faults: list[Fault] = field(default_factory=list)
    references: Mapping[str, str] = field(default_factory=dict)
    not_kept: dict[str, str] = field(default_factory=dict)
    flags: list[str] = field(default_factory=list)


def capped(faults: list[Fault], more: int, what: str, where: str) -> list[Fault]:
    """Faults of one kind, the first few by name and the rest as a count."""
    if more <= 0:
        return faults
    return [*faults, Fault(where, f"{more} more {what}")]


def check_size(n_rows: int, n_channels: int, limits: Limits) -> None:
    """Refuse a table by what its metadata say of its size, before any of it is decoded.

    Raises
    ------
    TooLarge
        naming the limit that it breaks.
    """
    if n_rows > limits.rows:
        raise TooLarge(f"the file has {n_rows} rows, more than {limits.rows}: split the record into segments")
    if n_rows * n_channels * _BYTES_PER_SAMPLE > limits.inflated_bytes:
        raise TooLarge(
            f"{n_rows} rows of {n_channels} channels inflate to more than {limits.inflated_bytes} bytes: "
            "leave out channels or split the record into segments"
        )


def check_columns(n_columns: int) -> None:
    """Refuse a table whose names alone cost too much.

    Raises
    ------
    TooLarge
        naming the limit.
    """
    if n_columns > MOST_COLUMNS:
        raise TooLarge(f"the file has {n_columns} columns, more than {MOST_COLUMNS}: leave out channels")


def plain(value: Any) -> Any:
    """Attribute of a binary file as a plain Python value; instants become RFC 3339 text in UTC."""
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    if isinstance(value, np.datetime64):
        return f"{np.datetime_as_string(value, unit='us')}Z"
    if isinstance(value, np.ndarray):
        return plain(value.reshape(-1)[0]) if value.size == 1 else str(value.tolist())[:1000]
    return value.item() if isinstance(value, np.generic) else value
