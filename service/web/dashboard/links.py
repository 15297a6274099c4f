"""Addresses of pages: the one place where names from outside become parts of a link."""

from collections.abc import Mapping
from typing import Any
from urllib.parse import quote, urlencode, urlsplit

from service.web.addresses import API_PREFIX


def address(*parts: str, query: Mapping[str, Any] | None = None, place: str = "") -> str:
    """Address of a page below the root, every part and value quoted; what is None or empty in ``query`` is left out."""
    path = "/" + "/".join(quote(part, "") for part in parts)
    given = {name: value for name, value in (query or {}).items() if value not in (None, "")}
    return path + (f"?{urlencode(given, quote_via=quote)}" if given else "") + (f"#{place}" if place else "")


def pump_address(serial: str, operator: str | None, place: str = "") -> str:
    """Page of a pump."""
    return address("pumps", serial, query={"operator": operator}, place=place)


def api_address(*parts: str, query: Mapping[str, Any] | None = None) -> str:
    """Address of a call of the API, for pictures and files that a page links to."""
    return API_PREFIX + address(*parts, query=query)


def local_address(wanted: str) -> str:
    """``wanted`` where it is a place on these pages, else the fleet: a sign-in leads to no other site."""
    parts = urlsplit(wanted)
    is_ours = wanted.startswith("/") and not wanted.startswith(("//", "/\\")) and not (parts.scheme or parts.netloc)
    return wanted if is_ours and wanted.isprintable() and "\\" not in wanted else "/"
