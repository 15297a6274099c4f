"""The fleet page: who needs attention, why and since when, in the order of the ranking; searched and narrowed."""

from collections.abc import Mapping, Sequence
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
from service.reading.ranking import ranked
from service.reports.charts import sparkline_svg
from service.reports.words import WORDS
from service.storage.tables import Pump
from service.web.dashboard.frame import PageRoute, html_page
from service.web.dashboard.links import address, pump_address
from service.web.dependencies import Asker, ContextOf
from service.web.routes import pumps

fleet_router = APIRouter(include_in_schema=False, route_class=PageRoute)
_PUMPS_PER_PAGE = 100
_SPARK_RECORDS = 60
_kept_flows: ByLink[list[TrendPoint]] = ByLink(5000)


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
        rows = list(session.scalars(queries.pumps(asker)))
        everyone = ranked(session, rows, *pumps_standing(session, rows))
        wanted = [p for p in everyone if _fits(p, filters) and _found(p, search)]
        last = max(1, -(-len(wanted) // _PUMPS_PER_PAGE))
        page = min(max(page, 1), last)
        shown = wanted[(page - 1) * _PUMPS_PER_PAGE : page * _PUMPS_PER_PAGE]
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
    states = [p["state"] for p in everyone]
    values = {
        "request": request,
        "pumps": [_shown(p, flows) for p in shown],
        "n_all": len(everyone),
        "filters": query,
        "is_narrowed": any(query.values()),
        "chips": [
            (f"{states.count(state)} {WORDS[state].lower()}", state, address(query={**query, "state": state}))
            for state in WORDS
            if state in states
        ],
        "all_link": address(query={**query, "state": None}),
        "silent_link": address(query={**query, "silent": "true"}),
        "n_silent": sum(p["silent"] for p in everyone),
        "agreement": agreement,
        "page": page,
        "last_page": last,
        "newer": address(query={**query, "page": page - 1}),
        "older": address(query={**query, "page": page + 1}),
        "first_pump": (page - 1) * _PUMPS_PER_PAGE + 1,
        "n_pumps": len(wanted),
    }
    return html_page("fleet.html", 200, values)


def _fits(pump: RankedPump, filters: pumps.Filters) -> bool:
    """Whether a pump is among those that ``GET /pumps`` lists with these filters."""
    held = {
        "state": pump["state"],
        "side": pump["side"],
        "aircraft": pump["aircraft"],
        "type": pump["pump_type"],
        "priority": pump["urgency"],
        "silent": pump["silent"],
    }
    return all(getattr(filters, name) in (None, value) for name, value in held.items())


def _found(pump: RankedPump, search: str) -> bool:
    words = (pump["serial"], pump["aircraft"] or "", pump["operator"])
    return all(any(part in word.lower() for word in words) for part in search.lower().split())


def _flows(session: Session, rows: Sequence[Pump], shown: Sequence[RankedPump]) -> Mapping[Any, list[TrendPoint]]:
    """Newest case flows at the reference condition of the pumps that are shown, by operator and serial."""
    ids = {(row.operator, row.serial): row.id for row in rows}
    wanted = {(p["operator"], p["serial"]): ids[p["operator"], p["serial"]] for p in shown if p["records"]}
    found = _kept_flows.of(
        session, list(wanted.values()), lambda pump_ids: queries.newest_flows(session, pump_ids, _SPARK_RECORDS)
    )
    return {name: found.get(pump_id, []) for name, pump_id in wanted.items()}


def _shown(pump: RankedPump, flows: Mapping[Any, list[TrendPoint]]) -> dict[str, Any]:
    items = flows.get((pump["operator"], pump["serial"]), [])
    label = f"case flow at the reference condition of {pump['serial']} over its last {len(items)} records"
    spark = sparkline_svg([i["value"] for i in items], escape(label)) if items else ""
    return {
        **pump,
        "link": pump_address(pump["serial"], pump["operator"]),
        "flow": items[-1] if items else None,
        "spark": Markup(spark),  # noqa: S704 - made by us, the label is escaped
    }
