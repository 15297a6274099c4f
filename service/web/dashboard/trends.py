"""The trends of a pump page: over a time or flight hours, with events, the sibling and the fleet; and what a link to them says."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Annotated, Literal, TypedDict

import numpy as np
from fastapi import Depends, Query
from markupsafe import Markup
from numpy.typing import NDArray
from sqlalchemy import ColumnElement, select
from sqlalchemy.orm import Session

from service.access.security import EVERYBODY, Principal
from service.answers.pumps import TrendPoint
from service.errors import Fault, Invalid
from service.reading import queries
from service.reading.by_link import ByLink
from service.reading.events import Entered, PumpEvent, events_of
from service.reading.pump_history import SHOWN, PumpHistory, history_of
from service.reading.trend import METRICS, ZERO, kept_places, newest_values
from service.reports.trend_chart import LETTERS, Series, TrendChart, chart_svg
from service.reports.words import ACTION_WORDS, ESTIMATE_NAMES, WORDS
from service.storage.tables import Pump, StoredAssessment
from service.units import UnitSystem
from service.web.dashboard.forms import instant_of
from service.web.dashboard.links import address, api_address

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
_kept_newest: ByLink[Mapping[str, float]] = ByLink(5000)


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


class ShownTrend(TypedDict):
    """A chart with its newest values as a table, how many more there are, and the address of all of them."""

    metric: str
    title: str
    unit: str
    svg: Markup
    items: list[TrendPoint]
    more: int
    data: str


class ShownEvent(TypedDict):
    """An event with the letter that stands over it."""

    at: str
    letter: str
    kind: str
    what: str
    note: str | None


class Trends(TypedDict):
    """The section of trends: charts, events, ends of the axis (s since 1970 or flight hours), links to other looks."""

    charts: list[ShownTrend]
    look: Look
    events: list[ShownEvent]
    start: float
    end: float
    fields: tuple[str, str]
    chips: list[tuple[str, str, bool]]
    compared: dict[str, str]
    has_sibling: bool
    has_fleet: bool
    zoom: str
    whole: str | None
    letters: Mapping[str, str]


def trends_of_page(
    session: Session,
    reader: tuple[Principal, UnitSystem],
    row: Pump,
    look: Look,
    thresholds: Mapping[str, float],
    entered: Entered,
) -> Trends:
    """Everything that the section of trends shows, in the reader's units; ``thresholds`` and ``entered`` are the pump's now.

    Raises
    ------
    Invalid
        with every end that cannot be read, or where they lie the wrong way round.
    """
    asker, system = reader
    whole = history_of(session, row)
    ends = _ends(look, whole.instant(-1) if len(whole) else datetime.now(UTC))
    seen = whole.between(ends.since, ends.until)
    if look.in_hours:
        seen = seen.taken(_with_hours(seen, ends))
    events = events_of(session, row, entered, seen, *_inside(seen, ends))
    axis = _Axis(look.in_hours, seen)
    sibling = _sibling(session, row, whole, seen) if look.compare in ("", "sibling", "both") else []
    bands = _bands(session, asker, row) if look.compare in ("fleet", "both") else {}
    limit = thresholds["case_flow_limit_lpm"]
    marked = [(axis.of(e.at), e.kind) for e in events]
    start, end = axis.ends(ends)
    charts = []
    for metric in SHOWN:
        places = seen.with_value(metric)
        if not len(places) and not look.is_zoomed:
            continue
        chart = TrendChart(
            title=_NAMES.get(metric) or metric.rsplit("_", 1)[0].replace("_", " "),
            unit=system.word(METRICS[metric]),
            own=axis.series([(seen, places)], metric),
            start=start,
            end=end,
            in_hours=look.in_hours,
            limit=limit if metric == "case_flow_at_reference_lpm" else None,
            sibling=axis.series([(part, part.with_value(metric)) for part in sibling], metric, False),
            band=bands.get(metric),
            events=marked,
            scale=system.scale(METRICS[metric]),
        )
        charts.append(_shown(row, metric, chart, seen, places))
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


def _with_hours(seen: PumpHistory, ends: _Ends) -> NDArray[np.intp]:
    """Places of the records whose flight hours are known and lie within the ends."""
    low = -np.inf if ends.low_h is None else ends.low_h
    high = np.inf if ends.high_h is None else ends.high_h
    return np.flatnonzero((seen.flight_hours >= low) & (seen.flight_hours <= high))


def _inside(seen: PumpHistory, ends: _Ends) -> tuple[datetime | None, datetime | None]:
    """Time within which events are told; over flight hours that of the records seen."""
    if ends.low_h is None and ends.high_h is None:
        return ends.since, ends.until
    if not len(seen):
        return datetime.max.replace(tzinfo=UTC), None
    return seen.instant(0), seen.instant(-1) + timedelta(seconds=1)


class _Axis:
    """Where an event time lies on the horizontal axis: seconds since 1970, or the flight hours of the records seen."""

    def __init__(self, in_hours: bool, seen: PumpHistory) -> None:
        self._in_hours = in_hours
        self._at = seen.at
        self._hours = seen.flight_hours if in_hours else seen.at

    def of(self, at: datetime) -> float:
        """Place of an event time; between two flights what lies between their hours."""
        if not self._in_hours:
            return at.timestamp()
        return float(np.interp(at.timestamp(), self._at, self._hours)) if len(self._at) else 0.0

    def series(
        self, parts: Sequence[tuple[PumpHistory, NDArray[np.intp]]], metric: str, with_interval: bool = True
    ) -> Series:
        """A metric at some places of histories, in event order and thinned, on this axis."""
        if not parts:
            return Series([], [])
        at = np.concatenate([history.at[places] for history, places in parts])
        numbers = np.concatenate([history.numbers[metric][places] for history, places in parts])
        order = np.argsort(at, kind="stable")
        kept = order[kept_places(numbers[order, 0], _POINTS)]
        x = np.interp(at[kept], self._at, self._hours) if self._in_hours and len(self._at) else at[kept]
        value, low, high = (column.tolist() for column in numbers[kept].T)
        return Series(x.tolist(), value, low, high) if with_interval else Series(x.tolist(), value)

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


def _sibling(session: Session, row: Pump, whole: PumpHistory, seen: PumpHistory) -> list[PumpHistory]:
    """Records of the other positions of the aircraft in which the pump sat last, over the same time, pump by pump."""
    if not len(seen):
        return []
    kept, aircraft, position = StoredAssessment, whole.aircraft[-1], whole.position[-1]
    since, until = seen.instant(0), seen.instant(-1) + timedelta(seconds=1)
    # pump by pump, the first that is found: an aircraft's records grow with its life
    there = select(kept.pump_id).where(kept.aircraft == aircraft, kept.pump_id == Pump.id, kept.position != position)
    there = there.where(kept.at >= since, kept.at < until).limit(1).correlate(Pump)
    others = queries.listed(session, EVERYBODY, there.scalar_subquery().is_not(None), Pump.id != row.id, *_alike(row))
    found = []
    for other in others:
        part = history_of(session, other).between(since, until)
        pairs = enumerate(zip(part.aircraft, part.position, strict=True))
        found.append(part.taken([i for i, (a, p) in pairs if a == aircraft and p != position]))
    return found


def _alike(row: Pump) -> tuple[ColumnElement[bool], ...]:
    return Pump.operator == row.operator, Pump.pump_type == row.pump_type


def _bands(session: Session, asker: Principal, row: Pump) -> dict[str, tuple[float, float]]:
    """Middle of the newest values of the other pumps of the type, by metric; none of fewer than five pumps."""
    others = queries.listed(session, asker, Pump.pump_type == row.pump_type, Pump.id != row.id)
    newest = list(_kept_newest.of(session, others, lambda ids: newest_values(session, ids, SHOWN)).values())
    found = {}
    for metric in SHOWN:
        values = [values[metric] for values in newest if metric in values]
        if len(values) >= 5:
            low, high = np.quantile(values, _MIDDLE)
            found[metric] = (float(low), float(high))
    return found


def _shown(row: Pump, metric: str, chart: TrendChart, seen: PumpHistory, places: NDArray[np.intp]) -> ShownTrend:
    data = api_address(
        "pumps", row.serial, "trend", query={"metric": metric, "operator": row.operator, "points": 10_000}
    )
    return {
        "metric": metric,
        "title": chart.title,
        "unit": METRICS[metric],
        "svg": Markup(chart_svg(chart)),  # noqa: S704 - made by us
        "items": [seen.point(metric, i) for i in places[::-1][:_ROWS].tolist()],
        "more": max(len(places) - _ROWS, 0),
        "data": data,
    }


def _event(event: PumpEvent) -> ShownEvent:
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
