"""The application: parts put together, errors turned into problems, work of the last run picked up."""

import threading
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from datetime import UTC, datetime

import structlog
from fastapi import APIRouter, Depends, FastAPI
from starlette.concurrency import run_in_threadpool

import detectors.warm_up
from service import __version__
from service.alarms.ledger import catch_up
from service.context import Context
from service.jobs import engine
from service.monitoring.renewal import Renewal
from service.notifications.worker import Postman
from service.registry.deletion import finish_deletions
from service.registry.operators import expire
from service.running import opened
from service.settings import Settings
from service.web.addresses import API_PREFIX
from service.web.api_document.document import openapi_document
from service.web.api_document.page import docs_router
from service.web.dashboard.frame import STATIC
from service.web.dashboard.routers import dashboard_router
from service.web.edge import Edge
from service.web.foreign import Foreign
from service.web.problems import handle_problems
from service.web.routes import (
    aircraft,
    alarms,
    audit,
    bulk,
    bundles,
    circuits,
    exports,
    fleet,
    history,
    jobs,
    keys,
    mappings,
    marks,
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
from service.web.whole_names import WholeNames, whole_names
from service.web.wire import Wire

_DAY_S = 86_400.0
_LOOK_S = 20.0
log = structlog.get_logger("casedrain")


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
        dependencies=[Depends(whole_names)],
    )
    app.openapi = lambda: openapi_document(app)  # type: ignore[method-assign]
    api = APIRouter(prefix=API_PREFIX)
    for part in (
        bulk,
        records,
        marks,
        spectrum,
        mappings,
        jobs,
        exports,
        pumps,
        bundles,
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
    app.include_router(dashboard_router)
    app.include_router(docs_router)
    app.mount("/static", STATIC, name="static")
    handle_problems(app)
    app.add_middleware(WholeNames)
    app.add_middleware(Foreign)
    app.add_middleware(Wire)
    app.add_middleware(Edge)
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
