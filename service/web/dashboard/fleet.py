"""The fleet page: who needs attention, why and since when, in the order of the ranking; searched and narrowed."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response
from markupsafe import Markup, escape
from sqlalchemy.orm import Session

from service.answers.pumps import RankedPump, TrendPoint
from service.reading import queries
from service.reading.agreement import judged_findings, rates
from service.reading.by_link import ByLink
from service.reading.fleet import pumps_standing
from service.reading.queries import Listed
from service.reading.ranking import Ranked, in_order
from service.reports.charts import sparkline_svg
from service.reports.words import WORDS
from service.web.dashboard.frame import PageRoute, html_page
from service.web.dashboard.links import address, pump_address
from service.web.dashboard.preferences import system_of
from service.web.dependencies import Asker, ContextOf
from service.web.routes import pumps

fleet_router = APIRouter(include_in_schema=False, route_class=PageRoute)
_PUMPS_PER_PAGE = 100
_SPARK_RECORDS = 60
_LABEL = "@label@"


class _Row(RankedPump):
    """A pump's row: its page, its newest case flow [L/min] and their picture beside what the ranking says."""

    link: str
    flow: TrendPoint | None
    spark: Markup


@dataclass(frozen=True, slots=True)
class _Flow:
    """A pump's newest case flows as the page shows them: drawn once for every state of its history."""

    n: int
    newest: TrendPoint
    spark: str

    @classmethod
    def of(cls, items: Sequence[TrendPoint]) -> "_Flow":
        return cls(len(items), items[-1], sparkline_svg([i["value"] for i in items], _LABEL))


_kept_flows: ByLink[_Flow] = ByLink(5000)


@fleet_router.get("/", response_class=HTMLResponse)
def fleet_page(
    request: Request,
    context: ContextOf,
    asker: Asker,
    filters: pumps.Narrowed,
    search: str = "",
    page: int = 1,
) -> Response:
    """Pumps in the order of the ranking, a hundred a page; ``search`` looks into serials, aircraft and operators."""
    with context.database.reading() as session:
        rows = queries.listed(session, asker)
        everyone = in_order(session, rows, *pumps_standing(session, rows))
        wanted = [p for p in everyone if _fits(p, filters) and _found(p, search)]
        last = max(1, -(-len(wanted) // _PUMPS_PER_PAGE))
        page = min(max(page, 1), last)
        system = system_of(request)
        shown = [p.document(system) for p in wanted[(page - 1) * _PUMPS_PER_PAGE : page * _PUMPS_PER_PAGE]]
        flows = _flows(session, rows, shown)
        agreement = rates(judged_findings(session, asker))
    query = {
        "state": filters.state,
        "side": filters.side,
        "aircraft": filters.aircraft,
        "type": filters.type,
        "priority": filters.priority,
        "silent": None if filters.silent is None else str(filters.silent).lower(),
        "search": search,
    }
    states = Counter(p.pump["state"] for p in everyone)
    values = {
        "request": request,
        "pumps": [_shown(p, flows) for p in shown],
        "n_all": len(everyone),
        "filters": query,
        "is_narrowed": any(query.values()),
        "chips": [
            (f"{states[state]} {WORDS[state].lower()}", state, address(query={**query, "state": state}))
            for state in WORDS
            if state in states
        ],
        "all_link": address(query={**query, "state": None}),
        "silent_link": address(query={**query, "silent": "true"}),
        "n_silent": sum(p.pump["silent"] for p in everyone),
        "agreement": agreement,
        "page": page,
        "last_page": last,
        "newer": address(query={**query, "page": page - 1}),
        "older": address(query={**query, "page": page + 1}),
        "first_pump": (page - 1) * _PUMPS_PER_PAGE + 1,
        "n_pumps": len(wanted),
    }
    return html_page("fleet.html", 200, values)


def _fits(place: Ranked, filters: pumps.Filters) -> bool:
    """Whether a pump is among those that ``GET /pumps`` lists with these filters."""
    pump = place.pump
    held = (
        (filters.state, pump["state"]),
        (filters.side, pump["side"]),
        (filters.aircraft, pump["aircraft"]),
        (filters.type, pump["pump_type"]),
        (filters.priority, place.urgency),
        (filters.silent, pump["silent"]),
    )
    return all(wanted is None or wanted == value for wanted, value in held)


def _found(place: Ranked, search: str) -> bool:
    words = (place.pump["serial"], place.pump["aircraft"] or "", place.pump["operator"])
    return all(any(part in word.lower() for word in words) for part in search.lower().split())


def _flows(session: Session, rows: Sequence[Listed], shown: Sequence[RankedPump]) -> Mapping[Any, _Flow]:
    """Newest case flows at the reference condition of the pumps that are shown, by operator and serial."""
    names = {(p["operator"], p["serial"]): p["records"] for p in shown}
    wanted = [row for row in rows if names.get((row.operator, row.serial))]

    def read(pump_ids: list[int]) -> Mapping[int, _Flow]:
        return {i: _Flow.of(items) for i, items in queries.newest_flows(session, pump_ids, _SPARK_RECORDS).items()}

    found = _kept_flows.of(session, wanted, read)
    return {(row.operator, row.serial): found[row.id] for row in wanted if row.id in found}


def _shown(pump: RankedPump, flows: Mapping[tuple[str, str], _Flow]) -> _Row:
    flow = flows.get((pump["operator"], pump["serial"]))
    label = f"case flow at the reference condition of {pump['serial']} over its last {flow.n if flow else 0} records"
    spark = flow.spark.replace(_LABEL, escape(label)) if flow else ""
    return {
        **pump,
        "link": pump_address(pump["serial"], pump["operator"]),
        "flow": flow.newest if flow else None,
        "spark": Markup(spark),  # noqa: S704 - made by us, the label is escaped
    }
