"""The page of one pump: verdict, evidence, curve, trends, and what is entered about it."""

from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from typing import TypedDict, get_args

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response
from sqlalchemy.orm import Session

from detectors.words.verdict import CAUSES
from service.access.security import Principal
from service.alarms import reading
from service.answers.alarms import Alarm
from service.context import Context
from service.errors import NotFound
from service.history.knowledge import intervals_of
from service.history.placement import changes
from service.reading import queries
from service.reading.by_link import ByLink
from service.reading.events import entered_of
from service.reading.fleet import pump_documents
from service.reading.forecast import forecast_and_crossing
from service.reading.pump_history import Change, changes_of
from service.registry import findings, maintenance
from service.reports.remarks import remarks
from service.reports.words import ACTION_WORDS, WORDS
from service.storage.tables import Pump
from service.thresholds.layers import thresholds_of
from service.web.dashboard.frame import PageRoute, html_page, local
from service.web.dashboard.links import address, api_address
from service.web.dashboard.pictures import PICTURE_HEADERS, pictured_curve
from service.web.dashboard.preferences import system_of
from service.web.dashboard.trends import Look, Looked, trends_of_page
from service.web.dependencies import Asker, ContextOf, context_of, principal
from twin.pumps.fluids import FLUIDS

page_router = APIRouter(include_in_schema=False, route_class=PageRoute)

_MOST_ALARMS = 20
_kept_changes: ByLink[list[Change]] = ByLink(500)
_Body = tuple[str, int, dict[str, object]]


class _Actions(TypedDict):
    """What forms of the pump page offer: words by what they stand for, times as fields hold them, a shelf in hours."""

    may_act: bool
    may_maintain: bool
    finding_action: str
    maintenance_action: str
    action_words: Mapping[str, str]
    fluids: list[str]
    channels: tuple[str, ...]
    found_words: dict[str, str]
    longest_shelf_h: float
    usual_shelf: str
    latest_shelf: str


@page_router.get("/pumps/{serial}", response_class=HTMLResponse)
def pump_page(request: Request, serial: str, look: Looked, operator: str | None = None) -> Response:
    """One pump: verdict, evidence, curve, trends."""
    return html_page(*_pump_body(request, context_of(request), look, serial, operator))


@page_router.get("/pumps/{serial}/curve.svg")
def curve_picture(
    request: Request, serial: str, context: ContextOf, asker: Asker, operator: str | None = None
) -> Response:
    """The damage identification curve as the page shows it, light or dark as the screen is, in the reader's units."""
    with context.database.reading() as session:
        row = queries.pump(session, asker, serial, operator)
        svg = pictured_curve(session, row, context.archive, system_of(request))
    return Response(svg, media_type="image/svg+xml", headers=PICTURE_HEADERS)


def _pump_body(request: Request, context: Context, look: Look, serial: str, operator: str | None) -> _Body:
    asker, system = principal(request), system_of(request)
    with context.database.reading() as session:
        row = queries.pump(session, asker, serial, operator)
        document = pump_documents(session, [row])[0]
        if document["records"] == 0:
            raise NotFound(f"pump {serial} has no analysed record yet")
        thresholds = thresholds_of(session, row.operator, row.serial, row.pump_type).values
        entered = entered_of(session, row.id)
        moved = changes(intervals_of(entered.installations))
        forecast, verdict = forecast_and_crossing(session, row, queries.verdict(session, row), thresholds, moved)
        values = {
            "request": request,
            "pump": document,
            "verdict": verdict,
            "remarks": remarks(verdict, system),
            "changes": _changes(session, row),
            "curve": address("pumps", row.serial, "curve.svg", query={"operator": row.operator}),
            "forecast": forecast,
            "trends": trends_of_page(session, (asker, system), row, look, thresholds, entered),
            "alarms": _alarms(session, asker, row),
            "findings": [findings.document(f) for f in sorted(entered.findings, key=lambda f: f.at, reverse=True)],
            "maintenance": [
                maintenance.document(e) for e in sorted(entered.maintenance, key=lambda e: e.at, reverse=True)
            ],
            **_actions(asker, row, thresholds),
            "causes": CAUSES,
            "api": api_address("pumps", serial),
        }
    return "pump.html", 200, values


def _changes(session: Session, row: Pump) -> list[Change]:
    """Changes of the verdict, the newest first."""
    found = _kept_changes.of(session, [row], lambda ids: {i: changes_of(session, row) for i in ids})
    return found.get(row.id, [])


def _actions(asker: Principal, row: Pump, thresholds: Mapping[str, float]) -> _Actions:
    """What the forms of the pump page need; they are shown to those who may use them."""
    longest = thresholds["alarm_shelving_maximum_h"]
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
