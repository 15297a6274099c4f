"""The inbox: alarms of the whole fleet, narrowed by filters, handled one by one or many at once."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from datetime import UTC, datetime, timedelta

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response

from service.alarms import reading
from service.alarms.handling import Wish, handle, handle_many
from service.alarms.life_cycle import ACKNOWLEDGE, CLOSE, COMMENT, PLAN, SHELVE, UNSHELVE
from service.answers.alarms import Alarm
from service.errors import Conflict, Fault, Invalid, Problem
from service.reports.words import WORDS
from service.storage.tables import Alarm as AlarmRow
from service.web.dashboard.forms import Sent, SentForm, checked, done, instant_of
from service.web.dashboard.frame import PageRoute, html_page, local
from service.web.dashboard.links import address, local_address, pump_address
from service.web.dependencies import Asker, ContextOf
from service.web.routes import alarms

alarm_router = APIRouter(include_in_schema=False, route_class=PageRoute)
KINDS = (ACKNOWLEDGE, SHELVE, UNSHELVE, CLOSE, COMMENT, PLAN)
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
_PLAN = ("assignee", "due_at", "work_order")
_SPANS = {"30": "30 days", "90": "90 days", "365": "a year", "": "all"}


class _Row(Alarm):
    """An alarm with what its row says in words: how long it lasted [days], when it is due as a field holds it."""

    words: str
    days: int
    possible: list[str]
    is_living: bool
    due: str
    escalations: int


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
    narrowed = replace(filters, state=filters.state or (None if every else "open"))
    given = asdict(narrowed)
    found = alarms.listed(context, asker, narrowed, limit=_PER_PAGE, cursor=cursor or None)
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
        "late": address("alarms", query={**query, "overdue": None if filters.overdue else "true"}),
        "assignees": _assignees(context, asker),
        "may_act": asker.may("analyst"),
        "usual_shelf": local(now + _USUAL_SHELF),
        "priorities": ("critical", "high", "medium", "low"),
        "sides": ("pump", "system", "sensor", "unknown"),
    }
    return html_page("alarms.html", 200, values)


def _assignees(context: ContextOf, asker: Asker) -> list[str]:
    """Who sees to alarms already, to be chosen again."""
    query = reading.alarms(asker).order_by(None).with_only_columns(AlarmRow.assignee).distinct()
    with context.database.reading() as session:
        found = session.scalars(query.where(AlarmRow.assignee.is_not(None)).order_by(AlarmRow.assignee).limit(50))
        return [str(name) for name in found]


@alarm_router.get("/alarms/statistics", response_class=HTMLResponse)
def statistics_page(request: Request, context: ContextOf, asker: Asker, days: str = "") -> Response:
    """How often alarms came, how long they lasted and how many were a nuisance, over all, by kind and by pump."""
    if days not in _SPANS:
        raise Invalid("there is no such time", [Fault("days", f"is not one of {', '.join(filter(None, _SPANS))}")])
    since = datetime.now(UTC) - timedelta(days=int(days)) if days else None
    found = alarms.counted(context, asker, since=since, limit=_PER_PAGE)
    values = {
        "request": request,
        "figures": found,
        "spans": [(word, address("alarms", "statistics", query={"days": n}), n == days) for n, word in _SPANS.items()],
        "span": _SPANS[days],
    }
    return html_page("alarm_statistics.html", 200, values)


@alarm_router.get("/alarms/{alarm_id}", response_class=HTMLResponse)
def alarm_page(request: Request, context: ContextOf, asker: Asker, alarm_id: str) -> Response:
    """One alarm: what it says, who sees to it until when, and everything that happened to it."""
    now = datetime.now(UTC)
    values = {
        "request": request,
        "a": _shown(alarms.one(alarm_id, context, asker), now),
        "here": address("alarms", alarm_id),
        "may_act": asker.may("analyst"),
        "usual_shelf": local(now + _USUAL_SHELF),
        "assignees": _assignees(context, asker),
    }
    return html_page("alarm.html", 200, values)


@alarm_router.post("/alarms")
def act_on_many(form: SentForm) -> Response:
    """Do the same about every alarm that was ticked, each for itself; what could not be done is named."""
    link = local_address(form.text("back") or "/alarms")
    form.goes_back_to(link)
    form.who.require("analyst")
    ids = list(dict.fromkeys(form.all("alarm")))
    # of many alarms, what is left open stays as it is
    wish = _wish(form, form.text("action"), [name for name in _PLAN if form.text(name)])
    if not ids or len(ids) > _MOST_AT_ONCE:
        words = "is ticked nowhere" if not ids else f"is ticked {len(ids)} times, at most {_MOST_AT_ONCE} at once"
        raise Invalid("nothing was done", [Fault("alarm", words)])
    faults: list[Fault] = []
    for alarm_id, result in zip(ids, handle_many(form.context.database, form.who, ids, wish), strict=True):
        if isinstance(result, Problem):
            said = [f"{f.where.removeprefix('body.')} {f.problem}" for f in result.errors]
            faults.append(Fault(_name(form, alarm_id), "; ".join([result.detail, *said])))
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
    handle(form.context.database, form.who, alarm_id, _wish(form, action, _PLAN))
    return done(link)


def _wish(form: Sent, action: str, plan: Sequence[str]) -> Wish:
    if action not in KINDS:
        raise Invalid("nothing was done", [Fault("action", f"is not one of {', '.join(KINDS)}")])
    if action == PLAN:
        given = {**{name: form.text(name) or None for name in plan}, "reason": form.text("reason") or None}
        if given.get("due_at"):
            given["due_at"] = form.instant("due_at")
        return checked(alarms.Planned, given, "plan").wish()
    # an end says nothing about anything but a shelf, and stands in the same form
    until = instant_of(form.text("until"), "until") if form.text("until") and action == "shelve" else None
    return Wish(action, form.text("reason") or None, until)


def _name(form: Sent, alarm_id: str) -> str:
    """What people call an alarm: its pump and the day on which it began."""
    try:
        with form.context.database.reading() as session:
            row, pump = reading.alarm(session, form.who, alarm_id)
            return f"{pump.serial}, {row.onset_at:%d %b %Y}"
    except Problem:
        return alarm_id


def _shown(alarm: Alarm, now: datetime) -> _Row:
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
        "due": local(datetime.fromisoformat(alarm["due_at"])) if alarm["due_at"] else "",
        "escalations": sum(event["event"] == "escalated" for event in alarm["history"]),
    }
