"""Pages of records: the list with what each added, and one record with its channels, windows and spectrum."""

from typing import Annotated, Any

from fastapi import APIRouter, Query, Request
from fastapi.responses import HTMLResponse, Response
from markupsafe import Markup
from pydantic import Field

from service.access.security import Principal
from service.answers import records as answers
from service.answers.records import RecordChannels
from service.bodies import Body
from service.context import Context
from service.errors import Problem
from service.registry.fields import Reason
from service.reports.record_chart import record_svg
from service.reports.spectrum_chart import spectrum_svg
from service.web.dashboard.forms import SentForm, checked, done, instant_of
from service.web.dashboard.frame import PageRoute, html_page
from service.web.dashboard.links import address
from service.web.dependencies import Asker, ContextOf
from service.web.routes import records, spectrum

record_router = APIRouter(include_in_schema=False, route_class=PageRoute)
_PER_PAGE = 50
_REFUSALS = 20
_POINTS = 920
"""Samples of each channel in the picture: two for each two pixels of its width."""
STATUS_WORDS = {
    "analysed": "counts",
    "stored": "waits for its analysis",
    "refused": "refused",
    "superseded": "replaced by another record",
    "withdrawn": "withdrawn",
}
WINDOW_WORDS = {"pump_off": "pump off", "zero_flow": "zero flow", "constant_flow": "constant flow"}


class _Withdrawal(Body):
    reason: Reason = Field(description="Why it shall no longer count")


@record_router.get("/records", response_class=HTMLResponse)
def records_page(
    request: Request,
    context: ContextOf,
    asker: Asker,
    pump: str | None = None,
    since: Annotated[str, Query(alias="from")] = "",
    until: Annotated[str, Query(alias="to")] = "",
    status: Annotated[records.Status | str, Query(pattern="^(stored|analysed|refused|superseded|withdrawn)?$")] = "",
    cursor: str | None = None,
) -> Response:
    """Records, the newest first: where each stands, what it added or why not; what was refused with every fault."""
    found = records.listed(
        context,
        asker,
        pump=pump or None,
        since=instant_of(since, "from") if since else None,
        until=instant_of(until, "to") if until else None,
        status=status or None,  # type: ignore[arg-type]
        limit=_PER_PAGE,
        cursor=cursor or None,
    )
    filters = {"pump": pump, "from": since, "to": until, "status": status}
    shows_refusals = not (pump or since or until or cursor) and status in ("", "refused")
    refused = records.refusals(context, asker, limit=_REFUSALS) if shows_refusals else None
    values = {
        "request": request,
        "records": found["items"],
        "filters": filters,
        "next": address("records", query={**filters, "cursor": found["next"]}) if found["next"] else None,
        "first": address("records", query=filters) if cursor else None,
        "chips": [
            (word, address("records", query={**filters, "status": name}), name == status)
            for name, word in {"": "all", **{name: name for name in STATUS_WORDS}}.items()
        ],
        "refusals": refused["items"] if refused else [],
        "more_refusals": bool(refused and refused["next"]),
        "status_words": STATUS_WORDS,
    }
    return html_page("records.html", 200, values)


@record_router.get("/records/{record_id}", response_class=HTMLResponse)
def record_page(
    request: Request,
    record_id: str,
    context: ContextOf,
    asker: Asker,
    start_s: Annotated[float | None, Query(alias="from")] = None,
    end_s: Annotated[float | None, Query(alias="to")] = None,
    channel: Annotated[str, Query(alias="spectrum")] = "",
) -> Response:
    """One record: where it stands, its channels over time with windows and the twin, its spectrum."""
    record = records.one(record_id, context, asker)
    picture = _picture(context, asker, record, start_s, end_s)
    values = {
        "request": request,
        "record": record,
        "windows": record.get("windows") or (picture["found"]["windows"] if picture["svg"] else []),
        "picture": picture,
        "spectrum": _spectrum(context, asker, record, channel, start_s, end_s),
        "status_words": STATUS_WORDS,
        "window_words": WINDOW_WORDS,
        "may_withdraw": asker.may("analyst") and record["status"] in ("analysed", "stored"),
        "zoomed": start_s is not None or end_s is not None,
    }
    return html_page("record.html", 200, values)


@record_router.post("/records/{record_id}/withdraw")
def withdraw(record_id: str, form: SentForm) -> Response:
    """Take a record out of its pump's history and go back to it."""
    link = address("records", record_id)
    form.goes_back_to(link)
    body = checked(_Withdrawal, {"reason": form.text("reason")}, "withdrawal")
    records.withdraw(record_id, form.context, form.who, body.reason)
    return done(link)


def _picture(
    context: Context, asker: Principal, record: answers.Record, start_s: float | None, end_s: float | None
) -> dict[str, Any]:
    """Picture of the channels with the links that move along it; or why there is none."""
    record_id = record["record_id"]
    try:
        found = spectrum.channels(record_id, context, asker, _POINTS, start_s, end_s)
    except Problem as problem:
        if start_s is not None or end_s is not None:
            raise
        return {"svg": None, "why": problem.detail, "channels": [], "links": []}
    all_windows = record.get("windows", found["windows"])
    first = next((i for i, w in enumerate(all_windows, 1) if found["windows"] and w == found["windows"][0]), 1)
    svg = record_svg(found, f"Channels of record {record_id}", first)
    channels = [
        {
            "name": c["channel"],
            "unit": c["unit"],
            "missing": c["missing"],
            "low": min((v for v in c["value"] if v is not None), default=None),
            "high": max((v for v in c["value"] if v is not None), default=None),
        }
        for c in found["channels"]
    ]
    return {
        "svg": Markup(svg),  # noqa: S704 - made by us, names in it are escaped
        "found": found,
        "channels": channels,
        "links": _moves(record_id, found) if start_s is not None or end_s is not None else _closer(record_id, found),
    }


def _closer(record_id: str, found: RecordChannels) -> list[tuple[str, str]]:
    """Links to halves of what is seen."""
    start, end = found["start_s"], found["end_s"]
    middle = 0.5 * (start + end)
    return [("first half", _at(record_id, start, middle)), ("second half", _at(record_id, middle, end))]


def _moves(record_id: str, found: RecordChannels) -> list[tuple[str, str]]:
    """Links that move along the record, closer or further away."""
    start, end = found["start_s"], found["end_s"]
    span = max(end - start, 1e-3)
    return [
        ("whole record", address("records", record_id)),
        ("earlier", _at(record_id, start - 0.5 * span, end - 0.5 * span)),
        ("later", _at(record_id, start + 0.5 * span, end + 0.5 * span)),
        ("closer", _at(record_id, start + 0.25 * span, end - 0.25 * span)),
        ("wider", _at(record_id, start - 0.5 * span, end + 0.5 * span)),
    ]


def _at(record_id: str, start: float, end: float) -> str:
    return address("records", record_id, query={"from": f"{start:.6g}", "to": f"{end:.6g}"}, place="channels")


def _spectrum(
    context: Context,
    asker: Principal,
    record: answers.Record,
    channel: str,
    start_s: float | None,
    end_s: float | None,
) -> dict[str, Any]:
    """Spectrum of the channel that was asked for; or why there is none."""
    if not channel:
        return {"svg": None, "why": None, "found": None, "channel": ""}
    try:
        found = spectrum.spectrum(record["record_id"], context, asker, channel, start_s, end_s)
    except Problem as problem:
        return {"svg": None, "why": problem.detail, "found": None, "channel": channel}
    return {"svg": Markup(spectrum_svg(found)), "why": None, "found": found, "channel": channel}  # noqa: S704
