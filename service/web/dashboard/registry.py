"""The registry: aircraft with their sensors, pumps with where they sat, what was done and what was found."""

from typing import Any, TypedDict, get_args

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response

from detectors.words.observation import ACTIONS
from service.access.security import Principal
from service.context import Context
from service.errors import Fault, Invalid
from service.registry import aircraft as aircraft_entries
from service.registry import findings, installations, maintenance
from service.registry import pumps as pump_entries
from service.reports.words import ACTION_WORDS, WORDS
from service.web.dashboard.forms import Sent, SentForm, checked, done, zoned
from service.web.dashboard.frame import PageRoute, html_page
from service.web.dashboard.links import address
from service.web.dependencies import Asker, ContextOf
from service.web.routes import aircraft, circuits, history, pump_types, pumps
from twin.pumps.fluids import FLUIDS

registry_router = APIRouter(include_in_schema=False, route_class=PageRoute)
_PER_PAGE = 100
_SENSORS = ("case_pressure_bar", "discharge_pressure_bar", "reservoir_pressure_bar")


class _Choices(TypedDict):
    """What forms of the registry offer, and to whom."""

    request: Request
    may_enter: bool
    sees_all: bool
    pump_types: list[str]
    fluids: list[str]
    circuits: list[str]


@registry_router.get("/registry", response_class=HTMLResponse)
def registry_page(
    request: Request,
    context: ContextOf,
    asker: Asker,
    pump: str | None = None,
    name: str | None = None,
    operator: str | None = None,
    cursor: str | None = None,
    aircraft_cursor: str | None = None,
) -> Response:
    """Pumps and aircraft; ``pump`` or ``name`` (of an aircraft) opens one of them."""
    if pump is not None and name is not None:
        raise Invalid("one thing at a time", [Fault("query.name", "is given beside a pump")])
    if pump is not None:
        return _pump(request, context, asker, pump, operator)
    if name is not None:
        return _aircraft(request, context, asker, name, operator)
    found = pumps.listed(context, asker, limit=_PER_PAGE, cursor=cursor)
    planes = aircraft.listed(context, asker, limit=_PER_PAGE, cursor=aircraft_cursor)
    query = {"cursor": cursor, "aircraft_cursor": aircraft_cursor}
    values = {
        "pumps": found["items"],
        "aircraft": planes["items"],
        "next_pumps": address("registry", query={**query, "cursor": found["next"]}) if found["next"] else None,
        "next_aircraft": address("registry", query={**query, "aircraft_cursor": planes["next"]})
        if planes["next"]
        else None,
        **_choices(request, context, asker),
    }
    return html_page("registry.html", 200, values)


@registry_router.post("/registry/pumps")
def register_pump(form: SentForm) -> Response:
    """Register a pump before its first record."""
    form.goes_back_to("/registry")
    body = checked(pump_entries.NewPump, {"serial": form.text("serial"), **form.filled()}, "pump")
    made = pumps.create(body, Response(), form.context, form.who)
    return done(_pump_link(made["serial"], made["operator"]))


@registry_router.post("/registry/pumps/{serial}")
def change_pump(serial: str, form: SentForm) -> Response:
    """Confirm a pump, or give it another type."""
    operator, link = _of(form, _pump_link, serial)
    body = checked(pump_entries.PumpChange, form.filled(without=("operator",)), "change")
    pumps.change(serial, body, form.context, form.who, operator)
    return done(link)


@registry_router.post("/registry/pumps/{serial}/installations")
def install(serial: str, form: SentForm) -> Response:
    """Say where a pump sat or sits."""
    operator, link = _of(form, _pump_link, serial)
    values = {"aircraft": form.text("aircraft"), "position": form.text("position"), "from": zoned(form.text("from"))}
    values |= form.filled(without=("operator", "from", "to")) | {"to": form.instant("to")}
    body = checked(installations.NewInstallation, values, "installation")
    history.install(serial, body, Response(), form.context, form.who, operator)
    return done(link)


@registry_router.post("/registry/pumps/{serial}/installations/{entry_id}")
def change_installation(serial: str, entry_id: str, form: SentForm) -> Response:
    """Say when a pump was removed, or take the entry back."""
    operator, link = _of(form, _pump_link, serial)
    if form.text("withdraw"):
        history.withdraw_installation(serial, entry_id, form.context, form.who, operator)
    else:
        body = checked(installations.InstallationChange, {"to": form.instant("to")}, "change")
        history.correct_installation(serial, entry_id, body, form.context, form.who, operator)
    return done(link)


@registry_router.post("/registry/pumps/{serial}/maintenance/{entry_id}/withdraw")
def withdraw_maintenance(serial: str, entry_id: str, form: SentForm) -> Response:
    """Take a maintenance entry back."""
    operator, link = _of(form, _pump_link, serial)
    history.withdraw_maintenance(serial, entry_id, form.context, form.who, operator)
    return done(link)


@registry_router.post("/registry/pumps/{serial}/findings/{entry_id}/withdraw")
def withdraw_finding(serial: str, entry_id: str, form: SentForm) -> Response:
    """Take a finding back."""
    operator, link = _of(form, _pump_link, serial)
    history.withdraw_finding(serial, entry_id, form.context, form.who, operator)
    return done(link)


@registry_router.post("/registry/aircraft")
def register_aircraft(form: SentForm) -> Response:
    """Register an aircraft."""
    form.goes_back_to("/registry")
    body = checked(aircraft_entries.NewAircraft, {"aircraft": form.text("aircraft"), **form.filled()}, "aircraft")
    made = aircraft.create(body, Response(), form.context, form.who)
    return done(_aircraft_link(made["aircraft"], made["operator"]))


@registry_router.post("/registry/aircraft/{name}")
def change_aircraft(name: str, form: SentForm) -> Response:
    """Change type, fluid and circuit of an aircraft; its pumps are folded anew where that changes anything."""
    operator, link = _of(form, _aircraft_link, name)
    values = {"aircraft_type": form.text("aircraft_type") or None, "fluid": form.text("fluid") or None}
    body = checked(aircraft_entries.AircraftChange, form.filled(without=("operator",)) | values, "change")
    aircraft.change(name, body, form.context, form.who, operator)
    return done(link)


@registry_router.post("/registry/aircraft/{name}/sensors")
def fit_sensor(name: str, form: SentForm) -> Response:
    """A sensor that is fitted from an instant on; the ones before it stay in the list."""
    operator, link = _of(form, _aircraft_link, name)
    new = form.filled(without=("operator",)) | {"since": zoned(form.text("since"))}
    held = aircraft.one(name, form.context, form.who, operator)["sensors"]
    body = checked(aircraft_entries.AircraftChange, {"sensors": [*held, new]}, "sensor")
    aircraft.change(name, body, form.context, form.who, operator)
    return done(link)


def _of(form: Sent, link: Any, name: str) -> tuple[str | None, str]:
    operator = form.text("operator") or None
    back = link(name, operator)
    form.goes_back_to(back)
    return operator, back


def _pump_link(serial: str, operator: str | None) -> str:
    return address("registry", query={"pump": serial, "operator": operator})


def _aircraft_link(name: str, operator: str | None) -> str:
    return address("registry", query={"name": name, "operator": operator})


def _pump(request: Request, context: Context, asker: Principal, serial: str, operator: str | None) -> Response:
    """One pump's entries."""
    found = pumps.one(serial, context, asker, operator)
    values = {
        "pump": found,
        "installations": history.installations(serial, context, asker, operator)["items"],
        "maintenance": history.maintenance(serial, context, asker, operator)["items"],
        "findings": history.findings(serial, context, asker, operator)["items"],
        **_choices(request, context, asker),
        "may_find": asker.may("analyst"),
        "action_words": {name: ACTION_WORDS[name] for name in ACTIONS},
        "channels": get_args(maintenance.Channel),
        "found_words": {name: WORDS.get(name, "No fault found") for name in get_args(findings.Found)},
        "places": [a["aircraft"] for a in aircraft.listed(context, asker, limit=500)["items"]],
    }
    return html_page("registry_pump.html", 200, values)


def _aircraft(request: Request, context: Context, asker: Principal, name: str, operator: str | None) -> Response:
    """One aircraft's fluid, circuit and sensors."""
    found = aircraft.one(name, context, asker, operator)
    values = {"aircraft": found, **_choices(request, context, asker), "channels": _SENSORS}
    return html_page("registry_aircraft.html", 200, values)


def _choices(request: Request, context: Context, asker: Principal) -> _Choices:
    """What the forms of the registry offer."""
    return {
        "request": request,
        "may_enter": asker.may("engineer"),
        "sees_all": asker.operator is None,
        "pump_types": [t["id"] for t in pump_types.listed(context, asker)["items"]],
        "fluids": sorted(FLUIDS),
        "circuits": [c["id"] for c in circuits.listed(context, asker)["items"]],
    }
