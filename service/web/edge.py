"""The outermost ring: every request gets an id, a bounded body and a line in log and metrics, every error its answer."""

import asyncio
import re
import time
import uuid
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from dataclasses import fields
from http import HTTPStatus

import structlog
from prometheus_client import Counter, Histogram
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.access.account import Account, working_for
from service.access.crowd import Crowd
from service.access.turns import TooMany
from service.context import Context
from service.errors import Problem, TooSlow
from service.settings import Settings
from service.storage.failures import problem_of
from service.web.admission import READING, body_limit, check_admission, too_large
from service.web.dependencies import credential_of
from service.web.paging import sign_with
from service.web.problems import ProblemResponse
from service.web.traces import tell_of

log = structlog.get_logger("casedrain")
_METHODS = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"})
"""Methods that metrics name; whoever invents others must not make a label with each."""
_REQUESTS = Counter("casedrain_requests_total", "HTTP requests", ["method", "route", "status"])
_SECONDS = Histogram("casedrain_request_seconds", "Time to answer", ["method", "route"])
_ERRORS = Counter("casedrain_errors_total", "Requests that failed by a mistake of ours", ["route"])
_PROBES = frozenset({"/healthz", "/readyz", "/metrics"})
_GONE = 499
"""Counted where the client went away before its answer began, as proxies do; nobody is sent it."""
_TRACEPARENT = re.compile("(?!ff)[0-9a-f]{2}-(?P<trace>[0-9a-f]{32})-(?P<span>[0-9a-f]{16})-[0-9a-f]{2}(-.*)?")
_SLOWEST_BYTES_PER_S = 10_000
"""A body that comes slower than this for longer than a pause may last is given up (our choice)."""
_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "same-origin",
    "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; frame-ancestors 'none'; base-uri 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
}
"""On every answer that does not say otherwise: none of them is a page of scripts, and none is anybody else's."""
_HSTS = "max-age=31536000"


_LATE_S, _MOST_LATE = 0.25, 200
"""How long an answer of 429 is held back [s], and how many at once (our choice)."""


class _Late:
    """Answers that are held back now."""

    n = 0


class _EnoughError(Exception):
    """HEAD has its headers: nothing more is written."""


class Edge:
    """ASGI middleware around the whole application."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        context: Context = scope["app"].state.context
        settings = context.settings
        sign_with(context.cursor_key)
        exchange = _Exchange(scope, receive, send, settings)
        with structlog.contextvars.bound_contextvars(**exchange.names), working_for(exchange.account):
            try:
                check_admission(scope, settings)
                exchange.come(context.crowd)
                if scope["method"] == "HEAD":
                    scope["method"] = "GET"
                async with exchange.turn(context.crowd):
                    await self._app(scope, exchange.receive, exchange.send)
            except TooMany as refused:
                await exchange.answer_late(refused)
            except (_EnoughError, ClientDisconnect):
                pass
            except Exception as error:
                await _failed(exchange, error)
            finally:
                exchange.note(context.crowd)


async def _failed(exchange: "_Exchange", error: Exception) -> None:
    """Answer an error, unless an answer has begun: then the connection is cut, so that nobody takes it for whole."""
    if exchange.refusal is not None or exchange.gone:
        problem = exchange.refusal or Problem("the client went away")
    else:
        problem = problem_of(error) or _mistake(exchange, error)
    if not exchange.started:
        await exchange.answer(problem)
    elif exchange.complete:
        log.warning("what was to follow an answer failed", path=exchange.path, problem=problem.detail)
    elif not exchange.gone:
        raise error


def _mistake(exchange: "_Exchange", error: Exception) -> Problem:
    log.error("unexpected error", path=exchange.path, exc_info=error)
    return Problem(f"something went wrong on our side; the log has it under the request id {exchange.request_id}")


class _Exchange:
    """One request and its answer, as they pass through."""

    def __init__(self, scope: Scope, receive: Receive, send: Send, settings: Settings) -> None:
        self.request_id = uuid.uuid4().hex[:12]
        self.method: str = scope["method"]
        self.path: str = scope["path"]
        self.status = 0
        self.gone = False
        self.complete = False
        self.refusal: Problem | None = None
        self.account = Account()
        self._entered_as: str | None = None
        self._turn = AsyncExitStack()
        self._scope, self._receive, self._send, self._settings = scope, receive, send, settings
        self._started_at = time.perf_counter()
        self._bytes = 0
        self._waited_s = 0.0
        self._whole = False
        self._limit = body_limit(self.path, settings)

    @property
    def names(self) -> dict[str, str]:
        """What every line of the log carries: the id, and the caller's trace where it sends one (W3C trace context)."""
        found = _TRACEPARENT.fullmatch(Headers(scope=self._scope).get("traceparent", ""))
        if found is None or not int(found["trace"], 16) or not int(found["span"], 16):
            return {"request_id": self.request_id}
        return {"request_id": self.request_id, "trace_id": found["trace"], "parent_span_id": found["span"]}

    @property
    def started(self) -> bool:
        return self.status != 0

    @property
    def route(self) -> str:
        # a route of a router that was taken in knows its own part only; its context knows the whole
        taken_in = self._scope.get("fastapi", {}).get("effective_route_context")
        return getattr(taken_in or self._scope.get("route"), "path", None) or "none"

    def come(self, crowd: Crowd) -> None:
        """Come in beside others; who looks whether the process lives is never turned away.

        Raises
        ------
        TooMany, Unavailable
            with ``Retry-After``.
        """
        if self.path in _PROBES:
            return
        headers = Headers(scope=self._scope)
        client = self._scope.get("client")
        known = crowd.came(
            credential_of(headers), client[0] if client else "unknown", brings_bytes=self.method not in READING
        )
        for field in fields(Account):
            setattr(self.account, field.name, getattr(known, field.name))
        self._entered_as = known.tenant
        crowd.enter(known.tenant)

    @asynccontextmanager
    async def turn(self, crowd: Crowd) -> AsyncIterator[None]:
        """What a read waits for before it costs a thread; it ends where the answer begins, however slowly that is taken.

        Raises
        ------
        TooMany, Unavailable
            with ``Retry-After``, on entering.
        """
        async with self._turn:
            if self.method in READING and self._entered_as is not None:
                await self._turn.enter_async_context(crowd.reads.entered_by_task(self.account))
            yield

    async def answer_late(self, refused: Problem) -> None:
        """Refuse somebody who asks for too much, and not at once: who does not wait by themselves is made to."""
        if self.started:
            raise refused
        if _Late.n < _MOST_LATE:
            _Late.n += 1
            try:
                await asyncio.sleep(_LATE_S)
            finally:
                _Late.n -= 1
        await self.answer(refused)

    async def receive(self) -> Message:
        """Next part of the body, within the bounds of size and time."""
        if self._whole:
            return await self._receive()
        began = time.perf_counter()
        try:
            async with asyncio.timeout(self._patience_s()):
                message = await self._receive()
        except TimeoutError:
            self.refusal = TooSlow("the body does not arrive: send it again", headers={"Connection": "close"})
            raise self.refusal from None
        self._waited_s += time.perf_counter() - began
        if message["type"] == "http.disconnect":
            self.gone = True
            return message
        self._bytes += len(message.get("body", b""))
        self._whole = not message.get("more_body", False)
        if self._bytes > self._limit:
            self.refusal = too_large(self.path, self._settings)
            raise self.refusal
        return message

    async def send(self, message: Message) -> None:
        """Pass the answer on with what every answer carries; a refused body is answered by its refusal only."""
        if message["type"] == "http.response.start":
            if self.refusal is not None:
                raise self.refusal
            await self._turn.aclose()
            self._begin(message)
        elif message["type"] == "http.response.body" and self.method == "HEAD":
            await self._send({"type": "http.response.body", "body": b"", "more_body": False})
            raise _EnoughError
        await self._send(message)
        self.complete = message["type"] == "http.response.body" and not message.get("more_body", False)

    async def answer(self, problem: Problem) -> None:
        """Send a problem document."""
        self.refusal = None
        if problem.status == HTTPStatus.INTERNAL_SERVER_ERROR:
            problem.extra["request_id"] = self.request_id
        with suppress(_EnoughError):
            await ProblemResponse(problem)(self._scope, self._receive, self.send)

    def note(self, crowd: Crowd) -> None:
        """One line in the log, one count in the metrics, one charge."""
        if self._entered_as is not None:
            crowd.leave(self._entered_as)
            crowd.quotas.charge(self.account, self._bytes)
        seconds = time.perf_counter() - self._started_at
        method = self.method if self.method in _METHODS else "other"
        status = self.status if self.started and not (self.gone and self.status >= 400) else _GONE
        _REQUESTS.labels(method, self.route, status).inc()
        _SECONDS.labels(method, self.route).observe(seconds)
        who, whose = self.account.owner, self.account.operator
        log.info(
            "request",
            method=self.method,
            path=self.path,
            route=self.route,
            status=status,
            milliseconds=round(1000 * seconds, 1),
            bytes=self._bytes,
            principal=who,
            operator=whose,
        )

    def _begin(self, message: Message) -> None:
        self.status = message["status"]
        if self.status == HTTPStatus.INTERNAL_SERVER_ERROR:
            _ERRORS.labels(self.route).inc(exemplar={"request_id": self.request_id})
        tell_of(self.request_id, self.account.owner, self.account.operator)
        headers = MutableHeaders(scope=message)
        headers["X-Request-Id"] = self.request_id
        for name, value in _HEADERS.items():
            headers.setdefault(name, value)
        if self._scope["scheme"] == "https":
            headers.setdefault("Strict-Transport-Security", _HSTS)

    def _patience_s(self) -> float:
        """Time until the next part must be here [s]: a pause, as long as the whole is not slower than the slowest way."""
        pause = self._settings.body_stall_seconds
        return max(0.05, min(pause, pause + self._bytes / _SLOWEST_BYTES_PER_S - self._waited_s))
