"""Time of a file's tables from their columns of instants; ``started_at`` is the first of all."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from service.errors import Fault
from service.ingest.instants import Instants, instants_of
from service.ingest.mapping import TimeRule
from service.ingest.raw import ForeignMetadata, RawFile, Samples, Table
from service.ingest.zones import zone_of
from twin.recording import TIME

_SAME_S = 1.0
_DATE = len("2026-05-02")


def with_time(file: RawFile, rule: TimeRule, note: Callable[[str, str], None]) -> RawFile:
    """The file with the clocks of its tables from instants, and ``started_at`` in its metadata."""
    faults, flags = list(file.faults), list(file.flags)
    found: dict[int, Instants] = {}
    for i, table in enumerate(file.tables):
        held: Mapping[str, Sequence[Any] | Samples] = {**table.channels, **table.texts}
        if not set(rule.columns) <= set(held):
            continue
        if TIME in table.channels and TIME not in rule.columns:
            text = "is in the file, and the mapping's time makes it as well: leave one of them out"
            faults.append(Fault(f"channels.{TIME}", text))
            continue
        found[i] = instants_of([held[name] for name in rule.columns], rule.reading, f"time.{'+'.join(rule.columns)}")
        faults += found[i].faults
        flags += found[i].flags
    if not found:
        names = list(dict.fromkeys(n for t in file.tables for n in (*t.channels, *t.texts)))
        lacking = [n for n in rule.columns if n not in names]
        if lacking:
            text = f"takes {', '.join(lacking)}, which the file has not; it has {', '.join(names[:20])}"
            faults.append(Fault("mapping.time", text))
        return replace(file, faults=faults, flags=flags)
    firsts = [float(np.nanmin(f.seconds)) for f in found.values() if np.isfinite(f.seconds).any()]
    first = min(firsts, default=math.nan)
    dated = any(f.dated for f in found.values())
    start = _instant(first) if dated else None
    metadata = dict(file.metadata)
    if start is not None:
        _told(metadata, start, flags)
        note("time", f"from {' and '.join(rule.columns)}; the first is {_written(start)}")
    elif not dated and math.isfinite(first):
        note("time", f"from {' and '.join(rule.columns)}, times of day without a date")
        _dated(metadata, rule, first)
    tables = tuple(
        _timed(table, found[i].seconds - first, start, rule) if i in found else table
        for i, table in enumerate(file.tables)
    )
    return replace(file, metadata=metadata, tables=tables, faults=faults, flags=list(dict.fromkeys(flags)))


def _timed(table: Table, seconds: Any, start: datetime | None, rule: TimeRule) -> Table:
    used = set(rule.columns)
    return replace(
        table,
        channels={n: v for n, v in table.channels.items() if n not in used},
        texts={n: v for n, v in table.texts.items() if n not in used},
        times={n: v for n, v in table.times.items() if n not in used},
        units={n: v for n, v in table.units.items() if n not in used},
        time=np.asarray(seconds),
        start=start,
    )


def _instant(seconds: float) -> datetime | None:
    try:
        return datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=round(seconds * 1e6))
    except (OverflowError, ValueError):
        return None


def _written(instant: datetime) -> str:
    return instant.isoformat().replace("+00:00", "Z")


def _told(metadata: ForeignMetadata, start: datetime, flags: list[str]) -> None:
    """The first instant is the start; what the file says otherwise is told."""
    said = metadata.get("started_at")
    metadata["started_at"] = _written(start)
    try:
        differs = said is not None and abs((datetime.fromisoformat(str(said)) - start).total_seconds()) > _SAME_S
    except (ValueError, TypeError):
        differs = True
    if differs:
        flags.append(f"the file says that it starts at {str(said)[:40]}, its instants begin at {_written(start)}")


def _dated(metadata: ForeignMetadata, rule: TimeRule, first: float) -> None:
    """A start that is a date alone, completed by the first time of day."""
    said = str(metadata.get("started_at", ""))
    if rule.zone is None or len(said) != _DATE:
        return
    try:
        day = datetime.fromisoformat(said)
    except ValueError:
        return
    local = (day + timedelta(seconds=first)).replace(tzinfo=zone_of(rule.zone))
    metadata["started_at"] = _written(local.astimezone(UTC))
