"""Liveness, readiness and metrics, without prefix and without a key."""

from concurrent.futures import ThreadPoolExecutor
from concurrent.futures import TimeoutError as TookTooLong

from fastapi import APIRouter, Response
from fastapi.responses import JSONResponse
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest

from service.answers.operations import Alive, Readiness
from service.context import Context
from service.identity import software
from service.storage.database import pending_migration
from service.web.answer_route import AnswerRoute
from service.web.dependencies import ContextOf

router = APIRouter(tags=["operations"], route_class=AnswerRoute)
READY_TIMEOUT_S = 5.0
_probes = ThreadPoolExecutor(max_workers=4, thread_name_prefix="readyz")


@router.get("/healthz", summary="Is the process alive")
def alive() -> Alive:
    """Answers as long as the process serves."""
    return {"status": "alive"}


@router.get("/readyz", summary="Can it do its work", response_model=Readiness)
def ready(context: ContextOf) -> JSONResponse:
    """Asks database, schema and raw store, each within a few seconds; says which software answers."""
    waiting = {name: _probes.submit(check, context) for name, check in _CHECKS.items()}
    checks = {}
    for name, probe in waiting.items():
        try:
            checks[name] = probe.result(READY_TIMEOUT_S) or "ok"
        except TookTooLong:
            checks[name] = f"no answer within {READY_TIMEOUT_S:g} s"
        except Exception as error:
            checks[name] = type(error).__name__
    good = all(answer == "ok" for answer in checks.values())
    body: Readiness = {
        "status": "ready" if good else "not ready",
        "checks": checks,
        "software": software().to_json(),
    }
    return JSONResponse(body, status_code=200 if good else 503)


@router.get("/metrics", summary="Prometheus metrics", response_class=Response)
def metrics() -> Response:
    """Counters and timings of this process."""
    return Response(generate_latest(), media_type=CONTENT_TYPE_LATEST)


def _database(context: Context) -> str | None:
    context.database.ping()
    return pending_migration(context.database)


def _raw_store(context: Context) -> str | None:
    context.raw_store.ping()
    return None


_CHECKS = {"database": _database, "raw_store": _raw_store}
