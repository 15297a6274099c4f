"""Forms of the pump page: alarms handled, findings and maintenance entered. They work without script."""

from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from typing import Annotated, Any, TypeVar
from urllib.parse import quote, urlsplit

from fastapi import APIRouter, Form, Request
from fastapi.responses import RedirectResponse, Response
from pydantic import BaseModel, ValidationError

from service.access import audit
from service.access.security import EVERYBODY, Principal
from service.alarms import reading
from service.alarms.handling import Wish, handle
from service.alarms.life_cycle import ACKNOWLEDGE, CLOSE, SHELVE, UNSHELVE
from service.context import Context
from service.errors import Fault, Forbidden, Invalid, Problem
from service.registry import findings, maintenance
from service.registry.locks import locked_pump
from service.web.dashboard.pages import html_page
from service.web.dependencies import context_of, visitor_of

action_router = APIRouter(include_in_schema=False)
_Field = Annotated[str, Form(max_length=2000)]
AnyBody = TypeVar("AnyBody", bound=BaseModel)
_KINDS = {"acknowledge": ACKNOWLEDGE, "shelve": SHELVE, "unshelve": UNSHELVE, "close": CLOSE}


@action_router.post("/alarms/{alarm_id}/{action}")
def act(
    request: Request, alarm_id: str, action: str, csrf_token: _Field = "", reason: _Field = "", until: _Field = ""
) -> Response:
    """Do something about an alarm and go back to its pump."""

    def done(context: Context, who: Principal) -> str:
        if action not in _KINDS:
            raise Invalid("nothing was done", [Fault("action", f"is not one of {', '.join(_KINDS)}")])
        end = _instant(until, "until") if until else None
        found = handle(context.database, who, alarm_id, Wish(_KINDS[action], reason.strip() or None, end))
        return _pump_link(found["pump_serial"], found["operator"], "alarms")

    def back(context: Context, who: Principal) -> str:
        with context.database.reading() as session:
            row, pump = reading.alarm(session, who, alarm_id)
            return _pump_link(pump.serial, row.operator, "alarms")

    return _answered(request, csrf_token, done, back)


@action_router.post("/pumps/{serial}/findings")
def enter_finding(
    request: Request,
    serial: str,
    operator: str | None = None,
    csrf_token: _Field = "",
    at: _Field = "",
    found: _Field = "",
    measured_case_flow_lpm: _Field = "",
    removed: _Field = "",
    note: _Field = "",
) -> Response:
    """Enter what the workshop found and go back to the pump."""

    def done(context: Context, who: Principal) -> str:
        who.require("analyst")
        values: dict[str, Any] = {"at": _zoned(at), "found": found, "removed": bool(removed), "note": note}
        if measured_case_flow_lpm.strip():
            values["measured_case_flow_lpm"] = measured_case_flow_lpm.strip()
        body = _checked(findings.NewFinding, values, "finding")
        with context.database.writing() as session:
            pump = locked_pump(session, who, serial, operator)
            row = findings.create(session, pump, body, who.owner)
            details = body.model_dump(mode="json", exclude_unset=True)
            audit.note(session, who, "finding.enter", f"pump/{serial}/finding/{row.id}", pump.operator, details)
            return _pump_link(pump.serial, pump.operator, "findings")

    return _answered(request, csrf_token, done, lambda _context, _who: _pump_link(serial, operator, "findings"))


@action_router.post("/pumps/{serial}/maintenance")
def enter_maintenance(
    request: Request,
    serial: str,
    operator: str | None = None,
    csrf_token: _Field = "",
    at: _Field = "",
    action: _Field = "",
    fluid: _Field = "",
    channel: _Field = "",
    note: _Field = "",
) -> Response:
    """Enter what was done to the pump or around it and go back to the pump."""

    def done(context: Context, who: Principal) -> str:
        who.require("engineer")
        values = {"at": _zoned(at), "action": action, "note": note}
        # a choice that is left open says nothing
        values |= {name: said for name, said in (("fluid", fluid), ("channel", channel)) if said}
        body = _checked(maintenance.NewMaintenance, values, "entry")
        with context.database.writing() as session:
            pump = locked_pump(session, who, serial, operator)
            row = maintenance.create(session, pump, body, who.owner, context.archive)
            details = body.model_dump(mode="json", exclude_unset=True)
            audit.note(session, who, "maintenance.enter", f"pump/{serial}/maintenance/{row.id}", pump.operator, details)
            return _pump_link(pump.serial, pump.operator, "maintenance")

    return _answered(request, csrf_token, done, lambda _context, _who: _pump_link(serial, operator, "maintenance"))


def _checked(kind: type[AnyBody], values: Mapping[str, Any], what: str) -> AnyBody:
    """Values of a form as the API takes them; one error names every fault."""
    try:
        return kind.model_validate(values)
    except ValidationError as error:
        faults = [Fault(".".join(str(part) for part in e["loc"]), e["msg"]) for e in error.errors()]
        raise Invalid(f"the {what} has {len(faults)} fault(s); nothing was entered", faults) from None


def _answered(
    request: Request,
    csrf_token: str,
    done: Callable[[Context, Principal], str],
    back: Callable[[Context, Principal], str],
) -> Response:
    """Check who sends the form, do it, and lead on; what is wrong becomes a page with the way back."""
    context = context_of(request)
    link = None
    try:
        if context.settings.auth_is_on:
            visitor = visitor_of(request)
            if visitor is None:
                return RedirectResponse("/sign-in", status_code=303)
            visitor.check_form(csrf_token)
            who = visitor.principal
        else:
            _check_origin(request)
            who = EVERYBODY
        try:
            return RedirectResponse(done(context, who), status_code=303)
        except Problem:
            link = back(context, who)
            raise
    except Problem as problem:
        return html_page("problem.html", int(problem.status), {"request": request, "problem": problem, "back": link})


def _check_origin(request: Request) -> None:
    """Without sessions a form is known by its origin, which browsers send with every form."""
    origin = urlsplit(request.headers.get("origin", ""))
    if origin.netloc != request.headers.get("host", ""):
        raise Forbidden("the form does not come from these pages: open the page again and repeat")


def _zoned(text: str) -> str:
    """Time of a form's field with the zone that it lacks: the pages speak UTC."""
    return text if text.endswith("Z") else f"{text}Z"


def _instant(text: str, where: str) -> datetime:
    """Time of a form's field, which has no zone: the pages speak UTC."""
    try:
        found = datetime.fromisoformat(text)
    except ValueError:
        raise Invalid("the time cannot be read", [Fault(where, "is not a time like 2026-05-08T12:00")]) from None
    return found.replace(tzinfo=UTC) if found.tzinfo is None else found


def _pump_link(serial: str, operator: str | None, place: str) -> str:
    query = f"?operator={quote(operator, '')}" if operator else ""
    return f"/pumps/{quote(serial, '')}{query}#{place}"
