"""How somebody wants pages to speak: times in a zone with UTC beside, and units. Kept in cookies, nowhere else."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from datetime import UTC, datetime
from functools import cache
from typing import Literal, TypedDict
from zoneinfo import ZoneInfo, available_timezones

from fastapi import Request

from service.units import METRIC, SYSTEMS, UnitSystem
from service.web.dependencies import is_secure

COOKIE = "casedrain_zone"
UNITS_COOKIE = "casedrain_units"
YEAR_S = 365 * 86_400
_zone: ContextVar[ZoneInfo | None] = ContextVar("zone of a page", default=None)


@cache
def zones() -> tuple[str, ...]:
    """Names of zones that people choose from: places, and UTC first."""
    return ("UTC", *sorted(z for z in available_timezones() if "/" in z and not z.startswith(("Etc/", "SystemV/"))))


def zone_of(request: Request) -> str:
    """Zone that the sender of a request has chosen; UTC where there is none, or none of that name."""
    chosen = request.cookies.get(COOKIE, "")
    return chosen if chosen in zones() else "UTC"


def system_of(request: Request) -> UnitSystem:
    """Units that the sender of a request has chosen; bar, L/min and degC where there is none, or none of that name."""
    return SYSTEMS.get(request.cookies.get(UNITS_COOKIE, ""), METRIC)


@contextmanager
def spoken_in(zone: str) -> Iterator[None]:
    """Times of a page in a zone while the block runs."""
    token = _zone.set(None if zone == "UTC" else ZoneInfo(zone))
    try:
        yield
    finally:
        _zone.reset(token)


class Cookie(TypedDict):
    """Arguments of ``Response.set_cookie``; how long it is kept in s."""

    key: str
    value: str
    max_age: int
    httponly: bool
    samesite: Literal["lax"]
    secure: bool


def cookie(request: Request, name: str, chosen: str) -> Cookie:
    """Arguments of a response's cookie that keeps a choice."""
    secure = is_secure(request)
    return {"key": name, "value": chosen, "max_age": YEAR_S, "httponly": True, "samesite": "lax", "secure": secure}


def _here(value: datetime | str) -> tuple[datetime, datetime | None]:
    at = (datetime.fromisoformat(value) if isinstance(value, str) else value).astimezone(UTC)
    zone = _zone.get()
    return at, None if zone is None else at.astimezone(zone)


def _day(value: datetime | str | None) -> str:
    """Day and time: in UTC, or in the chosen zone with UTC beside."""
    if not value:
        return "–"
    at, here = _here(value)
    if here is None:
        return f"{at:%d %b %Y %H:%M} UTC"
    beside = f"{at:%H:%M}" if at.date() == here.date() else f"{at:%d %b %H:%M}"
    return f"{here:%d %b %Y %H:%M %Z} ({beside} UTC)"


def _date(value: datetime | str | None) -> str:
    if not value:
        return "–"
    at, here = _here(value)
    return f"{here or at:%d %b %Y}"


FILTERS: Mapping[str, Callable[..., str]] = {"day": _day, "date": _date}
"""Filters of the pages' templates that speak in the chosen zone; reports speak UTC (``service.reports.words``)."""
