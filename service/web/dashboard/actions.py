"""Forms of the pump page: findings and maintenance entered. They work without script."""

from fastapi import APIRouter
from fastapi.responses import Response

from service.access import audit
from service.registry import findings, maintenance
from service.registry.locks import locked_pump
from service.web.dashboard.forms import Sent, SentForm, checked, done, zoned
from service.web.dashboard.frame import PageRoute
from service.web.dashboard.links import address, pump_address

action_router = APIRouter(include_in_schema=False, route_class=PageRoute)


@action_router.post("/pumps/{serial}/findings")
def enter_finding(serial: str, form: SentForm, operator: str | None = None) -> Response:
    """Enter what the workshop found and go back to the pump."""
    form.goes_back_to(_back(form, serial, operator, "findings"))
    form.who.require("analyst")
    values = {"found": form.text("found"), "note": form.text("note"), **form.filled(without=("removed", "back"))}
    values |= {"at": zoned(form.text("at")), "removed": bool(form.text("removed"))}
    body = checked(findings.NewFinding, values, "finding")
    with form.context.database.writing() as session:
        pump = locked_pump(session, form.who, serial, operator)
        row = findings.create(session, pump, body, form.who.owner)
        details = body.model_dump(mode="json", exclude_unset=True)
        audit.note(session, form.who, "finding.enter", f"pump/{serial}/finding/{row.id}", pump.operator, details)
        return done(_back(form, pump.serial, pump.operator, "findings"))


@action_router.post("/pumps/{serial}/maintenance")
def enter_maintenance(serial: str, form: SentForm, operator: str | None = None) -> Response:
    """Enter what was done to the pump or around it and go back to the pump."""
    form.goes_back_to(_back(form, serial, operator, "maintenance"))
    form.who.require("engineer")
    # a choice that is left open says nothing
    values = {"action": form.text("action"), **form.filled(without=("back",)), "at": zoned(form.text("at"))}
    body = checked(maintenance.NewMaintenance, values, "entry")
    with form.context.database.writing() as session:
        pump = locked_pump(session, form.who, serial, operator)
        row = maintenance.create(session, pump, body, form.who.owner, form.context.archive)
        details = body.model_dump(mode="json", exclude_unset=True)
        audit.note(
            session, form.who, "maintenance.enter", f"pump/{serial}/maintenance/{row.id}", pump.operator, details
        )
        return done(_back(form, pump.serial, pump.operator, "maintenance"))


def _back(form: Sent, serial: str, operator: str | None, place: str) -> str:
    """The page whose form it was: the pump's own, or its entries in the registry."""
    if form.text("back") == "registry":
        return address("registry", query={"pump": serial, "operator": operator}, place=place)
    return pump_address(serial, operator, place)
