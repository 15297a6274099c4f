"""Forms of the pump page: alarms acknowledged, shelved, taken back, closed; findings entered. They work without script."""

from collections.abc import Callable
from datetime import UTC, datetime
from typing import Annotated, Any
from urllib.parse import quote, urlsplit

from fastapi import APIRouter, Form, Request
from fastapi.responses import RedirectResponse, Response
from pydantic import ValidationError

from service.access import audit
from service.access.security import EVERYBODY, Principal
from service.alarms import reading
from service.alarms.handling import Wish, handle
from service.alarms.life_cycle import ACKNOWLEDGE, CLOSE, SHELVE, UNSHELVE
from service.context import Context
from service.errors import Fault, Forbidden, Invalid, Problem
from service.registry import findings
from service.registry.locks import locked_pump
from service.web.dashboard.pages import html_page
from service.web.dependencies import context_of, visitor_of

action_router = APIRouter(include_in_schema=False)
_Field = Annotated[str, Form(max_length=2000)]
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
        # the field of a form has no zone: the pages speak UTC
        zoned = at if at.endswith("Z") else f"{at}Z"
        values: dict[str, Any] = {"at": zoned, "found": found, "removed": bool(removed), "note": note}
        if measured_case_flow_lpm.strip():
            values["measured_case_flow_lpm"] = measured_case_flow_lpm.strip()
        try:
            body = findings.NewFinding.model_validate(values)
        except ValidationError as error:
            faults = [Fault(".".join(str(part) for part in e["loc"]), e["msg"]) for e in error.errors()]
            raise Invalid(f"the finding has {len(faults)} fault(s); nothing was entered", faults) from None
        with context.database.writing() as session:
            pump = locked_pump(session, who, serial, operator)
            row = findings.create(session, pump, body, who.owner)
            details = body.model_dump(mode="json", exclude_unset=True)
            audit.note(session, who, "finding.enter", f"pump/{serial}/finding/{row.id}", pump.operator, details)
            return _pump_link(pump.serial, pump.operator, "findings")

    return _answered(request, csrf_token, done, lambda _context, _who: _pump_link(serial, operator, "findings"))


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
