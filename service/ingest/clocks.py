"""Clocks of a file's columns: which one each has, and how clocks that start at different instants stand to each other."""

import hashlib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np

from service.ingest.raw import Samples, Table
from service.ingest.time_words import is_time_name
from twin.recording import OPTIONAL_CHANNELS, REQUIRED_CHANNELS, TIME

KNOWN = frozenset((*REQUIRED_CHANNELS, *OPTIONAL_CHANNELS)) - {TIME}
EARLIEST_YEAR = 1990
"""A start before this is a recorder's zero (1904, 1970): clocks of one file stand by it, the flight did not begin there."""
_LARGEST_STEP_BACK = 10.0
"""In periods of the clock; neighbours out of order stay below, a clock that was set anew does not."""

Key = tuple[datetime | None, bytes]


@dataclass(frozen=True, slots=True)
class Clock:
    """Times of some columns [s from ``start``], shape (n,); ``start`` None: from an instant that nobody states."""

    key: Key
    times: Samples
    start: datetime | None
    table: str

    @property
    def period_s(self) -> float:
        """Usual time between two samples; infinite for a clock of one."""
        times = np.sort(self.times[np.isfinite(self.times)])
        steps = np.diff(times)
        steps = steps[steps > 0.0]
        return float(np.median(steps)) if len(steps) else np.inf

    @property
    def runs_back_s(self) -> float:
        """How far it falls behind a time that it has shown, beyond what neighbours out of order do; 0 else."""
        times = self.times[np.isfinite(self.times)]
        if not len(times):
            return 0.0
        behind = float(np.max(np.maximum.accumulate(times) - times))
        return behind if behind > _LARGEST_STEP_BACK * self.period_s else 0.0


@dataclass(frozen=True, slots=True)
class Column:
    """One channel of one table; ``clock`` None: nothing says when its samples were taken."""

    name: str
    samples: Samples
    table: str
    clock: Clock | None


def columns_of(table: Table, name: str, *, alone: bool) -> tuple[list[Column], Clock | None]:
    """Columns of a table but its clock, and that clock.

    Parameters
    ----------
    table, name
        The table and what to call it.
    alone
        Whether it is the file's only one. Beside others the format's own clock wins over a ``time_s`` that is the same
        one but counts from another zero (a mapping brings a foreign clock to its first sample).
    """
    own, made = table.channels.get(TIME), table.time
    times = own if own is not None else made
    if not alone and own is not None and made is not None and _same_but_for_zero(own, made):
        times = made
    start = table.start
    known: dict[int, Clock] = {}

    def clock(samples: Samples) -> Clock:
        if id(samples) not in known:
            known[id(samples)] = Clock((start, _digest(samples)), samples, start, name)
        return known[id(samples)]

    columns = []
    for channel, samples in table.channels.items():
        if channel == TIME:
            continue
        # the format's clock under the name that the file gives it is no second channel
        if made is not None and is_time_name(channel) and _equal(samples, made):
            continue
        mine = table.times.get(channel, times)
        fits = mine is not None and len(mine) == len(samples)
        columns.append(Column(channel, samples, name, clock(mine) if fits and mine is not None else None))
    return columns, None if times is None else clock(times)


def aligned(
    clocks: Mapping[Key, Clock], leading: Collection[Key]
) -> tuple[datetime | None, dict[Key, float], dict[Key, str]]:
    """The instant from which the record counts, each clock's distance to it [s], and why others have none.

    Parameters
    ----------
    clocks
        All of them.
    leading
        Those that carry the record's own channels: they say from where it counts.
    """
    stated = _most_certain(clocks[key] for key in leading)
    if not stated:
        why = "its table counts from an instant, the record's own channels do not"
        return (
            None,
            {key: 0.0 for key in clocks if key[0] is None},
            {key: why for key in clocks if key[0] is not None},
        )
    origin = min(start for clock in stated if (start := clock.start) is not None)
    offsets, lost = {}, {}
    for key, clock in clocks.items():
        if clock.start is not None and _certainty(clock.start) == _certainty(origin):
            offsets[key] = (clock.start - origin).total_seconds()
    by_digest = {key[1]: offset for key, offset in offsets.items()}
    for key, clock in clocks.items():
        if key in offsets:
            continue
        if key[1] in by_digest:  # the very times of a clock that does say its start
            offsets[key] = by_digest[key[1]]
        else:
            what = (
                "no instant" if clock.start is None else f"{clock.start.isoformat()}, which cannot be set beside that"
            )
            others = _names(clock.table for clock in stated)
            lost[key] = (
                f"the times of table {others} start at a known instant, those of its table {clock.table} at {what}"
            )
    return origin, offsets, lost


def table_names(tables: Sequence[Table]) -> list[str]:
    """What to call each table: as the file does, else by its place."""
    return [repr(table.name) if table.name else f"number {i + 1}" for i, table in enumerate(tables)]


def _most_certain(clocks: Iterable[Clock]) -> list[Clock]:
    """Of the clocks that state a start those whose statement is worth most."""
    stating = [(start, clock) for clock in clocks if (start := clock.start) is not None]
    best = max((_certainty(start) for start, _ in stating), default=0)
    return sorted((c for start, c in stating if _certainty(start) == best), key=lambda clock: clock.table)


def _certainty(start: datetime) -> int:
    """3 for an instant, 2 without a zone, 1 and 0 for what a recorder counts from when nobody has set its clock."""
    return 2 * (start.year >= EARLIEST_YEAR) + (start.tzinfo is not None)


def _names(names: Iterable[str]) -> str:
    found = list(dict.fromkeys(names))
    return ", ".join(found[:3]) + (f" and {len(found) - 3} more" if len(found) > 3 else "")


def _digest(samples: Samples) -> bytes:
    return hashlib.blake2b(np.ascontiguousarray(samples).data, digest_size=16).digest()


def _equal(one: Samples, other: Samples) -> bool:
    return len(one) == len(other) > 0 and one[0] == other[0] and one[-1] == other[-1] and np.array_equal(one, other)


def _same_but_for_zero(own: Samples, made: Samples) -> bool:
    if len(own) != len(made) or not len(own):
        return False
    apart = own - made
    return bool(np.all(np.abs(apart - apart[0]) <= 1e-9 * (1.0 + np.abs(made))))
