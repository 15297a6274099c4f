"""The pages: fleet, pump."""

from datetime import UTC, datetime, timedelta
from typing import Any, get_args

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response
from markupsafe import Markup, escape
from sqlalchemy.orm import Session

from detectors.curve.picture import curve_svg
from detectors.words.verdict import CAUSES, TREND_METRICS
from service.access.security import Principal
from service.alarms import reading
from service.answers.alarms import Alarm
from service.context import Context
from service.errors import NotFound
from service.history.knowledge import entries
from service.reading import queries
from service.reading.agreement import judged_findings, rates
from service.reading.curve import curve_of
from service.reading.fleet import fleet, pump_documents
from service.reading.forecast import forecast_of, with_crossing
from service.reading.trend import points_of, trend_of
from service.registry import findings, maintenance
from service.reports.charts import sparkline_svg, trend_svg
from service.reports.remarks import remarks
from service.reports.words import ACTION_WORDS, ESTIMATE_NAMES, WORDS
from service.storage.tables import Finding, MaintenanceEvent, Pump
from service.thresholds.layers import thresholds_of
from service.web.dashboard.frame import PageRoute, html_page, local
from service.web.dashboard.links import address, api_address, pump_address
from service.web.dependencies import context_of, principal
from twin.pumps.fluids import FLUIDS

page_router = APIRouter(include_in_schema=False, route_class=PageRoute)

_MOST_ALARMS = 20
_SPARK_RECORDS = 60
_PUMPS_PER_PAGE = 100
_TRENDS = (
    "case_flow_at_reference_lpm",
    "pump_leakage_change_lpm",
    "case_residual_bar",
    "discharge_residual_bar",
    "system_leakage_change_lpm",
    "drain_resistance_change_percent",
)
_Body = tuple[str, int, dict[str, Any]]


@page_router.get("/", response_class=HTMLResponse)
def fleet_page(request: Request, page: int = 1) -> Response:
    """Who needs attention, why, since when; a hundred pumps a page, the most urgent first."""
    return html_page(*_fleet_body(request, context_of(request), page))


@page_router.get("/pumps/{serial}", response_class=HTMLResponse)
def pump_page(request: Request, serial: str, operator: str | None = None) -> Response:
    """One pump: verdict, evidence, curve, trends."""
    return html_page(*_pump_body(request, context_of(request), serial, operator))


def _fleet_body(request: Request, context: Context, page: int) -> _Body:
    asker = principal(request)
    with context.database.reading() as session:
        everyone: list[dict[str, Any]] = [dict(pump) for pump in fleet(session, asker)]
    last = max(1, -(-len(everyone) // _PUMPS_PER_PAGE))
    page = min(max(page, 1), last)
    pumps = everyone[(page - 1) * _PUMPS_PER_PAGE : page * _PUMPS_PER_PAGE]
    silent = [p for p in everyone if p["silent"]]
    silent_shown = silent[:_PUMPS_PER_PAGE]
    for document in (*pumps, *silent_shown):
        document["link"] = pump_address(document["serial"], document["operator"])
    with context.database.reading() as session:
        for document in pumps:
            row = queries.pump(session, asker, document["serial"], document["operator"])
            newest = queries.newest_assessments(session, row.id, _SPARK_RECORDS)
            items = points_of(newest, "case_flow_at_reference_lpm", None, None)
            flow = items[-1] if items else None
            label = f"case flow at the reference condition of {row.serial} over its last {len(items)} records"
            document["flow"] = flow
            values = [i["value"] for i in items]
            document["spark"] = Markup(sparkline_svg(values, escape(label))) if items else ""  # noqa: S704
        agreement = rates(judged_findings(session, asker))
    states = [p["state"] for p in everyone]
    counts = [(state, states.count(state)) for state in WORDS if state in states]
    return (
        "fleet.html",
        200,
        {
            "request": request,
            "pumps": pumps,
            "counts": counts,
            "silent": silent_shown,
            "n_silent": len(silent),
            "agreement": agreement,
            "page": page,
            "last_page": last,
            "first_pump": (page - 1) * _PUMPS_PER_PAGE + 1,
            "n_pumps": len(everyone),
        },
    )


def _pump_body(request: Request, context: Context, serial: str, operator: str | None) -> _Body:
    asker = principal(request)
    with context.database.reading() as session:
        row = queries.pump(session, asker, serial, operator)
        document = pump_documents(session, [row])[0]
        if document["records"] == 0:
            raise NotFound(f"pump {serial} has no analysed record yet")
        verdict = with_crossing(session, row, queries.verdict(session, row))
        values = {
            "request": request,
            "pump": document,
            "verdict": verdict,
            "remarks": remarks(verdict),
            "changes": queries.verdict_changes(session, row)[::-1],
            "curve": Markup(curve_svg(curve_of(session, row, None, None, None).curve, f"pump {serial}")),  # noqa: S704
            "forecast": forecast_of(session, row),
            "trends": _trends(session, row),
            "alarms": _alarms(session, asker, row),
            "findings": [
                findings.document(f)
                for f in sorted(entries(session, Finding, row.id), key=lambda f: f.at, reverse=True)
            ],
            "maintenance": [
                maintenance.document(e)
                for e in sorted(entries(session, MaintenanceEvent, row.id), key=lambda e: e.at, reverse=True)
            ],
            **_actions(session, asker, row),
            "causes": CAUSES,
            "api": api_address("pumps", serial),
        }
    return "pump.html", 200, values


def _actions(session: Session, asker: Principal, row: Pump) -> dict[str, Any]:
    """What the forms of the pump page need; they are shown to those who may use them."""
    longest = thresholds_of(session, row.operator, row.serial, row.pump_type).values["alarm_shelving_maximum_h"]
    now = datetime.now(UTC)
    # a minute less: the form is sent later than it is made
    latest = now + timedelta(hours=longest) - timedelta(minutes=1)
    return {
        "may_act": asker.may("analyst"),
        "may_maintain": asker.may("engineer"),
        "finding_action": address("pumps", row.serial, "findings", query={"operator": row.operator}),
        "maintenance_action": address("pumps", row.serial, "maintenance", query={"operator": row.operator}),
        "action_words": ACTION_WORDS,
        "fluids": sorted(FLUIDS),
        "channels": get_args(maintenance.Channel),
        "found_words": {name: WORDS.get(name, "No fault found") for name in get_args(findings.Found)},
        "longest_shelf_h": longest,
        "usual_shelf": local(min(now + timedelta(hours=24), latest)),
        "latest_shelf": local(latest),
    }


def _alarms(session: Session, asker: Principal, row: Pump) -> list[Alarm]:
    """The pump's newest alarms as the API shows them."""
    query = reading.alarms(asker, reading.Wanted(serial=row.serial, operator=row.operator)).limit(_MOST_ALARMS)
    return [reading.shown(alarm, serial, kind) for alarm, serial, kind in session.execute(query)]


def _trends(session: Session, row: Pump) -> list[dict[str, Any]]:
    limit = thresholds_of(session, row.operator, row.serial, row.pump_type).values["case_flow_limit_lpm"]
    found = []
    for metric in _TRENDS:
        items = trend_of(session, row, metric, None, None, 400)
        if not items:
            continue
        title = ESTIMATE_NAMES.get(metric) or metric.rsplit("_", 1)[0].replace("_", " ")
        line = limit if metric == "case_flow_at_reference_lpm" else None
        svg = Markup(trend_svg(title, TREND_METRICS[metric], items, line))  # noqa: S704
        found.append({"title": title, "unit": TREND_METRICS[metric], "svg": svg, "items": items[::-1]})
    return found
