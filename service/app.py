"""The application: parts put together, errors turned into problems, work of the last run picked up."""

import threading
import time
import uuid
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from http import HTTPStatus

import structlog
from fastapi import APIRouter, FastAPI, Request, Response
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from prometheus_client import Counter, Histogram
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException

import twin.warm_up
from service import __version__
from service.context import Context
from service.dashboard.pages import STATIC, page_router
from service.database import Database, pending_migration, upgrade
from service.errors import PROBLEM_JSON, Fault, Invalid, Problem
from service.ingest.parser_pool import ParserLimits, ParserPool
from service.ingest.raw import Limits
from service.jobs import engine
from service.monitoring.acceptance import Acceptance
from service.raw_store import RawStore
from service.routes import bulk, exports, fleet, jobs, keys, mappings, operations, pumps, records, spectrum, thresholds
from service.routes import twin as twin_routes
from service.settings import Settings
from service.spool import Spool

API_PREFIX = "/api/v1"
log = structlog.get_logger("casedrain")
_REQUESTS = Counter("casedrain_requests_total", "HTTP requests", ["method", "route", "status"])
_SECONDS = Histogram("casedrain_request_seconds", "Time to answer", ["method", "route"])


def create_app(settings: Settings) -> FastAPI:
    """Make the application for one set of settings; nothing is opened before it starts."""

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        context = opened(settings)
        app.state.context = context
        twin.warm_up.warm_up()
        worker = threading.Thread(target=_pick_up, args=(context,), name="pick-up", daemon=True)
        worker.start()
        await run_in_threadpool(engine.start, context)
        yield
        await run_in_threadpool(engine.stop)
        worker.join(timeout=5.0)
        context.close()

    app = FastAPI(
        title="casedrain",
        version=__version__,
        summary="Condition monitoring of hydraulic pumps from case and discharge pressure",
        lifespan=lifespan,
        responses={"default": {"description": "Problem", "content": {PROBLEM_JSON: {}}}},
    )
    api = APIRouter(prefix=API_PREFIX)
    for part in (bulk, records, spectrum, mappings, jobs, exports, pumps, fleet, thresholds, keys, twin_routes):
        api.include_router(part.router)
    app.include_router(api)
    app.include_router(operations.router)
    app.include_router(page_router)
    app.mount("/static", STATIC, name="static")
    app.add_exception_handler(Problem, _on_problem)
    app.add_exception_handler(RequestValidationError, _on_validation)
    app.add_exception_handler(HTTPException, _on_http)
    app.add_exception_handler(Exception, _on_anything)
    app.middleware("http")(_logged)
    return app


def opened(settings: Settings) -> Context:
    """Open database and raw store.

    An SQLite file is migrated; a Postgres database that is behind is left alone.

    Raises
    ------
    RuntimeError
        when a Postgres database is behind.
    """
    settings.data_dir.mkdir(parents=True, exist_ok=True)
    database = Database(settings.effective_database_url)
    behind = pending_migration(database)
    if behind is not None:
        if not database.is_sqlite:
            database.close()
            raise RuntimeError(behind)
        upgrade(settings.effective_database_url)
    raw_store = RawStore(settings.effective_raw_store_url)
    limits = Limits(settings.max_inflated_bytes, settings.max_rows)
    spool = Spool(settings.effective_spool_dir)
    parser_limits = ParserLimits(settings.max_parse_seconds, settings.max_parse_memory_bytes)
    parser = ParserPool(spool.folder, parser_limits, settings.parse_workers)
    acceptance = Acceptance(database, raw_store, limits, spool, parser)
    return Context(settings, database, raw_store, acceptance, spool, parser, limits)


def _pick_up(context: Context) -> None:
    """Analyse what a crash left stored but not analysed."""
    for record_id in context.acceptance.pending():
        try:
            context.acceptance.process(record_id)
        except Exception:
            log.exception("record left stored", record_id=record_id)


def _problem_response(problem: Problem) -> JSONResponse:
    return JSONResponse(
        problem.body(), status_code=int(problem.status), media_type=PROBLEM_JSON, headers=problem.headers
    )


async def _on_problem(_request: Request, error: Exception) -> Response:
    if not isinstance(error, Problem):
        raise TypeError("only problems come here")
    return _problem_response(error)


async def _on_validation(_request: Request, error: Exception) -> Response:
    if not isinstance(error, RequestValidationError):
        raise TypeError("only validation errors come here")
    faults = [Fault(".".join(str(p) for p in e["loc"]), e["msg"]) for e in error.errors()]
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


async def _on_anything(request: Request, error: Exception) -> Response:
    log.error("unexpected error", path=request.url.path, exc_info=error)
    return _problem_response(Problem("something went wrong on our side; the log has it under the request id"))


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
