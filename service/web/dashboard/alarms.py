"""The inbox: alarms of the whole fleet, narrowed by filters, handled one by one or many at once."""

from dataclasses import asdict
from datetime import UTC, datetime, timedelta
from typing import Any

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response

from service.alarms import reading
from service.alarms.handling import Wish, handle
from service.alarms.life_cycle import ACKNOWLEDGE, CLOSE, SHELVE, UNSHELVE
from service.answers.alarms import Alarm
from service.errors import Conflict, Fault, Invalid, Problem
from service.reports.words import WORDS
from service.web.dashboard.forms import Sent, SentForm, done, instant_of
from service.web.dashboard.frame import PageRoute, html_page, local
from service.web.dashboard.links import address, local_address, pump_address
from service.web.dependencies import Asker, ContextOf
from service.web.routes import alarms

alarm_router = APIRouter(include_in_schema=False, route_class=PageRoute)
KINDS = {"acknowledge": ACKNOWLEDGE, "shelve": SHELVE, "unshelve": UNSHELVE, "close": CLOSE}
_PER_PAGE = 50
_MOST_AT_ONCE = 200
_STATES = {
    "open": "open",
    "unacknowledged": "not acknowledged",
    "active": "active",
    "shelved": "on the shelf",
    "cleared_acknowledged": "back to normal",
    "closed": "closed",
    "withdrawn": "withdrawn",
}
_USUAL_SHELF = timedelta(hours=24)


@alarm_router.get("/alarms", response_class=HTMLResponse)
def alarms_page(
    request: Request,
    context: ContextOf,
    asker: Asker,
    filters: alarms.Narrowed,
    every: bool = False,
    cursor: str | None = None,
) -> Response:
    """Alarms of the fleet, the newest first; without a filter those that want attention or an end."""
    given: dict[str, Any] = {**asdict(filters), "state": filters.state or (None if every else "open")}
    found = alarms.listed(context, asker, alarms.Filters(**given), limit=_PER_PAGE, cursor=cursor or None)
    now = datetime.now(UTC)
    query = {**given, "every": "true" if given["state"] is None else None}
    chips = [
        (word, address("alarms", query={**query, "state": name, "every": None}), name == given["state"])
        for name, word in _STATES.items()
    ]
    everything = ("all", address("alarms", query={**query, "state": None, "every": "true"}), given["state"] is None)
    values = {
        "request": request,
        "alarms": [_shown(alarm, now) for alarm in found["items"]],
        "filters": query,
        "chips": [*chips, everything],
        "next": address("alarms", query={**query, "cursor": found["next"]}) if found["next"] else None,
        "first": address("alarms", query=query) if cursor else None,
        "here": address("alarms", query={**query, "cursor": cursor}),
        "may_act": asker.may("analyst"),
        "usual_shelf": local(now + _USUAL_SHELF),
        "priorities": ("critical", "high", "medium", "low"),
        "sides": ("pump", "system", "sensor", "unknown"),
    }
    return html_page("alarms.html", 200, values)


@alarm_router.post("/alarms")
def act_on_many(form: SentForm) -> Response:
    """Do the same about every alarm that was ticked, each for itself; what could not be done is named."""
    link = local_address(form.text("back") or "/alarms")
    form.goes_back_to(link)
    form.who.require("analyst")
    ids = list(dict.fromkeys(form.all("alarm")))
    wish = _wish(form, form.text("action"))
    if not ids or len(ids) > _MOST_AT_ONCE:
        words = "is ticked nowhere" if not ids else f"is ticked {len(ids)} times, at most {_MOST_AT_ONCE} at once"
        raise Invalid("nothing was done", [Fault("alarm", words)])
    faults: list[Fault] = []
    for alarm_id in ids:
        try:
            handle(form.context.database, form.who, alarm_id, wish)
        except Problem as problem:
            words = "; ".join(
                [problem.detail, *(f"{f.where.removeprefix('body.')} {f.problem}" for f in problem.errors)]
            )
            faults.append(Fault(_name(form, alarm_id), words))
    if faults:
        raise Conflict(f"{len(ids) - len(faults)} of {len(ids)} alarms were handled, these were not", faults)
    return done(link)


@alarm_router.post("/alarms/{alarm_id}/{action}")
def act(alarm_id: str, action: str, form: SentForm) -> Response:
    """Do something about an alarm and go back to where it was shown."""
    with form.context.database.reading() as session:
        row, pump = reading.alarm(session, form.who, alarm_id)
        link = local_address(form.text("back") or pump_address(pump.serial, row.operator, "alarms"))
    form.goes_back_to(link)
    handle(form.context.database, form.who, alarm_id, _wish(form, action))
    return done(link)


def _wish(form: Sent, action: str) -> Wish:
    if action not in KINDS:
        raise Invalid("nothing was done", [Fault("action", f"is not one of {', '.join(KINDS)}")])
    # an end says nothing about anything but a shelf, and stands in the same form
    until = instant_of(form.text("until"), "until") if form.text("until") and action == "shelve" else None
    return Wish(KINDS[action], form.text("reason") or None, until)


def _name(form: Sent, alarm_id: str) -> str:
    """What people call an alarm: its pump and the day on which it began."""
    try:
        with form.context.database.reading() as session:
            row, pump = reading.alarm(session, form.who, alarm_id)
            return f"{pump.serial}, {row.onset_at:%d %b %Y}"
    except Problem:
        return alarm_id


def _shown(alarm: Alarm, now: datetime) -> dict[str, Any]:
    """An alarm with what a row says in words."""
    onset = datetime.fromisoformat(alarm["onset_at"])
    ended = alarm["closed_at"] or alarm["cleared_at"] or alarm["withdrawn_at"]
    lasted = (datetime.fromisoformat(ended) if ended else now) - onset
    return {
        **alarm,
        "words": "normal (cleared, acknowledged)"
        if alarm["state"] == "cleared_acknowledged"
        else alarm["state"].replace("_", ", "),
        "days": max(lasted.days, 0),
        "possible": [WORDS.get(c, c).lower() for c in alarm["candidates"]],
        "is_living": alarm["state"] not in ("closed", "withdrawn"),
        "escalations": sum(event["event"] == "escalated" for event in alarm["history"]),
    }
