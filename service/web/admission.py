"""What is looked at before a request comes in: its host, the site that sends it, its address, the size of its body."""

from collections.abc import Mapping
from urllib.parse import unquote_to_bytes, urlsplit

from starlette.datastructures import Headers
from starlette.types import Scope

from service.errors import Fault, Forbidden, Invalid, Misdirected, Problem, TooLarge, Undecodable
from service.settings import Settings, is_loopback
from service.web.addresses import API_PREFIX

READING = ("GET", "HEAD", "OPTIONS")
"""Methods that change nothing."""
_FORM_FRAME_BYTES = 2**16
"""What a form adds around the files that it sends."""


def check_admission(scope: Scope, settings: Settings) -> None:
    """Refuse a request by its head alone.

    Raises
    ------
    Undecodable
        when host, origin or length are none.
    Misdirected, Forbidden
        where authentication is off: when the host is not this machine, or another site sends a change. A page anywhere
        could else act as an admin through the browser of whoever reads it, by a name that it lets lead here.
    Invalid
        when the address holds a NUL: Postgres refuses the query that it makes, SQLite finds nothing.
    TooLarge
        when the declared length is above what the address takes; nobody's key is looked at before.
    """
    headers = Headers(scope=scope)
    host = _host_of(headers.get("host", ""))
    origin = _origin_of(headers)
    if not settings.auth_is_on:
        if host is None or not is_loopback(host):
            raise Misdirected(
                "without authentication this service answers to localhost only: call it http://127.0.0.1 or "
                "http://localhost, or set CASEDRAIN_AUTH=on"
            )
        if scope["method"] not in READING:
            _check_site(headers, origin)
    _check_address(scope)
    declared = headers.get("content-length", "")
    if declared and not (declared.isascii() and declared.isdigit()):
        raise Undecodable("the request is malformed", [Fault("content-length", "is no number of bytes")])
    if declared and int(declared[:20]) > body_limit(scope["path"], settings):
        raise too_large(scope["path"], settings)


def body_limit(path: str, settings: Settings) -> int:
    """Largest body at an address [bytes]."""
    return _uploads(settings).get(path, settings.max_body_bytes) if not _is_file(path) else settings.max_upload_bytes


def too_large(path: str, settings: Settings) -> Problem:
    """The refusal of a body by its size."""
    limit = body_limit(path, settings)
    is_upload = path in _uploads(settings) or _is_file(path)
    words = f"the upload is larger than {limit} bytes: split the record into segments"
    return TooLarge(words if is_upload else f"the body is larger than {limit} bytes", headers={"Connection": "close"})


def _uploads(settings: Settings) -> Mapping[str, int]:
    one = settings.max_upload_bytes
    return {
        f"{API_PREFIX}/records": one,
        f"{API_PREFIX}/records/bulk": settings.max_bulk_bytes,
        f"{API_PREFIX}/mappings/preview": one,
        f"{API_PREFIX}/mappings/suggest": one,
        "/upload": one + _FORM_FRAME_BYTES,
        "/mappings": one + _FORM_FRAME_BYTES,
    }


def _is_file(path: str) -> bool:
    return (path.startswith(f"{API_PREFIX}/registry/") and path.endswith(".csv")) or path.startswith(
        ("/upload/", "/mappings/")
    )


def _host_of(text: str) -> str | None:
    """Name in a Host header, without its port; None where there is none."""
    if not text:
        return None
    try:
        parts = urlsplit(f"//{text}")
        _ = parts.port
    except ValueError:
        parts = None
    if parts is None or parts.netloc != text or parts.hostname is None or parts.username is not None:
        raise Undecodable("the request is malformed", [Fault("host", "is no host name with a port")])
    return parts.hostname


def _origin_of(headers: Headers) -> str | None:
    """Host and port of the site that sends a request; None where no browser says it, empty where it hides it."""
    text = headers.get("origin")
    if text is None:
        return None
    if text == "null":
        return ""
    try:
        parts = urlsplit(text)
        _ = parts.port
    except ValueError:
        parts = None
    if parts is None or not parts.scheme or not parts.netloc:
        raise Undecodable("the request is malformed", [Fault("origin", "is no origin like https://example.org")])
    return parts.netloc.lower()


def _check_site(headers: Headers, origin: str | None) -> None:
    site = headers.get("sec-fetch-site", "none").lower()
    foreign = origin is not None and origin != headers.get("host", "").lower()
    if foreign or site not in ("same-origin", "none"):
        raise Forbidden("without authentication no other site may change anything here: open casedrain's own pages")


def _check_address(scope: Scope) -> None:
    parts = {"path": scope["path"], "query": unquote_to_bytes(scope["query_string"]).decode("latin-1")}
    faults = [Fault(where, "holds a NUL character") for where, text in parts.items() if "\x00" in text]
    if faults:
        raise Invalid(f"the request has {len(faults)} fault(s)", faults)
