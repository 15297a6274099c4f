"""The application: parts put together, errors turned into problems, work of the last run picked up."""

import threading
import time
import uuid
from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from contextlib import asynccontextmanager
from datetime import UTC, datetime
from http import HTTPStatus
from urllib.parse import unquote_to_bytes

import structlog
from fastapi import APIRouter, FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from prometheus_client import Counter, Histogram
from sqlalchemy.exc import DataError, OperationalError
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException

import detectors.warm_up
from service import __version__
from service.alarms.ledger import catch_up
from service.context import Context
from service.errors import PROBLEM_JSON, Fault, Invalid, Problem, Unavailable
from service.jobs import engine
from service.monitoring.renewal import Renewal
from service.notifications.worker import Postman
from service.registry.deletion import finish_deletions
from service.registry.operators import expire
from service.running import opened
from service.settings import Settings
from service.web.answer_route import unknown_parameters
from service.web.api_document.document import openapi_document
from service.web.api_document.page import docs_router
from service.web.dashboard.actions import action_router
from service.web.dashboard.pages import STATIC, page_router
from service.web.dashboard.sign_in import sign_in_router
from service.web.routes import (
    aircraft,
    alarms,
    audit,
    bulk,
    circuits,
    exports,
    fleet,
    history,
    jobs,
    keys,
    mappings,
    operations,
    operators,
    pump_types,
    pumps,
    records,
    registry_files,
    spectrum,
    thresholds,
    twin_isolability,
    twin_simulation,
    users,
    webhooks,
)
from service.web.routes import twin as twin_routes

API_PREFIX = "/api/v1"
_DAY_S = 86_400.0
_LOOK_S = 20.0
_MET = ("40P01", "40001")
"""Postgres' codes of transactions that met: deadlock, serialization failure."""
log = structlog.get_logger("casedrain")
_REQUESTS = Counter("casedrain_requests_total", "HTTP requests", ["method", "route", "status"])
_SECONDS = Histogram("casedrain_request_seconds", "Time to answer", ["method", "route"])


def create_app(settings: Settings) -> FastAPI:
    """Make the application for one set of settings; nothing is opened before it starts."""

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        context = opened(settings)
        app.state.context = context
        detectors.warm_up.warm_up()
        stopped = threading.Event()
        worker = threading.Thread(target=_pick_up, args=(context, stopped), name="pick-up", daemon=True)
        keeper = threading.Thread(target=_keep_house, args=(context, stopped), name="keep-house", daemon=True)
        for thread in (worker, keeper):
            thread.start()
        postman = Postman(context.database, settings)
        postman.start()
        await run_in_threadpool(engine.start, context)
        yield
        await run_in_threadpool(engine.stop)
        stopped.set()
        postman.stop()
        for thread in (worker, keeper):
            thread.join(timeout=5.0)
        context.close()

    app = FastAPI(
        title="casedrain",
        version=__version__,
        summary="Condition monitoring of hydraulic pumps from case and discharge pressure",
        lifespan=lifespan,
        docs_url=None,
        redoc_url=None,
    )
    app.openapi = lambda: openapi_document(app)  # type: ignore[method-assign]
    api = APIRouter(prefix=API_PREFIX)
    for part in (
        bulk,
        records,
        spectrum,
        mappings,
        jobs,
        exports,
        pumps,
        history,
        aircraft,
        circuits,
        pump_types,
        registry_files,
        operators,
        fleet,
        alarms,
        thresholds,
        keys,
        users,
        webhooks,
        audit,
        twin_routes,
        twin_isolability,
        twin_simulation,
    ):
        api.include_router(part.router)
    app.include_router(api)
    app.include_router(operations.router)
    app.include_router(page_router)
    app.include_router(action_router)
    app.include_router(sign_in_router)
    app.include_router(docs_router)
    app.mount("/static", STATIC, name="static")
    app.add_exception_handler(Problem, _on_problem)
    app.add_exception_handler(RequestValidationError, _on_validation)
    app.add_exception_handler(HTTPException, _on_http)
    app.add_exception_handler(OperationalError, _on_met)
    app.add_exception_handler(DataError, _on_unstorable)
    app.add_exception_handler(Exception, _on_anything)
    app.middleware("http")(_addressed)
    app.middleware("http")(_logged)
    return app


def _pick_up(context: Context, stopped: threading.Event) -> None:
    """Take up what others have left: records of a crash, alarms and verdicts of older releases; then look again."""
    renewal = Renewal(context.database, context.archive)
    _process(context, context.acceptance.pending())
    try:
        catch_up(context.database)
    except Exception:
        log.exception("alarms of older histories wait for the pumps' next records")
    while True:
        try:
            renewal.run(stopped)
            _process(context, context.acceptance.left())
        except Exception:
            log.exception("what other releases have left waits for the next look")
        if stopped.wait(_LOOK_S):
            return


def _process(context: Context, record_ids: Sequence[str]) -> None:
    for record_id in record_ids:
        try:
            context.acceptance.process(record_id)
        except Exception:
            log.exception("record left stored", record_id=record_id)


def _keep_house(context: Context, stopped: threading.Event) -> None:
    """End deletions that a crash interrupted, and let raw bytes expire once a day; any number of replicas may."""
    while True:
        try:
            finish_deletions(context.database, context.raw_store)
            expire(context.database, context.raw_store, datetime.now(UTC))
        except Exception:
            log.exception("deletions or expiry left for the next time")
        if stopped.wait(_DAY_S):
            return


def _problem_response(problem: Problem) -> JSONResponse:
    return JSONResponse(
        problem.body(), status_code=int(problem.status), media_type=PROBLEM_JSON, headers=problem.headers
    )


async def _on_problem(_request: Request, error: Exception) -> Response:
    if not isinstance(error, Problem):
        raise TypeError("only problems come here")
    return _problem_response(error)


async def _on_validation(request: Request, error: Exception) -> Response:
    if not isinstance(error, RequestValidationError):
        raise TypeError("only validation errors come here")
    faults = [Fault(".".join(str(p) for p in e["loc"]), e["msg"]) for e in error.errors()]
    faults += unknown_parameters(request)
    return _problem_response(Invalid(f"the request has {len(faults)} fault(s)", faults))


async def _on_http(_request: Request, error: Exception) -> Response:
    if not isinstance(error, HTTPException):
        raise TypeError("only HTTP errors come here")
    title = HTTPStatus(error.status_code).phrase
    body = {
        "type": f"urn:casedrain:problem:{title.lower().replace(' ', '-')}",
        "title": title,
        "status": error.status_code,
        "detail": str(error.detail),
    }
    return JSONResponse(body, status_code=error.status_code, media_type=PROBLEM_JSON, headers=error.headers)


async def _on_met(request: Request, error: Exception) -> Response:
    if getattr(getattr(error, "orig", None), "sqlstate", None) not in _MET:
        return await _on_anything(request, error)
    detail = "another change of the same pumps was under way; nothing was changed: repeat the request"
    return _problem_response(Unavailable(detail, headers={"Retry-After": "1"}))


async def _on_unstorable(_request: Request, _error: Exception) -> Response:
    # Postgres refuses a NUL character where SQLite takes it: what cannot be stored cannot be found either
    return _problem_response(
        Invalid("the request holds characters or numbers that cannot be stored; nothing was changed")
    )


async def _on_anything(request: Request, error: Exception) -> Response:
    log.error("unexpected error", path=request.url.path, exc_info=error)
    return _problem_response(Problem("something went wrong on our side; the log has it under the request id"))


async def _addressed(request: Request, answer: Callable[[Request], Awaitable[Response]]) -> Response:
    """Refuse a NUL in the address: Postgres would refuse the query that it makes, SQLite would find nothing."""
    parts = {"path": request.scope["path"], "query": unquote_to_bytes(request.scope["query_string"]).decode("latin-1")}
    faults = [Fault(where, "holds a NUL character") for where, text in parts.items() if "\x00" in text]
    if faults:
        return _problem_response(Invalid(f"the request has {len(faults)} fault(s)", faults))
    return await answer(request)


async def _logged(request: Request, answer: Callable[[Request], Awaitable[Response]]) -> Response:
    """Log and count every request under an id that the answer carries."""
    request_id = uuid.uuid4().hex[:12]
    started = time.perf_counter()
    with structlog.contextvars.bound_contextvars(request_id=request_id):
        response = await answer(request)
        seconds = time.perf_counter() - started
        route = getattr(request.scope.get("route"), "path", "none")
        _REQUESTS.labels(request.method, route, response.status_code).inc()
        _SECONDS.labels(request.method, route).observe(seconds)
        log.info(
            "request",
            method=request.method,
            path=request.url.path,
            status=response.status_code,
            milliseconds=round(1000 * seconds, 1),
        )
    response.headers["X-Request-Id"] = request_id
    return response
