"""The trends of a pump page: over a time or flight hours, with events, the sibling and the fleet; and what a link to them says."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Annotated, Any, Literal

import numpy as np
from fastapi import Depends, Query
from markupsafe import Markup
from sqlalchemy import select
from sqlalchemy.orm import Session

from service.access.security import Principal
from service.answers.pumps import TrendPoint
from service.errors import Fault, Invalid
from service.reading import queries
from service.reading.events import PumpEvent, events_of
from service.reading.trend import METRICS, ZERO, SeenRecord, records_seen, thinned
from service.reports.trend_chart import LETTERS, Series, TrendChart, chart_svg
from service.reports.words import ACTION_WORDS, ESTIMATE_NAMES, WORDS
from service.storage.tables import Pump, StoredAssessment
from service.thresholds.layers import thresholds_of
from service.units import UnitSystem
from service.web.dashboard.forms import instant_of
from service.web.dashboard.links import address, api_address

SHOWN = (
    "case_flow_at_reference_lpm",
    "pump_leakage_change_lpm",
    "case_residual_bar",
    "discharge_residual_bar",
    "system_leakage_change_lpm",
    "drain_resistance_change_percent",
    ZERO,
)
_NAMES = {**ESTIMATE_NAMES, ZERO: "zero of the case sensor"}
_POINTS = 240
"""Most points of a line: one for each three pixels (our choice)."""
_ROWS = 40
"""Newest values in the table under a chart; its link leads to all of them."""
_SPANS = {"30": "30 days", "90": "90 days", "all": "all"}
_USUAL = "90"
_MIDDLE = (0.1, 0.9)
"""Quantiles of the fleet's newest values that its band lies between."""
_KINDS = {
    "exchange": "exchange",
    "maintenance": "maintenance",
    "finding": "finding",
    "alarm": "alarm",
    "baseline": "baseline",
    "thresholds": "thresholds",
}
_DAY_S = 86_400.0


@dataclass(frozen=True, slots=True)
class Look:
    """What of the trends is looked at, in the words of the page's address; ends are days or flight hours."""

    span: Annotated[Literal["30", "90", "all", ""], Query(alias="range")] = ""
    axis: Literal["time", "hours", ""] = ""
    start: Annotated[str, Query(alias="from", max_length=40)] = ""
    end: Annotated[str, Query(alias="to", max_length=40)] = ""
    compare: Literal["none", "sibling", "fleet", "both", ""] = ""

    @property
    def in_hours(self) -> bool:
        return self.axis == "hours"

    @property
    def is_zoomed(self) -> bool:
        return bool(self.start or self.end)

    def query(self, **changed: str | None) -> dict[str, str | None]:
        """The same look with some of it changed, as parts of an address."""
        held = {"range": self.span, "axis": self.axis, "from": self.start, "to": self.end, "compare": self.compare}
        return {**held, **changed}


Looked = Annotated[Look, Depends()]


@dataclass(frozen=True, slots=True)
class _Ends:
    """Ends of what is seen: in time, and on the axis where that is flight hours; None is open."""

    since: datetime | None = None
    until: datetime | None = None
    low_h: float | None = None
    high_h: float | None = None


def trends_of_page(session: Session, asker: Principal, row: Pump, look: Look, system: UnitSystem) -> dict[str, Any]:
    """Everything that the section of trends shows, in the reader's units where it is drawn.

    Raises
    ------
    Invalid
        with every end that cannot be read, or where they lie the wrong way round.
    """
    newest = queries.newest_assessments(session, row.id, 1)
    ends = _ends(look, newest[-1].at if newest else datetime.now(UTC))
    seen = records_seen(session, StoredAssessment.pump_id == row.id, ends.since, ends.until)
    seen = [r for r in seen if not look.in_hours or _has_hours(r, ends)]
    events = events_of(session, row, seen, *_inside(seen, ends))
    axis = _Axis(look.in_hours, seen)
    sibling = _sibling(session, row, newest, seen) if look.compare in ("", "sibling", "both") else []
    bands = _bands(session, asker, row) if look.compare in ("fleet", "both") else {}
    limit = thresholds_of(session, row.operator, row.serial, row.pump_type).values["case_flow_limit_lpm"]
    marked = [(axis.of(e.at), e.kind) for e in events]
    start, end = axis.ends(ends)
    charts = []
    for metric in SHOWN:
        items = [p for r in seen if (p := r.point(metric)) is not None]
        if not items and not look.is_zoomed:
            continue
        chart = TrendChart(
            title=_NAMES.get(metric) or metric.rsplit("_", 1)[0].replace("_", " "),
            unit=system.word(METRICS[metric]),
            own=axis.series(thinned(items, _POINTS)),
            start=start,
            end=end,
            in_hours=look.in_hours,
            limit=limit if metric == "case_flow_at_reference_lpm" else None,
            sibling=axis.series(thinned([p for r in sibling if (p := r.point(metric)) is not None], _POINTS), False),
            band=bands.get(metric),
            events=marked,
            scale=system.scale(METRICS[metric]),
        )
        charts.append(_shown(row, metric, chart, items))
    return {
        "charts": charts,
        "look": look,
        "events": [_event(e) for e in events],
        "start": start,
        "end": end,
        "fields": _fields(look, start, end),
        "chips": _chips(row, look),
        "compared": {name: _link(row, look.query(compare=name)) for name in ("none", "sibling", "fleet", "both")},
        "has_sibling": bool(sibling),
        "has_fleet": bool(bands),
        "zoom": _link(row, look.query(**{"from": "FROM", "to": "TO"})),
        "whole": _link(row, look.query(**{"from": None, "to": None})) if look.is_zoomed else None,
        "letters": LETTERS,
    }


def _ends(look: Look, last: datetime) -> _Ends:
    if look.in_hours and look.is_zoomed:
        return _hours(look)
    since = None if (look.span or _USUAL) == "all" else last - timedelta(days=int(look.span or _USUAL))
    if not look.is_zoomed:
        return _Ends(since)
    ends = [instant_of(text, name) if text else None for name, text in (("from", look.start), ("to", look.end))]
    if ends[0] is not None and ends[1] is not None and ends[1] <= ends[0]:
        raise Invalid("the time is empty", [Fault("to", "does not lie after from")])
    return _Ends(ends[0], ends[1])


def _hours(look: Look) -> _Ends:
    found, faults = [], []
    for name, text in (("from", look.start), ("to", look.end)):
        try:
            found.append(float(text) if text else None)
        except ValueError:
            faults.append(Fault(name, "is no number of flight hours"))
    if not faults and found[0] is not None and found[1] is not None and not found[0] < found[1]:
        faults.append(Fault("to", "does not lie after from"))
    if faults:
        raise Invalid("the flight hours cannot be read", faults)
    return _Ends(None, None, found[0], found[1])


def _has_hours(record: SeenRecord, ends: _Ends) -> bool:
    hours = record.flight_hours
    if hours is None:
        return False
    return (ends.low_h is None or hours >= ends.low_h) and (ends.high_h is None or hours <= ends.high_h)


def _inside(seen: Sequence[SeenRecord], ends: _Ends) -> tuple[datetime | None, datetime | None]:
    """Time within which events are told; over flight hours that of the records seen."""
    if ends.low_h is None and ends.high_h is None:
        return ends.since, ends.until
    if not seen:
        return datetime.max.replace(tzinfo=UTC), None
    return seen[0].at, seen[-1].at + timedelta(seconds=1)


class _Axis:
    """Where an event time lies on the horizontal axis: seconds since 1970, or the flight hours of the records seen."""

    def __init__(self, in_hours: bool, seen: Sequence[SeenRecord]) -> None:
        self._in_hours = in_hours
        self._at = np.array([r.at.timestamp() for r in seen])
        self._hours = np.array([r.flight_hours or 0.0 for r in seen]) if in_hours else self._at

    def of(self, at: datetime) -> float:
        """Place of an event time; between two flights what lies between their hours."""
        if not self._in_hours:
            return at.timestamp()
        return float(np.interp(at.timestamp(), self._at, self._hours)) if len(self._at) else 0.0

    def series(self, items: Sequence[TrendPoint], with_interval: bool = True) -> Series:
        """Points of a trend on this axis."""
        x = [self.of(datetime.fromisoformat(item["at"])) for item in items]
        if not with_interval:
            return Series(x, [i["value"] for i in items])
        return Series(x, [i["value"] for i in items], [i["low"] for i in items], [i["high"] for i in items])

    def ends(self, ends: _Ends) -> tuple[float, float]:
        """What the charts show: what was asked for, else the records with a margin."""
        held = self._hours if len(self._hours) else np.array([datetime.now(UTC).timestamp()])
        margin = max(0.02 * float(np.ptp(held)), 1.0 if self._in_hours else 0.5 * _DAY_S)
        asked: tuple[float | None, float | None] = (
            (ends.low_h, ends.high_h)
            if self._in_hours
            else (None, None if ends.until is None else ends.until.timestamp())
        )
        if not self._in_hours and ends.since is not None and (ends.until is not None or held[0] > held[-1]):
            asked = (ends.since.timestamp(), asked[1])
        low = float(held.min()) - margin if asked[0] is None else asked[0]
        high = float(held.max()) + margin if asked[1] is None else asked[1]
        return low, max(high, low + 1e-3)


def _sibling(
    session: Session, row: Pump, newest: Sequence[StoredAssessment], seen: Sequence[SeenRecord]
) -> list[SeenRecord]:
    """Records of the other positions of the aircraft in which the pump sat last, over the same time."""
    if not newest or not seen:
        return []
    kept, last = StoredAssessment, newest[-1]
    others = select(Pump.id).where(Pump.operator == row.operator, Pump.pump_type == row.pump_type, Pump.id != row.id)
    there = (kept.aircraft == last.aircraft) & (kept.position != last.position) & kept.pump_id.in_(others)
    return records_seen(session, there, seen[0].at, seen[-1].at + timedelta(seconds=1))


def _bands(session: Session, asker: Principal, row: Pump) -> dict[str, tuple[float, float]]:
    """Middle of the newest values of the other pumps of the type, by metric; none of fewer than five pumps."""
    wanted = queries.WantedPumps(pump_type=row.pump_type)
    ids = [p.id for p in session.scalars(queries.pumps(asker, None, wanted)) if p.id != row.id]
    newest = records_seen(session, StoredAssessment.record_id.in_(queries.newest_records(ids)))
    found = {}
    for metric in SHOWN:
        values = [p["value"] for r in newest if (p := r.point(metric)) is not None]
        if len(values) >= 5:
            low, high = np.quantile(values, _MIDDLE)
            found[metric] = (float(low), float(high))
    return found


def _shown(row: Pump, metric: str, chart: TrendChart, items: Sequence[TrendPoint]) -> dict[str, Any]:
    data = api_address(
        "pumps", row.serial, "trend", query={"metric": metric, "operator": row.operator, "points": 10_000}
    )
    return {
        "metric": metric,
        "title": chart.title,
        "unit": METRICS[metric],
        "svg": Markup(chart_svg(chart)),  # noqa: S704 - made by us
        "items": items[::-1][:_ROWS],
        "more": max(len(items) - _ROWS, 0),
        "data": data,
    }


def _event(event: PumpEvent) -> dict[str, str]:
    words = {**ACTION_WORDS, **WORDS, "no_fault_found": "No fault found"}
    return {
        "at": event.at.isoformat(),
        "letter": LETTERS[event.kind],
        "kind": _KINDS[event.kind],
        "what": words.get(event.what, event.what),
        "note": event.note,
    }


def _link(row: Pump, query: Mapping[str, str | None]) -> str:
    return address("pumps", row.serial, query={"operator": row.operator, **query}, place="trends")


def _chips(row: Pump, look: Look) -> list[tuple[str, str, bool]]:
    free: dict[str, str | None] = {"from": None, "to": None}
    span = look.span or _USUAL
    chips = [
        (word, _link(row, look.query(range=name, **free)), name == span and not look.is_zoomed)
        for name, word in _SPANS.items()
    ]
    over = [("over time", "time"), ("over flight hours", "hours")]
    chips += [(w, _link(row, look.query(axis=a, **free)), (a == "hours") == look.in_hours) for w, a in over]
    return chips


def _fields(look: Look, start: float, end: float) -> tuple[str, str]:
    """Ends of what is seen, as a form's fields have them."""
    if look.in_hours:
        return f"{start:.1f}", f"{end:.1f}"
    return tuple(f"{datetime.fromtimestamp(t, tz=UTC):%Y-%m-%dT%H:%M}" for t in (start, end))  # type: ignore[return-value]
