"""Which columns of a file seem to be its time: seconds, counts, instants, or a date, a time of day and an offset apart."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, TypedDict

import numpy as np

from service.ingest.behaviour import GUESSES, seen
from service.ingest.channel_words import spoken_for, unit_in
from service.ingest.conversion import conversion
from service.ingest.file_units import unit_of_file
from service.ingest.instants import EPOCHS, Reading, instants_of
from service.ingest.raw import RawFile, Table
from service.ingest.zones import zone_of
from twin.parameters import PumpType
from twin.pumps import PUMP_TYPES
from twin.recording import TIME

_KIND: PumpType = next(iter(PUMP_TYPES.values()))
_LOOKED_AT = 200
_MOST_FAULTS = 0.1
_EARLIEST, _LATEST = 6.3e8, 4.1e9
"""1990 and 2099 in seconds from 1970."""


class TimeColumns(TypedDict, total=False):
    """A mapping's rule for instants, as far as it was found: columns, and how they are read."""

    source: str
    date: str
    time: str
    offset: str
    format: str
    zone: str
    day_first: bool


class ChannelFound(TypedDict, total=False):
    """A mapping's rule for a channel, as far as it was found."""

    source: str
    channel: str
    scale: float
    unit: str | None
    table: str


@dataclass(slots=True)
class TimeFound:
    """What seems to be the time.

    Attributes
    ----------
    rule, channel
        As a mapping says it; both None where the file's own clock or nothing is it.
    columns
        Columns that it takes.
    by_format
        What it is where the format has a clock of its own.
    certainty
        A share, 0 to 1.
    says_start
        Whether it has a date, and so says ``started_at``.
    """

    rule: TimeColumns | None = None
    channel: ChannelFound | None = None
    columns: tuple[str, ...] = ()
    by_format: str | None = None
    certainty: float = 0.0
    says_start: bool = False
    notes: list[str] = field(default_factory=list)


def time_of(file: RawFile, told: list[str]) -> TimeFound:
    """The time of a file; what a person has to say goes into ``told``."""
    tables = [t for t in file.tables if t.channels or t.texts]
    if any(TIME in t.channels for t in tables):
        return TimeFound(None, {"source": TIME}, (TIME,), None, 0.99, False, ["time_s is in the file"])
    table = max(tables, key=lambda t: len(t.channels), default=None)
    for look in (_instants, _counts):
        found = None if table is None else look(table, told)
        if found is not None:
            return found
    if any(t.time is not None for t in tables):
        dated = any(t.start is not None for t in tables)
        return TimeFound(
            by_format="the format's own clock", certainty=0.99, says_start=dated, notes=["the file has its own clock"]
        )
    found = None if table is None else _numbers(table)
    if found is not None:
        return found
    told.append("no column seems to be the time: name it in `time`, or map one to time_s")
    return TimeFound()


def _sample(column: Sequence[Any]) -> list[Any]:
    return list(column[:_LOOKED_AT])


def _reads(columns: Sequence[Sequence[Any]], reading: Reading) -> tuple[bool, bool]:
    """Whether nearly all rows are instants, and whether these have a date."""
    cells = [_sample(column) for column in columns]
    n = sum(all(cell is not None for cell in row) for row in zip(*cells, strict=True))
    found = instants_of(cells, reading, "")
    good = int(np.isfinite(found.seconds).sum())
    return good >= 2 and good >= (1.0 - _MOST_FAULTS) * n and len(
        set(found.seconds[np.isfinite(found.seconds)])
    ) > 1, found.dated


def _instants(table: Table, told: list[str]) -> TimeFound | None:
    """Time from columns of text."""
    zone = zone_of("UTC")
    for day_first in (None, True):
        reading = Reading(None, zone, day_first)
        kinds = {name: _kind_of(column, reading) for name, column in table.texts.items()}
        rule: TimeColumns | None = None
        whole = [name for name, kind in kinds.items() if kind == "instant"]
        clocks = [name for name, kind in kinds.items() if kind == "clock"]
        dates = [name for name, kind in kinds.items() if kind == "date"]
        offsets = [name for name, kind in kinds.items() if kind == "offset"]
        if whole:
            rule = {"source": _best(whole)}
        elif clocks and dates:
            rule = {"date": dates[0], "time": _best(clocks)}
            if offsets:
                rule["offset"] = offsets[0]
        elif clocks and day_first:
            rule = {"source": _best(clocks), "zone": "UTC"}
            told.append("times of day name no zone: UTC is a guess, say which it is in the mapping's `time`")
        if rule is not None:
            return _timed(table, rule, day_first, bool(whole or dates), told)
    return None


def _best(names: Sequence[str]) -> str:
    return max(names, key=lambda name: spoken_for(name, TIME))


def _timed(table: Table, rule: TimeColumns, day_first: bool | None, dated: bool, told: list[str]) -> TimeFound:
    columns = tuple(str(value) for name, value in rule.items() if name != "zone")
    notes = [f"the time is in {' and '.join(columns)}" + ("" if dated else ", without a date")]
    certainty = 0.95 if dated else 0.8
    found = instants_of([_sample(table.texts[name]) for name in columns], Reading(None, None, day_first), "")
    if dated and any("zone" in fault.problem for fault in found.faults):
        rule = {**rule, "zone": "UTC"}
        told.append("the instants name no zone: UTC is a guess, say which it is in the mapping's `time`")
        certainty = 0.7
    if day_first and dated:
        rule = {**rule, "day_first": True}
        example = table.texts[columns[0]][0]
        told.append(f"dates such as {example} may be day first or month first: day first is a guess")
        certainty = 0.5
    notes += found.flags
    return TimeFound(rule, None, columns, None, certainty, dated, notes)


def _kind_of(column: Sequence[str | None], reading: Reading) -> str | None:
    cells = [cell for cell in _sample(column) if cell is not None]
    if not cells:
        return None
    texts = [str(cell).strip() for cell in cells]
    if all(len(t) in (3, 5, 6) and t[0] in "+-" and t[1:].replace(":", "").isdigit() for t in texts):
        return "offset"
    found = instants_of([texts], reading, "")
    good = np.isfinite(found.seconds)
    if good.sum() < (1.0 - _MOST_FAULTS) * len(texts) or not good.any():
        return None
    if not found.dated:
        return "clock" if all(":" in t for t in texts) else None
    return "instant" if sum(":" in t for t in texts) > len(texts) / 2 or any("T" in t for t in texts) else "date"


def _counts(table: Table, _told: list[str]) -> TimeFound | None:
    """Time from counts since 1970."""
    for name, samples in table.channels.items():
        known = samples[np.isfinite(samples)]
        if len(known) < 2 or known[-1] <= known[0] or (np.diff(known) < 0.0).mean() > 0.02:
            continue
        form = next((f for f, unit in EPOCHS.items() if _EARLIEST < known[0] * unit < _LATEST), None)
        if form is not None and known[0] * EPOCHS[form] + 48.0 * 3600.0 > known[-1] * EPOCHS[form]:
            rule: TimeColumns = {"source": name, "format": form}
            return TimeFound(
                rule, None, (name,), None, 0.9, True, [f"{name} counts since 1970 ({form.partition('_')[2]})"]
            )
    return None


def _numbers(table: Table) -> TimeFound | None:
    """Time from a column that increases, in the unit that its name says or that makes sense of its steps."""
    best: TimeFound | None = None
    for name, samples in table.channels.items():
        spoken, stated = spoken_for(name, TIME), table.units.get(name) or unit_in(name)
        of_file = unit_of_file(stated, TIME)
        units = [stated] if of_file is not None else list(GUESSES[TIME])
        scored = [
            (u, seen(TIME, conversion(u, TIME).applied(samples), np.ones(len(samples), dtype=bool), _KIND))
            for u in units
        ]
        unit, behaviour = max(scored, key=lambda pair: pair[1].fits)
        if behaviour.fits <= 0.0:
            continue
        certainty = min(0.95, 0.4 * spoken + 0.3 * behaviour.fits + (0.4 if of_file is not None else 0.0))
        if best is None or certainty > best.certainty:
            note = f"{name} {behaviour.what}" + ("" if of_file is not None else f" if it is in {unit}")
            channel: ChannelFound = {"source": name, "channel": TIME, "unit": unit}
            best = TimeFound(None, channel, (name,), None, certainty, False, [note])
    return best
