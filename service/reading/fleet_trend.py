"""Trends of a whole fleet, by pump type, operator, position, aircraft or age, thinned without losing extremes.

Over whole histories a pump's own points, thinned, are kept in this process: a later question reads only pumps whose history
has changed.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import groupby
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Select, select
from sqlalchemy.orm import Session

from service.access.security import Principal
from service.answers.fleet import FleetTrendPoint, TrendGroup
from service.answers.words import instant
from service.reading import queries
from service.reading.by_link import ByLink
from service.reading.queries import Listed
from service.reading.trend import between, kept_places, numbers_of
from service.storage.among import among
from service.storage.tables import Pump, Record, StoredAssessment

GroupBy = Literal["pump_type", "operator", "position", "aircraft", "age"]
AGE_BAND_H = 500
"""Flight hours of a pump that one group of the same age holds."""
_ROWS_AT_ONCE = 2000
"""Rows that a stream fetches at once (our choice)."""
_PUMPS_AT_ONCE = 200
"""Pumps of one statement: histories that nobody has asked for yet may take longer than a statement may (our choice)."""
_PER_PUMP = 120
"""Points of one pump that a trend over whole histories is made of: a fleet's trend shows fewer of each (our choice)."""
_MOST = 12_000
"""Pumps by metric that a process remembers (our choice: some 15 kB each)."""
Numbers = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class _PumpTrend:
    """One pump's points in event order; ``at`` in seconds since 1970, flight hours NaN where nobody said."""

    at: Numbers
    value: Numbers
    low: Numbers
    high: Numbers
    flight_hours: Numbers
    record_id: Sequence[str]
    aircraft: Sequence[str]
    position: Sequence[str]


_kept: ByLink[_PumpTrend] = ByLink(_MOST)


def fleet_trend(
    session: Session,
    principal: Principal,
    metric: str,
    group_by: GroupBy,
    since: datetime | None,
    until: datetime | None,
    most: int,
) -> list[TrendGroup]:
    """Points of one metric in event order for each group, at most about ``most`` in each.

    By age a pump passes from group to group as it flies: what pumps of the same flight hours show lies together. Over
    whole histories of many records each pump takes part with the lowest and the highest of its own stretches.
    """
    pumps = queries.listed(session, principal)
    if since is None and until is None:
        found = _remembered(session, pumps, metric)
    else:
        query = between(_points(metric), since, until)
        if principal.operator is not None:
            query = query.join(Pump, Pump.id == StoredAssessment.pump_id).where(Pump.operator == principal.operator)
        found = dict(_read(session, query))
    groups: dict[tuple[float, str], list[tuple[Listed, _PumpTrend, NDArray[np.intp]]]] = {}
    for pump in pumps:
        if pump.id in found:
            for name, places in _groups(pump, found[pump.id], group_by):
                groups.setdefault(name, []).append((pump, found[pump.id], places))
    return [_group(name, parts, most) for (_, name), parts in sorted(groups.items(), key=lambda item: item[0])]


def _points(metric: str) -> Select[*tuple[Any, ...]]:
    kept = StoredAssessment
    columns = (kept.pump_id, kept.at, kept.record_id, kept.aircraft, kept.position, Record.flight_hours)
    query = select(*columns, *numbers_of(metric)).join(Record, Record.id == kept.record_id)
    return query.order_by(kept.pump_id, kept.at, kept.record_id)


def _read(session: Session, query: Select[*tuple[Any, ...]]) -> Iterator[tuple[int, _PumpTrend]]:
    """Every point of the pumps of a query, which is in their order."""
    rows = session.execute(query.execution_options(yield_per=_ROWS_AT_ONCE))
    for pump_id, group in groupby(rows, key=lambda row: row[0]):
        held = [row for row in group if None not in row[6:9]]
        if held:
            _, at, record_id, aircraft, position, hours, value, low, high = zip(*held, strict=True)
            ages = np.array([math.nan if h is None else h for h in hours])
            instants = np.array([t.timestamp() for t in at])
            numbers = (np.array(value, float), np.array(low, float), np.array(high, float))
            yield pump_id, _PumpTrend(instants, *numbers, ages, record_id, aircraft, position)


def _remembered(session: Session, pumps: Sequence[Listed], metric: str) -> dict[int, _PumpTrend]:
    """Thinned points of pumps over their whole history, read where no earlier question has."""

    def read(pump_ids: list[int]) -> dict[int, _PumpTrend]:
        found: dict[int, _PumpTrend] = {}
        for start in range(0, len(pump_ids), _PUMPS_AT_ONCE):
            query = _points(metric).where(among(StoredAssessment.pump_id, pump_ids[start : start + _PUMPS_AT_ONCE]))
            found |= {i: _thinned(trend) for i, trend in _read(session, query)}
        return found

    return _kept.of(session, pumps, read, metric)


def _thinned(trend: _PumpTrend) -> _PumpTrend:
    places = kept_places(trend.value, _PER_PUMP)
    return _PumpTrend(
        at=trend.at[places],
        value=trend.value[places],
        low=trend.low[places],
        high=trend.high[places],
        flight_hours=trend.flight_hours[places],
        record_id=[trend.record_id[i] for i in places],
        aircraft=[trend.aircraft[i] for i in places],
        position=[trend.position[i] for i in places],
    )


def _groups(pump: Listed, trend: _PumpTrend, group_by: GroupBy) -> Iterator[tuple[tuple[float, str], NDArray[np.intp]]]:
    """Groups that a pump takes part in, with the places of its points in each."""
    if group_by in ("pump_type", "operator"):
        yield (0.0, getattr(pump, group_by)), np.arange(len(trend.at))
        return
    names: Iterable[tuple[float, str]]
    if group_by == "age":
        names = [_age_band(None if math.isnan(h) else h) for h in trend.flight_hours.tolist()]
    else:
        names = [(0.0, word or "") for word in (trend.aircraft if group_by == "aircraft" else trend.position)]
    places: dict[tuple[float, str], list[int]] = {}
    for i, name in enumerate(names):
        places.setdefault(name, []).append(i)
    yield from ((name, np.array(held)) for name, held in places.items())


def _group(name: str, parts: Sequence[tuple[Listed, _PumpTrend, NDArray[np.intp]]], most: int) -> TrendGroup:
    at = np.concatenate([trend.at[places] for _, trend, places in parts])
    owner = np.repeat(np.arange(len(parts)), [len(places) for _, _, places in parts])
    place = np.concatenate([places for _, _, places in parts])
    order = np.argsort(at, kind="stable")
    values = np.concatenate([trend.value[places] for _, trend, places in parts])[order]
    chosen = [(parts[owner[k]], int(place[k])) for k in order[kept_places(values, most)]]
    items = [_item(pump, trend, i) for (pump, trend, _), i in chosen]
    return {"group": name, "pumps": len(parts), "items": items}


def _item(pump: Listed, trend: _PumpTrend, i: int) -> FleetTrendPoint:
    return {
        "at": instant(datetime.fromtimestamp(float(trend.at[i]), tz=UTC)),
        "value": float(trend.value[i]),
        "low": float(trend.low[i]),
        "high": float(trend.high[i]),
        "record_id": trend.record_id[i],
        "pump_serial": pump.serial,
        "operator": pump.operator,
    }


def _age_band(flight_hours: float | None) -> tuple[float, str]:
    """Where an age stands among the groups, and its name; pumps of unknown age come last."""
    if flight_hours is None:
        return math.inf, "unknown"
    first = AGE_BAND_H * int(flight_hours // AGE_BAND_H)
    return first, f"{first} to {first + AGE_BAND_H} h"
