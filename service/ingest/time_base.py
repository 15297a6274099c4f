"""All tables of a file on one time base: channels are found by name over the tables, never laid on each other by index.

Each column has a clock: its own, else its table's ``time_s``, else the format's. The base is the clock of the fastest
pressure, lengthened by what slower ones saw where it has no sample. What lies on the base's own clock passes bit for
bit; a sample of any other clock goes to the nearest instant of the base, and between such samples is nothing: the
reduction holds slow channels by their age, nobody interpolates here.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from service.errors import Fault, TooLarge
from service.ingest.clocks import EARLIEST_YEAR, KNOWN, Clock, Column, Key, aligned, columns_of, table_names
from service.ingest.merging import Base
from service.ingest.raw import METADATA, ForeignMetadata, RawFile, RawRecord, Table
from twin.recording import REQUIRED_CHANNELS, TIME

MOST_BYTES = 1 << 30
"""What the channels of one record may take on their base: a slow channel takes as much there as a fast one."""
_PRESSURES = frozenset(("discharge_pressure_bar", "case_pressure_bar", "reservoir_pressure_bar"))


def on_one_base(file: RawFile, most_bytes: int = MOST_BYTES) -> RawRecord:
    """The file's channels on one base of time, shape (n,) each.

    ``time_s`` counts from the earliest start that the file states, which is ``started_at`` where its metadata give
    none. A known channel that cannot be placed is a fault that names its table; any other is named as not kept.

    Raises
    ------
    TooLarge
        when the known channels take more than ``most_bytes`` on the base.
    """
    metadata, contradictions = _metadata(file)
    columns, bare = _columns(file.tables)
    columns, twice = _named_once(columns)
    held = {TIME, *(column.name for column in columns)} if bare else {column.name for column in columns}
    record = RawRecord(
        metadata,
        {},
        [*file.faults, *contradictions, *twice],
        file.references,
        file.not_kept | {name: "text" for table in file.tables for name in table.texts if name not in held},
        list(file.flags),
    )
    clocks = {column.clock.key: column.clock for column in columns if column.clock is not None}
    clocks = clocks or {clock.key: clock for clock in bare}
    leading = {c.clock.key for c in columns if c.clock is not None and c.name in KNOWN} or set(clocks)
    origin, offsets, lost = aligned(clocks, leading)
    lost |= _set_anew(clocks, offsets)
    if origin is not None and origin.year >= EARLIEST_YEAR and not metadata.get("started_at"):
        metadata["started_at"] = origin.isoformat()
    _tell_of_our_own(record, held)
    placed = _placeable(columns, lost, record, alone=len(file.tables) == 1)
    if offsets:
        _place(placed, clocks, offsets, record, most_bytes)
    return record


def _metadata(file: RawFile) -> tuple[ForeignMetadata, list[Fault]]:
    """Metadata of the file and of its tables, which win; what tables say differently is a fault where it means something."""
    merged, faults = dict(file.metadata), []
    said_by: dict[str, str] = {}
    for table, called in zip(file.tables, table_names(file.tables), strict=True):
        for name, value in table.attributes.items():
            if name not in said_by:
                merged[name] = value
                said_by[name] = called
            elif merged[name] != value and name in METADATA:
                text = f"is {merged[name]!r} in table {said_by[name]} and {value!r} in table {called}"
                faults.append(Fault(name, text))
            elif merged[name] != value:
                merged[f"{table.name}.{name}"] = value
    return merged, faults


def _columns(tables: Sequence[Table]) -> tuple[list[Column], list[Clock]]:
    """Columns of all tables, and the clocks of the tables themselves."""
    columns: list[Column] = []
    clocks = []
    for table, called in zip(tables, table_names(tables), strict=True):
        own, clock = columns_of(table, called, alone=len(tables) == 1)
        columns += own
        if clock is not None:
            clocks.append(clock)
    return columns, clocks


def _named_once(columns: Sequence[Column]) -> tuple[list[Column], list[Fault]]:
    """Columns of which no two have one name: the same twice is one; a foreign name twice gets its table's before it."""
    kept: dict[str, Column] = {}
    faults = []
    for column in columns:
        first = kept.get(column.name)
        if first is None:
            kept[column.name] = column
        elif _is_the_same(first, column):
            continue
        elif column.name in KNOWN:
            text = f"is in table {first.table} and in table {column.table}, with different samples"
            faults.append(Fault(f"channels.{column.name}", text))
        else:
            name = f"{column.table.strip(chr(39))}.{column.name}"
            kept.setdefault(name, Column(name, column.samples, column.table, column.clock))
    return list(kept.values()), faults


def _is_the_same(one: Column, other: Column) -> bool:
    keys = [None if c.clock is None else c.clock.key for c in (one, other)]
    return keys[0] == keys[1] and np.array_equal(one.samples, other.samples, equal_nan=True)


def _set_anew(clocks: Mapping[Key, Clock], offsets: dict[Key, float]) -> dict[Key, str]:
    """Clocks that run back too far to be placed beside others; they lose their offset."""
    if len(offsets) < 2:
        return {}
    back = {key: behind for key in offsets if (behind := clocks[key].runs_back_s)}
    for key in back:
        del offsets[key]
    return {key: f"the times of its table {clocks[key].table} run back by {behind:g} s" for key, behind in back.items()}


def _tell_of_our_own(record: RawRecord, held: Collection[str]) -> None:
    """What a reader could not keep is a fault where a record needs it, and said where a record has use for it."""
    for name, what in record.not_kept.items():
        if name in held:
            continue
        if name in REQUIRED_CHANNELS:
            record.faults.append(Fault(f"channels.{name}", f"cannot be read: it is {what}"))
        elif name in KNOWN:
            record.flags.append(f"{name} was left out: it is {what}")


def _placeable(
    columns: Iterable[Column], lost: Mapping[Key, str], record: RawRecord, *, alone: bool
) -> list[tuple[Column, Key]]:
    """Columns with the key of their clock; what has none is a fault or named as not kept."""
    placed = []
    for column in columns:
        if column.clock is not None and column.clock.key not in lost:
            placed.append((column, column.clock.key))
            continue
        why = f"its table {column.table} has no times for its {len(column.samples)} samples"
        if column.clock is not None:
            why = lost[column.clock.key]
        if column.clock is None and alone and column.name in KNOWN:
            record.channels[column.name] = column.samples  # the check of lengths says what is wrong with it
        elif column.name in KNOWN:
            record.faults.append(Fault(f"channels.{column.name}", f"cannot be placed in time: {why}"))
        else:
            record.not_kept[column.name] = why
    return placed


def _place(
    columns: Sequence[tuple[Column, Key]],
    clocks: Mapping[Key, Clock],
    offsets: Mapping[Key, float],
    record: RawRecord,
    most_bytes: int,
) -> None:
    """Put every column on the base and into the record."""
    times = {key: _from_origin(clocks[key], offsets[key]) for key in offsets}
    periods = {key: clocks[key].period_s for key in offsets}
    known = [(column, key) for column, key in columns if column.name in KNOWN]
    ranked = _ranked(known or columns, periods) or list(offsets)
    base = Base(times[ranked[0]], periods[ranked[0]])
    for key in ranked[1:]:
        if known:
            base.lengthen(times[key], periods[key])
    places = {}
    room = most_bytes - 8 * len(base) * (1 + len(known))
    if room < 0 and len(ranked) > 1:
        raise TooLarge(
            f"its {len(known)} channels on one time base of {len(base)} instants take more than {most_bytes} bytes: "
            "split the record into segments"
        )
    record.channels[TIME] = base.times
    for column, key in sorted(columns, key=lambda placed: placed[0].name not in KNOWN):
        if key == ranked[0] and len(column.samples) == len(times[key]):
            record.channels[column.name] = base.own(column.samples)
            continue
        if column.name not in KNOWN and (room := room - 8 * len(base)) < 0:
            record.not_kept[column.name] = f"too large on the record's {len(base)} instants"
            continue
        if key not in places:
            places[key] = base.nearest(times[key], periods[key])
        samples, left = places[key].spread(column.samples)
        n = len(column.samples)
        if left == n and column.name not in KNOWN:
            record.not_kept[column.name] = "its times lie outside of the record's"
            continue
        record.channels[column.name] = samples
        if left:
            record.not_kept[column.name] = f"{left} of its {n} samples, which lie between the record's times or outside"


def _from_origin(clock: Clock, offset: float) -> Any:
    return clock.times + offset if offset else clock.times


def _ranked(columns: Sequence[tuple[Column, Key]], periods: Mapping[Key, float]) -> list[Key]:
    """Clocks of these columns, the base's first: pressures lose no sample, so the fastest of theirs leads."""
    carried: dict[Key, list[str]] = {}
    for column, key in columns:
        carried.setdefault(key, []).append(column.name)

    def rank(key: Key) -> tuple[bool, float, int]:
        return not _PRESSURES.intersection(carried[key]), periods[key], -len(carried[key])

    return sorted(carried, key=rank)
