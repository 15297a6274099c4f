"""Other sites' dashboards: which of them may call the API from a browser, by setting; pages are nobody else's."""

from starlette.middleware.cors import CORSMiddleware
from starlette.types import ASGIApp, Receive, Scope, Send

from service.context import Context
from service.web.addresses import API_PREFIX

_SENT = ("Authorization", "Content-Type", "Content-Encoding", "Accept", "If-Match", "If-None-Match")
_READ = ("ETag", "Location", "Retry-After", "X-Request-Id")
_DAY_S = 86_400


class Foreign:
    """CORS on the API alone, for the origins of the settings: keys travel in a header, cookies never."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._open: dict[tuple[str, ...], CORSMiddleware] = {}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        is_api = scope["type"] == "http" and scope["path"].startswith((f"{API_PREFIX}/", "/openapi.json"))
        context: Context | None = scope["app"].state.context if is_api else None
        if context is None or not context.settings.cors:
            await self._app(scope, receive, send)
            return
        await self._for(tuple(context.settings.cors))(scope, receive, send)

    def _for(self, origins: tuple[str, ...]) -> CORSMiddleware:
        if origins not in self._open:
            self._open[origins] = CORSMiddleware(
                self._app,
                allow_origins=origins,
                allow_methods=("GET", "POST", "PUT", "PATCH", "DELETE"),
                allow_headers=_SENT,
                expose_headers=_READ,
                max_age=_DAY_S,
            )
        return self._open[origins]
