"""Liveness, readiness and metrics, without prefix and without a key."""

import asyncio
from concurrent.futures import ThreadPoolExecutor
from typing import Annotated, cast

from fastapi import APIRouter, Header, Request, Response
from fastapi.responses import JSONResponse
from prometheus_client import CollectorRegistry
from prometheus_client.exposition import choose_encoder

from service.answers.operations import Alive, Readiness
from service.context import Context
from service.identity import software
from service.storage.database import pending_migration
from service.storage.disk import shortage
from service.web.answer_route import AnswerRoute
from service.web.dependencies import ContextOf
from service.web.metrics import Everything

router = APIRouter(tags=["operations"], route_class=AnswerRoute)
READY_TIMEOUT_S = 2.0
_probes = ThreadPoolExecutor(max_workers=4, thread_name_prefix="readyz")


@router.get("/healthz", summary="Is the process alive")
async def alive() -> Alive:
    """Answers as long as the process serves, whatever the database and the threads of other requests do."""
    return {"status": "alive"}


@router.get("/readyz", summary="Can it do its work", response_model=Readiness)
async def ready(request: Request, context: ContextOf) -> JSONResponse:
    """Asks database, schema, raw store and the room on the disks, each within two seconds; says which software answers.

    A process that is about to stop says so here first.
    """
    waiting = {name: asyncio.wrap_future(_probes.submit(check, context)) for name, check in _CHECKS.items()}
    await asyncio.wait(waiting.values(), timeout=READY_TIMEOUT_S)
    checks = {name: _said(probe) for name, probe in waiting.items()}
    if getattr(request.app.state, "is_stopping", False):
        checks["process"] = "is stopping"
    good = all(answer == "ok" for answer in checks.values())
    body: Readiness = {
        "status": "ready" if good else "not ready",
        "checks": checks,
        "software": software().to_json(),
    }
    return JSONResponse(body, status_code=200 if good else 503)


@router.get("/metrics", summary="Prometheus metrics", response_class=Response)
def metrics(context: ContextOf, accept: Annotated[str, Header(include_in_schema=False)] = "") -> Response:
    """Counters and timings of this process, and the installation's queues; as OpenMetrics errors name their last request."""
    encode, media_type = choose_encoder(accept)
    return Response(encode(cast("CollectorRegistry", Everything(context))), media_type=media_type)


def _said(probe: asyncio.Future[str | None]) -> str:
    if not probe.done():
        # a thread that hangs in a driver cannot be stopped: what it says later is nobody's business
        probe.add_done_callback(lambda late: late.cancelled() or late.exception())
        return f"no answer within {READY_TIMEOUT_S:g} s"
    error = probe.exception()
    return type(error).__name__ if error is not None else probe.result() or "ok"


def _database(context: Context) -> str | None:
    context.database.ping()
    return pending_migration(context.database)


def _raw_store(context: Context) -> str | None:
    context.raw_store.ping()
    return None


def _disk(context: Context) -> str | None:
    folders = [context.spool.folder, *context.raw_store.folders, *context.database.folders]
    return shortage(folders, context.settings.min_free_bytes)


_CHECKS = {"database": _database, "raw_store": _raw_store, "disk": _disk}
