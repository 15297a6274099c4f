"""The frame round every page: templates, navigation, strict headers, and problems as pages."""

from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypedDict

from fastapi import Request
from fastapi.responses import HTMLResponse, RedirectResponse, Response
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from starlette.staticfiles import StaticFiles
from starlette.types import Receive, Scope, Send

from detectors.words.verdict import TREND_METRICS
from service import __version__
from service.access.security import EVERYBODY, Principal
from service.access.sessions import Visitor
from service.answers.problems import Problem as Told
from service.errors import NotFound, Unauthenticated
from service.reports.words import ESTIMATE_NAMES, FILTERS, MARKS, WORDS
from service.units import UnitSystem
from service.web.answer_route import AnswerRoute
from service.web.dashboard import preferences
from service.web.dashboard.links import address, api_address, pump_address
from service.web.dependencies import context_of, visitor_of

STATIC = StaticFiles(directory=Path(__file__).resolve().parent / "static")
SECURITY_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; style-src 'self'; img-src 'self' data:; form-action 'self'; "
    "base-uri 'none'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",
    "Cache-Control": "no-store",
}
_WITH_CHARTS = frozenset({"pump.html", "record.html"})
"""Templates that load our own script for cursor and zoom; no other page may run any."""
NAVIGATION: tuple[tuple[str, str, str], ...] = (
    ("/", "Fleet", "viewer"),
    ("/alarms", "Alarms", "viewer"),
    ("/records", "Records", "viewer"),
    ("/upload", "Upload", "analyst"),
    ("/registry", "Registry", "viewer"),
    ("/thresholds", "Thresholds", "viewer"),
    ("/engineer", "Engineer", "viewer"),
    ("/jobs", "Jobs", "viewer"),
    ("/mappings", "Mappings", "viewer"),
    ("/keys", "Keys", "admin"),
    ("/users", "Users", "admin"),
    ("/webhooks", "Webhooks", "admin"),
    ("/audit", "Audit", "admin"),
    ("/docs", "API", "viewer"),
)
"""Pages by address and word, with the lowest role that may see each."""
_NO_PAGES = ("/api/", "/healthz", "/readyz", "/metrics", "/openapi.json")

_templates = Environment(
    loader=PackageLoader("service.web.dashboard"),
    autoescape=select_autoescape(default=True, default_for_string=True),
    undefined=StrictUndefined,
)
_templates.globals |= {
    "words": WORDS,
    "marks": MARKS,
    "estimate_names": ESTIMATE_NAMES,
    "units": TREND_METRICS,
    "version": __version__,
    "address": address,
    "api_address": api_address,
    "pump_address": pump_address,
}
_templates.filters |= {**FILTERS, **preferences.FILTERS}


class PageRoute(AnswerRoute):
    """Route of a page or a form: it refuses query parameters that it does not know, and its problems are pages.

    A filter that a form sends empty was not asked for.
    """

    async def handle(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        parts = scope["query_string"].split(b"&")
        scope["query_string"] = b"&".join(part for part in parts if not part.endswith(b"="))
        await super().handle(scope, receive, send)


class _Place(TypedDict):
    """A page in the navigation; ``here`` where it is the one that is read."""

    address: str
    word: str
    here: bool


class _Frame(TypedDict):
    """What stands round every page: who reads it, where else they may go, zone, units, the way to choose them."""

    visitor: Visitor | None
    csrf_token: str
    asker: Principal | None
    navigation: list[_Place]
    now: str
    zone: str
    system: UnitSystem
    choose: str


def html_page(template: str, status: int, values: Mapping[str, Any]) -> HTMLResponse:
    """Render a template under the pages' strict policy; ``values`` hold the ``request``."""
    request: Request = values["request"]
    visitor = visitor_of(request) if context_of(request).settings.auth_is_on else None
    return _rendered(template, status, values, visitor, None if context_of(request).settings.auth_is_on else EVERYBODY)


def _rendered(
    template: str, status: int, values: Mapping[str, Any], visitor: Visitor | None, nobody: Principal | None
) -> HTMLResponse:
    asker = visitor.principal if visitor else nobody
    path = values["request"].url.path
    zone = preferences.zone_of(values["request"])
    frame: _Frame = {
        "visitor": visitor,
        "csrf_token": visitor.csrf_token if visitor else "",
        "asker": asker,
        "navigation": [
            {"address": place, "word": word, "here": place == path}
            for place, word, role in NAVIGATION
            if asker is not None and asker.may(role)
        ],
        "now": local(datetime.now(UTC)),
        "zone": zone,
        "system": preferences.system_of(values["request"]),
        "choose": address("preferences", query={"back": _again(values["request"])}),
    }
    with preferences.spoken_in(zone):
        text = _templates.get_template(template).render({**frame, **values})
    headers = dict(SECURITY_HEADERS)
    if template in _WITH_CHARTS:
        headers["Content-Security-Policy"] += "; script-src 'self'"
    return HTMLResponse(text, status_code=status, headers=headers)


def _again(request: Request) -> str | None:
    """The page itself, for the way back from somewhere else; a form is not sent again."""
    return None if request.method != "GET" or request.url.path == "/preferences" else _asked_for(request)


def _asked_for(request: Request) -> str:
    """Path and query as they were asked for: names in them keep their quoting, and with it their slashes."""
    raw: bytes = request.scope.get("raw_path") or request.url.path.encode("utf-8", "replace")
    path = raw.partition(b"?")[0].decode("ascii", "replace")
    return path + (f"?{request.url.query}" if request.url.query else "")


def local(instant: datetime) -> str:
    """An instant as a form's field has it, in UTC to the minute."""
    return f"{instant:%Y-%m-%dT%H:%M}"


NOTHING_HERE = "there is nothing at this address"
"""What the API says of an address without a route."""


def wants_page(request: Request) -> bool:
    """Whether an error of this request is shown as a page: it asked for one, or comes from a browser."""
    if isinstance(request.scope.get("route"), PageRoute):
        return True
    path = request.url.path
    return not path.startswith(_NO_PAGES) and "text/html" in request.headers.get("accept", "")


def problem_page(request: Request, told: Told, headers: Mapping[str, str]) -> Response:
    """A problem as a page, with the way back; who is not signed in is led to the sign-in and then on to the page."""
    status = told["status"]
    if status == int(Unauthenticated.status):
        return RedirectResponse(sign_in_address(request), status_code=303)
    on = context_of(request).settings.auth_is_on
    try:
        visitor = visitor_of(request) if on else None
    except Exception:  # the problem may be the database's own: it is told all the same
        visitor = None
    if status == int(NotFound.status) and told["detail"] == NOTHING_HERE:
        told = {
            **told,
            "detail": "there is no page at this address: follow a link from above, or look for typing mistakes",
        }
    values = {"request": request, "problem": told, "back": getattr(request.state, "back", None)}
    page = _rendered("problem.html", status, values, visitor, None if on else EVERYBODY)
    page.headers.update({name: value for name, value in headers.items() if name.lower() != "content-length"})
    return page


def sign_in_address(request: Request) -> str:
    """Where to sign in, with the page that was asked for; forms are not sent a second time."""
    wanted = _asked_for(request)
    is_read = request.method in ("GET", "HEAD")
    return address("sign-in", query={"next": wanted if is_read and wanted != "/" else None})
