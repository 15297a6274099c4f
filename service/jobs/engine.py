"""The durable engine: jobs as dbos workflows, in this process on SQLite, on any number of workers with Postgres.

dbos keeps one engine per process; several applications of one process (tests, a restart in place) share it as long as
they work on the same database.
"""

import threading
import time
from typing import Any

import structlog
from dbos import DBOS, DBOSConfig, SetWorkflowID, WorkflowStatus
from sqlalchemy.engine import make_url

from service.access.security import Principal
from service.answers.jobs import JobResult
from service.context import Context
from service.errors import Problem, Unavailable
from service.jobs import store
from service.jobs.kinds import Kind, Work, kind_named
from service.storage.tables import Job

log = structlog.get_logger("casedrain.jobs")
QUEUE = "casedrain-jobs"
CHUNK = 20
"""Items between two checkpoints of the workflow; each item is committed by itself."""
_POLLING_S = 0.5
_WATCH_INTERVAL_S = 20.0
_STOP_TIMEOUT_S = 10.0
_VERSION = "1"
"""Version of the workflow's shape: a process takes up what another of the same version has left."""


class _Engine:
    """What is running in this process."""

    def __init__(self, context: Context, url: str) -> None:
        self.context = context
        self.url = url
        self.users = 1
        self.stopping = threading.Event()
        self.running: set[str] = set()
        self.watcher = threading.Thread(target=_watch, args=(self,), name="job-watch", daemon=True)


_lock = threading.Lock()
_engine: _Engine | None = None


def start(context: Context) -> None:
    """Start the engine, which takes up what an earlier process has left unfinished.

    Raises
    ------
    RuntimeError
        when this process runs one on another database already.
    """
    global _engine  # noqa: PLW0603 - dbos keeps one engine per process, and so must we
    url = system_url(context.database.url)
    with _lock:
        if _engine is not None:
            if _engine.url != url:
                raise RuntimeError("this process runs jobs on another database already")
            _engine.users += 1
            _engine.context = context
            return
        started = _Engine(context, url)
        _engine = started
        config: DBOSConfig = {
            "name": "casedrain",
            "system_database_url": url,
            "application_version": _VERSION,
            "executor_id": context.settings.worker_name,
            "log_level": "ERROR",
            "enable_otlp": False,
            "sys_db_pool_size": 5,
            "notification_listener_polling_interval_sec": 1.0,
        }
        try:
            DBOS(config=config)
            DBOS.launch()
            DBOS.register_queue(
                QUEUE, worker_concurrency=context.settings.job_concurrency, polling_interval_sec=_POLLING_S
            )
        except Exception:
            _engine = None
            DBOS.destroy()
            raise
        started.watcher.start()


def stop() -> None:
    """Stop the engine; a running job ends its item and is taken up at the next start."""
    global _engine  # noqa: PLW0603
    with _lock:
        if _engine is None:
            return
        _engine.users -= 1
        if _engine.users:
            return
        _engine.stopping.set()
        _engine.watcher.join(timeout=5.0)
        deadline = time.monotonic() + _STOP_TIMEOUT_S
        while _engine.running and time.monotonic() < deadline:
            time.sleep(0.02)
        DBOS.destroy()
        _engine = None


def submit(job_id: str) -> None:
    """Hand a job that is committed to the queue.

    Raises
    ------
    Unavailable
        when no engine runs; the job is kept, and taken up by the next that does.
    """
    if _engine is None:
        raise Unavailable("no worker runs here: the job is stored and starts when one does")
    with SetWorkflowID(job_id):
        DBOS.enqueue_workflow(QUEUE, _run, job_id)


@DBOS.workflow(name="casedrain-job")
def _run(job_id: str) -> None:
    engine = _engine
    if engine is None:
        raise RuntimeError("a workflow without an engine")
    database = engine.context.database
    engine.running.add(job_id)
    try:
        with database.writing() as session:
            if not store.begin(session, job_id):
                return
            job = session.get_one(Job, job_id)
        _work(engine, job)
    except Problem as problem:
        with database.writing() as session:
            store.fail(session, job_id, problem)
    except _StoppedError:
        # raised on to dbos, which is stopping too and cannot note it: the workflow stays to be resumed
        raise
    except Exception:
        if engine.stopping.is_set():
            raise
        log.exception("job failed", job_id=job_id)
        with database.writing() as session:
            store.fail(session, job_id, Problem("something went wrong on our side; the log has it under the job's id"))
    finally:
        engine.running.discard(job_id)


class _StoppedError(BaseException):
    """The process shuts down in the middle of a job."""


def _work(engine: _Engine, job: Job) -> None:
    kind, work = kind_named(job.kind), _work_of(engine.context, job)
    database = engine.context.database
    with kind.opened(work) as state:
        total = kind.total(work, state)
        with database.writing() as session:
            done = store.set_total(session, job.id, total)
        for start_ in range(0, total, CHUNK):
            positions = [i for i in range(start_, min(start_ + CHUNK, total)) if i not in done]
            if positions and not _chunk(engine, kind, work, state, positions):
                break
        with database.reading() as session:
            counts = store.counts(session, job.id)
        whole = sum(counts.values()) >= total
        result: JobResult = kind.result(work, state, counts) if whole else {"counts": counts}
    with database.writing() as session:
        store.finish(session, job.id, result)


def _chunk(engine: _Engine, kind: Kind[Any, Any], work: Work[Any], state: Any, positions: list[int]) -> bool:
    """Work on some items; False when the job was cancelled."""
    for position in positions:
        if engine.stopping.is_set():
            raise _StoppedError
        item = kind.item(work, state, position)
        with engine.context.database.writing() as session:
            if not store.keep_item(session, work.job_id, position, item):
                return False
    return True


def _work_of(context: Context, job: Job) -> Work[Any]:
    kind = kind_named(job.kind)
    principal = Principal(job.author, kind.role, job.operator)
    return Work(job.id, context, principal, job.operator, kind.parameters.model_validate(job.parameters))


def _watch(engine: _Engine) -> None:
    """Take up jobs whose process is gone for good: after a worker was taken out of the fleet, nobody else would."""
    while not engine.stopping.wait(_WATCH_INTERVAL_S):
        try:
            with engine.context.database.writing() as session:
                store.note_heartbeat(session, list(engine.running))
                found = store.claimed_orphans(session)
            for job_id in found:
                log.info("job looked after", job_id=job_id)
                _take_up(job_id)
        except Exception:
            log.exception("looking for orphaned jobs failed")


def _take_up(job_id: str) -> None:
    status = DBOS.get_workflow_status(job_id)
    if status is None:
        submit(job_id)
    elif status.status != "ENQUEUED" and not _just_dequeued(status):  # who waits in the queue has not been forgotten
        DBOS.resume_workflow(job_id, queue_name=QUEUE)


def _just_dequeued(status: WorkflowStatus) -> bool:
    """True while a worker may have taken a job from the queue without having noted yet that it runs."""
    if status.status != "PENDING" or status.dequeued_at is None:
        return False
    return time.time() - 1e-3 * status.dequeued_at < store.ORPHANED_AFTER.total_seconds()


def system_url(url: str) -> str:
    """Where dbos keeps its tables: Postgres' own schema of the database, a file beside SQLite's."""
    parsed = make_url(url)
    if parsed.get_backend_name() == "sqlite":
        return f"sqlite:///{parsed.database}.jobs"
    return parsed.set(drivername="postgresql").render_as_string(hide_password=False)
