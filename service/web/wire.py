"""What an answer weighs on the wire: it has a name by its content (ETag), is not sent twice, and is compressed."""

import hashlib
import zlib
from collections.abc import MutableMapping
from typing import Any

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

_LEAST_BYTES = 800
"""Below this compressing costs more than it saves (our choice)."""
_LEVEL = 5
_TEXTS = (
    "application/json",
    "application/problem+json",
    "application/x-ndjson",
    "image/svg+xml",
    "application/javascript",
)
_UNCHANGED = 304
_KEPT = frozenset({"etag", "cache-control", "vary", "date", "expires", "x-request-id", "content-location"})
"""Headers that a 304 carries (RFC 9110, 15.4.5)."""


class Wire:
    """ASGI middleware: ETag and 304 for what is read whole, gzip for text, streamed or not.

    Who compares sizes must not guess secrets: tokens of forms are masked anew in every page (``service.access.sessions``).
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        await self._app(scope, receive, _Answer(scope, send).send)


class _Answer:
    """One answer on its way out; its beginning waits for the first part of its body."""

    def __init__(self, scope: Scope, send: Send) -> None:
        headers = Headers(scope=scope)
        self._send = send
        self._is_read = scope["method"] == "GET"
        self._takes_gzip = _accepts_gzip(headers.get("accept-encoding", ""))
        self._known = {_plain(tag) for tag in headers.get("if-none-match", "").split(",") if tag.strip()}
        self._start: MutableMapping[str, Any] | None = None
        self._gzip: Any = None

    async def send(self, message: Message) -> None:
        """Pass a message on."""
        if message["type"] == "http.response.start":
            self._start = message
        elif message["type"] != "http.response.body":
            await self._begin(message)
        elif self._start is not None:
            await self._first(message)
        else:
            await self._part(message)

    async def _begin(self, message: Message | None = None) -> None:
        if self._start is not None:
            start, self._start = self._start, None
            await self._send(start)
        if message is not None:
            await self._send(message)

    async def _first(self, message: Message) -> None:
        start, body = self._start, message.get("body", b"")
        assert start is not None
        headers = MutableHeaders(scope=start)
        whole = not message.get("more_body", False)
        if self._is_read and start["status"] == 200:
            if whole and "etag" not in headers:
                headers["ETag"] = f'W/"{hashlib.sha256(body).hexdigest()[:24]}"'
            headers.setdefault("Cache-Control", "private, no-cache")
            if "etag" in headers and self._known & {_plain(headers["etag"]), "*"} and whole:
                await self._unchanged(headers)
                return
        if _is_text(headers):
            headers.add_vary_header("Accept-Encoding")
            if self._takes_gzip and "content-encoding" not in headers and (not whole or len(body) >= _LEAST_BYTES):
                self._gzip = zlib.compressobj(_LEVEL, zlib.DEFLATED, 31)
                headers["Content-Encoding"] = "gzip"
                del headers["Content-Length"]
                if whole:
                    body = self._gzip.compress(body) + self._gzip.flush()
                    self._gzip = None
                    headers["Content-Length"] = str(len(body))
                    message = {**message, "body": body}
        await self._begin()
        await self._part(message)

    async def _unchanged(self, headers: MutableHeaders) -> None:
        kept = [(name, value) for name, value in headers.raw if name.decode().lower() in _KEPT]
        self._start = {"type": "http.response.start", "status": _UNCHANGED, "headers": kept}
        await self._begin({"type": "http.response.body", "body": b"", "more_body": False})

    async def _part(self, message: Message) -> None:
        if self._gzip is not None:
            body = self._gzip.compress(message.get("body", b""))
            # what has been made so far goes out, so that a stream does not wait for its end
            body += self._gzip.flush(zlib.Z_SYNC_FLUSH if message.get("more_body", False) else zlib.Z_FINISH)
            message = {**message, "body": body}
        await self._send(message)


def _plain(tag: str) -> str:
    """A tag without its mark of weakness: that is how reads compare (RFC 9110, 13.1.2)."""
    return tag.strip().removeprefix("W/")


def _is_text(headers: Headers) -> bool:
    kind = headers.get("content-type", "").partition(";")[0].strip()
    return kind.startswith("text/") or kind in _TEXTS


def _accepts_gzip(text: str) -> bool:
    """Whether gzip is named and not refused (``gzip;q=0``)."""
    for part in text.split(","):
        name, _, weight = part.partition(";")
        if name.strip().lower() in ("gzip", "*"):
            return weight.replace(" ", "") not in ("q=0", "q=0.0", "q=0.00", "q=0.000")
    return False
