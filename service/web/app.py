"""The application: parts put together, errors turned into problems."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

from fastapi import APIRouter, Depends, FastAPI
from starlette.concurrency import run_in_threadpool

import detectors.warm_up
from service import __version__
from service.jobs import engine
from service.running import opened
from service.settings import Settings
from service.web.addresses import API_PREFIX
from service.web.api_document.document import openapi_document
from service.web.api_document.page import docs_router
from service.web.dashboard.frame import STATIC
from service.web.dashboard.routers import dashboard_router
from service.web.dependencies import settled
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
from service.web.traces import telemetry
from service.web.whole_names import WholeNames, whole_names
from service.web.wire import Wire


def create_app(settings: Settings) -> FastAPI:
    """Make the application for one set of settings; nothing is opened before it starts."""

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        context = opened(settings)
        app.state.context = context
        detectors.warm_up.warm_up()
        await run_in_threadpool(engine.start, context)
        yield
        await run_in_threadpool(engine.stop)
        if tracer is not None:
            await run_in_threadpool(tracer.shutdown)
        context.close()

    told, tracer = telemetry(settings)
    app = FastAPI(
        telemetry=told,
        title="casedrain",
        version=__version__,
        summary="Condition monitoring of hydraulic pumps from case and discharge pressure",
        lifespan=lifespan,
        docs_url=None,
        redoc_url=None,
        dependencies=[Depends(whole_names), Depends(settled)],
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
