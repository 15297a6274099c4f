"""Names in an address keep their slashes: ``SN%2F4711`` is one name, and no path of two.

Servers decode an address before it is routed, which takes a slash inside a name for one between two. The router is
shown a stand-in for the first, and every call gets its names back whole.
"""

from urllib.parse import unquote

from fastapi import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

_STAND_IN = "\udc2f"
"""Half of a surrogate pair: no decoded address can hold it."""


class WholeNames:
    """Shows the router an address whose names hold no slash."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        raw: bytes = scope.get("raw_path") or b""
        if scope["type"] != "http" or b"%" not in raw:
            await self._app(scope, receive, send)
            return
        path = scope["path"]

        async def sending(message: Message) -> None:
            # whoever is asked before or after the router, the log among them, sees the address as it was
            scope["path"] = path
            await send(message)

        parts = raw.partition(b"?")[0].decode("latin-1").split("/")
        scope["path"] = "/".join(unquote(part).replace("/", _STAND_IN) for part in parts)
        try:
            await self._app(scope, receive, sending)
        finally:
            scope["path"] = path


async def whole_names(request: Request) -> None:
    """Give a call the names of its address as they are; it comes before every other dependency."""
    params = request.scope.get("path_params", {})
    for name, value in params.items():
        if isinstance(value, str) and _STAND_IN in value:
            params[name] = value.replace(_STAND_IN, "/")
