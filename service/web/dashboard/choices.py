"""The page on which somebody chooses how pages speak."""

from datetime import UTC, datetime

from fastapi import APIRouter, Request
from fastapi.responses import HTMLResponse, Response

from service.errors import Fault, Invalid
from service.units import SYSTEMS
from service.web.dashboard import preferences
from service.web.dashboard.forms import SentForm, done
from service.web.dashboard.frame import PageRoute, html_page
from service.web.dashboard.links import local_address
from service.web.dependencies import Asker

choice_router = APIRouter(include_in_schema=False, route_class=PageRoute)


@choice_router.get("/preferences", response_class=HTMLResponse)
def preferences_page(request: Request, asker: Asker, back: str = "/") -> Response:
    """Zones to choose from, with the time that it is in the chosen one, and units."""
    values = {
        "request": request,
        "zones": preferences.zones(),
        "chosen": preferences.zone_of(request),
        "systems": list(SYSTEMS.values()),
        "instant": datetime.now(UTC),
        "back": local_address(back),
        "owner": asker.owner,
    }
    return html_page("preferences.html", 200, values)


@choice_router.post("/preferences")
def choose(form: SentForm) -> Response:
    """Keep a choice in the browser and go back; a form without units leaves them as they are."""
    zone, units = form.text("zone"), form.text("units")
    faults = []
    if zone not in preferences.zones():
        faults.append(Fault("zone", "is no zone like Europe/Paris"))
    if units and units not in SYSTEMS:
        faults.append(Fault("units", f"is not one of {', '.join(SYSTEMS)}"))
    if faults:
        raise Invalid("nothing was changed", faults)
    response = done(local_address(form.text("back") or "/"))
    response.set_cookie(**preferences.cookie(form.request, preferences.COOKIE, zone))
    if units:
        response.set_cookie(**preferences.cookie(form.request, preferences.UNITS_COOKIE, units))
    return response
