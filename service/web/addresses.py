"""Addresses of things in the API, whatever characters their names hold."""

from urllib.parse import quote

API_PREFIX = "/api/v1"


def location(*parts: str | int) -> str:
    """Path of a thing; a header holds ASCII only, so that names are written as a URL writes them."""
    return "/".join([API_PREFIX, *(quote(str(part), safe="", errors="replace") for part in parts)])
