"""Pages of records: the list with what each added, and one record with its channels, windows and spectrum."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, TypedDict

from fastapi import APIRouter, Query, Request
from fastapi.responses import HTMLResponse, Response
from markupsafe import Markup
from pydantic import Field

from service.access.security import Principal
from service.answers import records as answers
from service.answers.history import RecordMark
from service.answers.records import RecordChannels
from service.bodies import Body
from service.context import Context
from service.errors import Fault, Invalid, Problem
from service.history.overview import POINTS
from service.reading.channels import others_of
from service.registry.fields import Reason
from service.registry.marks import NewMark
from service.reports.record_chart import Overlay, record_svg
from service.reports.spectrum_chart import spectrum_svg
from service.units import METRIC, UnitSystem
from service.web.dashboard.forms import SentForm, checked, done, instant_of
from service.web.dashboard.frame import PageRoute, html_page
from service.web.dashboard.links import address
from service.web.dashboard.preferences import system_of
from service.web.dependencies import Asker, ContextOf
from service.web.routes import marks, records, spectrum

record_router = APIRouter(include_in_schema=False, route_class=PageRoute)
_PER_PAGE = 50
_REFUSALS = 20
STATUS_WORDS = {
    "analysed": "counts",
    "stored": "waits for its analysis",
    "refused": "refused",
    "superseded": "replaced by another record",
    "withdrawn": "withdrawn",
}
WINDOW_WORDS = {"pump_off": "pump off", "zero_flow": "zero flow", "constant_flow": "constant flow"}


class _Range(TypedDict):
    """A channel of what is seen: lowest and highest in ``unit``, samples that are missing (a count)."""

    name: str
    unit: str
    missing: int
    low: float | None
    high: float | None


class _Picture(TypedDict):
    """Channels as a picture with links (words, address) along it, or why there is none; a shift of the other record in s."""

    svg: Markup | None
    why: str | None
    found: RecordChannels | None
    channels: list[_Range]
    links: list[tuple[str, str]]
    zoom: str | None
    shift_s: float | None
    of_other: dict[str, _Range]


class _Spectrum(TypedDict):
    """Spectrum of the channel that was asked for; empty, or why there is none."""

    svg: Markup | None
    why: str | None
    found: answers.Spectrum | None
    channel: str


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
    beside: str = "",
    align: Annotated[Literal["start", "zero_flow", ""], Query(description="What both records begin with")] = "",
) -> Response:
    """One record: its channels over time with windows, marks and the twin, another one over it, its spectrum."""
    record = records.one(record_id, context, asker)
    system = system_of(request)
    other = records.one(beside, context, asker) if beside else None
    seen = _Seen(record, start_s, end_s, other, align or "start", system)
    marked = marks.listed(record_id, context, asker)["items"]
    picture = _picture(context, asker, seen, marked)
    with context.database.reading() as session:
        others = others_of(session, asker, record_id)
    values = {
        "request": request,
        "record": record,
        "windows": record.get("windows") or (picture["found"]["windows"] if picture["found"] else []),
        "picture": picture,
        "spectrum": _spectrum(context, asker, seen, channel),
        "status_words": STATUS_WORDS,
        "window_words": WINDOW_WORDS,
        "may_withdraw": asker.may("analyst") and record["status"] in ("analysed", "stored"),
        "others": others,
        "beside": seen.beside,
        "align": seen.align,
        "marked": marked,
        "may_mark": asker.may("engineer") and record["status"] == "analysed",
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


@record_router.post("/records/{record_id}/marks")
def mark(record_id: str, form: SentForm) -> Response:
    """Mark a stretch of a record good or bad, with a reason, and go back to the picture."""
    link = address("records", record_id, place="marks")
    form.goes_back_to(link)
    body = checked(NewMark, form.filled(), "mark")
    marks.mark(record_id, body, Response(), form.context, form.who)
    return done(link)


@record_router.post("/records/{record_id}/marks/{mark_id}/withdraw")
def unmark(record_id: str, mark_id: str, form: SentForm) -> Response:
    """Take a mark back and go back to the picture."""
    link = address("records", record_id, place="marks")
    form.goes_back_to(link)
    marks.withdraw(record_id, mark_id, form.context, form.who)
    return done(link)


@dataclass(frozen=True, slots=True)
class _Seen:
    """What of a record is looked at, and what lies over it."""

    record: answers.Record
    start_s: float | None
    end_s: float | None
    beside: answers.Record | None = None
    align: str = "start"
    system: UnitSystem = METRIC

    def at(self, start: float | None, end: float | None) -> str:
        """The same look at another stretch."""
        ends = {"from": None if start is None else f"{start:.6g}", "to": None if end is None else f"{end:.6g}"}
        over = {"beside": self.beside["record_id"], "align": self.align} if self.beside else {}
        return address("records", self.record["record_id"], query={**ends, **over}, place="channels")

    @property
    def zoom(self) -> str:
        """The same look with words in place of the stretch, which the cursor fills in."""
        over = {"beside": self.beside["record_id"], "align": self.align} if self.beside else {}
        return address(
            "records", self.record["record_id"], query={"from": "FROM", "to": "TO", **over}, place="channels"
        )

    @property
    def shift_s(self) -> float:
        """What is added to the other record's times."""
        starts = [_zero_flow_start(r) for r in (self.record, self.beside)]
        if self.align != "zero_flow" or None in starts:
            return 0.0
        return float(starts[0] or 0.0) - float(starts[1] or 0.0)


def _zero_flow_start(record: answers.Record | None) -> float | None:
    """Start of the first zero-flow window that counts; None without one."""
    windows = record.get("windows", []) if record else []
    return next((w["start_s"] for w in windows if w["kind"] == "zero_flow" and w["accepted"]), None)


def _overlay(context: Context, asker: Principal, seen: _Seen) -> Overlay | None:
    """The other record over the same stretch."""
    if seen.beside is None:
        return None
    shift = seen.shift_s
    ends = [None if t is None else t - shift for t in (seen.start_s, seen.end_s)]
    try:
        return Overlay(spectrum.channels(seen.beside["record_id"], context, asker, POINTS, *ends), shift)
    except Invalid as problem:
        raise Invalid("the other record has nothing there", [Fault("beside", problem.detail)]) from None


def _picture(context: Context, asker: Principal, seen: _Seen, marked: Sequence[RecordMark]) -> _Picture:
    """Picture of the channels with the links that move along it; or why there is none."""
    record, start_s, end_s = seen.record, seen.start_s, seen.end_s
    record_id = record["record_id"]
    try:
        found = spectrum.channels(record_id, context, asker, POINTS, start_s, end_s)
    except Problem as problem:
        if start_s is not None or end_s is not None:
            raise
        return {
            "svg": None,
            "why": problem.detail,
            "found": None,
            "channels": [],
            "links": [],
            "zoom": None,
            "shift_s": None,
            "of_other": {},
        }
    all_windows = record.get("windows", found["windows"])
    first = next((i for i, w in enumerate(all_windows, 1) if found["windows"] and w == found["windows"][0]), 1)
    overlay = _overlay(context, asker, seen)
    svg = record_svg(found, f"Channels of record {record_id}", first, marked, overlay, seen.system)
    return {
        "svg": Markup(svg),  # noqa: S704 - made by us, names in it are escaped
        "why": None,
        "found": found,
        "channels": list(_ranges(found["channels"]).values()),
        "links": _moves(seen, found) if start_s is not None or end_s is not None else _closer(seen, found),
        "zoom": seen.zoom,
        "shift_s": overlay.shift_s if overlay else None,
        "of_other": _ranges(overlay.found["channels"]) if overlay else {},
    }


def _ranges(channels: Sequence[answers.ChannelSamples]) -> dict[str, _Range]:
    """Lowest and highest of each channel by name."""
    return {
        c["channel"]: {
            "name": c["channel"],
            "unit": c["unit"],
            "missing": c["missing"],
            "low": min((v for v in c["value"] if v is not None), default=None),
            "high": max((v for v in c["value"] if v is not None), default=None),
        }
        for c in channels
    }


def _closer(seen: _Seen, found: RecordChannels) -> list[tuple[str, str]]:
    """Links to halves of what is seen."""
    start, end = found["start_s"], found["end_s"]
    middle = 0.5 * (start + end)
    return [("first half", seen.at(start, middle)), ("second half", seen.at(middle, end))]


def _moves(seen: _Seen, found: RecordChannels) -> list[tuple[str, str]]:
    """Links that move along the record, closer or further away."""
    start, end = found["start_s"], found["end_s"]
    span = max(end - start, 1e-3)
    return [
        ("whole record", seen.at(None, None)),
        ("earlier", seen.at(start - 0.5 * span, end - 0.5 * span)),
        ("later", seen.at(start + 0.5 * span, end + 0.5 * span)),
        ("closer", seen.at(start + 0.25 * span, end - 0.25 * span)),
        ("wider", seen.at(start - 0.5 * span, end + 0.5 * span)),
    ]


def _spectrum(context: Context, asker: Principal, seen: _Seen, channel: str) -> _Spectrum:
    """Spectrum of the channel that was asked for; or why there is none."""
    if not channel:
        return {"svg": None, "why": None, "found": None, "channel": ""}
    try:
        found = spectrum.spectrum(seen.record["record_id"], context, asker, channel, seen.start_s, seen.end_s)
    except Problem as problem:
        return {"svg": None, "why": problem.detail, "found": None, "channel": channel}
    svg = Markup(spectrum_svg(found, seen.system))  # noqa: S704
    return {"svg": svg, "why": None, "found": found, "channel": channel}
