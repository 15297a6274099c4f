"""Jobs as workflows: the whole of one, which may be shared out in parts, and a part of one; items are the truth."""

from collections.abc import Callable, Sequence
from threading import Event
from typing import Any

import structlog
from dbos import DBOS, SetWorkflowID
from dbos import error as engine_errors

from service.access.security import Principal
from service.answers.jobs import JobResult
from service.context import Context
from service.errors import Problem
from service.jobs import state, store
from service.jobs.kinds import Kind, Work, kind_named
from service.jobs.state import JOBS, Engine, StoppedError
from service.storage.failures import is_passing
from service.storage.tables import Job

log = structlog.get_logger("casedrain.jobs")
CHUNK = 20
"""Fewest items that are worth a part of their own."""
AT_ONCE = "at_once"
"""Parameter of a job that the process which stored it works on itself, right after its answer."""
MOST_DEATHS = 10
"""Workers that a job may lose in turn without an item done before it is taken for what kills them (our choice)."""
_OURS = "something went wrong on our side; the log has it under the job's id"
_DEADLY = f"{MOST_DEATHS} workers in turn have ended while they worked on this, without one item done"


@DBOS.workflow(name="casedrain-job")
def whole(job_id: str, generation: int, deaths: int, undone: int) -> None:
    """Work on all that is undone of a job, or share it out between workers.

    Parameters
    ----------
    generation
        Number of this attempt; the one before it was lost with its worker, or the engine ended it.
    deaths, undone
        Attempts in turn that were lost with as many items undone, and that number; -1 before it is known.
    """
    _run(job_id, lambda engine: _whole(engine, job_id, generation))


@DBOS.workflow(name="casedrain-part")
def part(job_id: str, first: int, last: int, deaths: int, undone: int) -> None:
    """Work on the items ``first`` up to before ``last`` of a job."""
    _run(job_id, lambda engine: _part(engine, job_id, range(first, last)))


def begin_whole(job_id: str, generation: int, deaths: int, undone: int) -> None:
    """Hand a job to the queue; the same attempt is handed over once, whoever does it."""
    with SetWorkflowID(f"{job_id}/{generation}"):
        DBOS.enqueue_workflow(JOBS, whole, job_id, generation, deaths, undone)


def begin_part(name: str, attempt: int, job_id: str, first: int, last: int, deaths: int, undone: int) -> None:
    """Hand a part of a job to the queue; ``name`` is its own without the number of the attempt."""
    with SetWorkflowID(f"{name}.{attempt}"):
        DBOS.enqueue_workflow(JOBS, part, job_id, first, last, deaths, undone)


def work_off(context: Context, job_id: str) -> None:
    """Work on a whole job here and now; where that is interrupted, the lookout takes it up."""
    try:
        _alone(context, job_id)
    except Exception as error:
        if is_passing(error):
            log.warning("a job waits for the lookout", job_id=job_id, error=str(error)[:200])
            return
        if not isinstance(error, Problem):
            log.exception("job failed", job_id=job_id)
        _fail(context, job_id, error if isinstance(error, Problem) else Problem(_OURS))


def end_as_deadly(context: Context, job_id: str) -> None:
    """A job that ends its workers is given up with a sentence."""
    with context.database.writing() as session:
        store.fail(session, job_id, Problem(_DEADLY))


def _run(job_id: str, body: Callable[[Engine], None]) -> None:
    engine = state.current()
    with engine.at_work(DBOS.workflow_id):
        try:
            engine.lastingly(f"job {job_id}", lambda: body(engine))
        except engine_errors.DBOSException:
            raise  # about the workflow, not the job: the row is looked at again
        except Exception as error:
            if not isinstance(error, Problem):
                log.exception("job failed", job_id=job_id)
            problem = error if isinstance(error, Problem) else Problem(_OURS)
            engine.lastingly(f"end of job {job_id}", lambda: _fail(engine.context, job_id, problem))


def _fail(context: Context, job_id: str, problem: Problem) -> None:
    with context.database.writing() as session:
        store.fail(session, job_id, problem)


def _begun(context: Context, job_id: str) -> tuple[Kind[Any, Any], Work[Any]] | None:
    with context.database.writing() as session:
        if not store.begin(session, job_id):
            return None
        job = session.get_one(Job, job_id)
        return kind_named(job.kind), _work_of(context, job)


def _alone(context: Context, job_id: str) -> None:
    begun = _begun(context, job_id)
    if begun is None:
        return
    kind, work = begun
    with kind.opened(work) as opened:
        total = kind.total(work, opened)
        with context.database.writing() as session:
            done = store.set_total(session, job_id, total)
        _work(kind, work, opened, [i for i in range(total) if i not in done])


def _whole(engine: Engine, job_id: str, generation: int) -> None:
    begun = _begun(engine.context, job_id)
    if begun is None:
        return
    kind, work = begun
    with kind.opened(work) as opened:
        total = kind.total(work, opened)
        with engine.context.database.writing() as session:
            done = store.set_total(session, job_id, total)
        parts = _parts(engine, kind, total)
        if len(parts) <= 1:
            _work(kind, work, opened, [i for i in range(total) if i not in done], engine.stopping)
            return
    for its in parts:
        undone = sum(i not in done for i in its)
        if undone:
            begin_part(f"{job_id}/{generation}/{its.start}", 0, job_id, its.start, its.stop, 0, undone)


def _part(engine: Engine, job_id: str, its: range) -> None:
    begun = _begun(engine.context, job_id)
    if begun is None:
        return
    kind, work = begun
    with engine.context.database.reading() as session:
        done = store.done_of(session, job_id, its.start, its.stop)
    with kind.opened(work) as opened:
        _work(kind, work, opened, [i for i in its if i not in done], engine.stopping)


def _parts(engine: Engine, kind: Kind[Any, Any], total: int) -> list[range]:
    """Ranges of items in order, one without anybody to share with."""
    if engine.n_workers * engine.context.settings.job_concurrency == 1:
        return [range(total)]
    size = max(CHUNK, -(-total // kind.most_parts))
    return [range(i, min(i + size, total)) for i in range(0, total, size)]


def _work(
    kind: Kind[Any, Any], work: Work[Any], opened: Any, positions: Sequence[int], stopping: Event | None = None
) -> None:
    """Work on some items, and end the job where they were the last ones."""
    database = work.context.database
    for position in positions:
        if stopping is not None and stopping.is_set():
            raise StoppedError
        item = kind.item(work, opened, position)
        with database.writing() as session:
            if not store.keep_item(session, work.job_id, position, item):
                break
    with database.reading() as session:
        job, counts = session.get(Job, work.job_id), store.counts(session, work.job_id)
    if job is None:
        return  # deleted with its operator
    is_whole = job.total is not None and sum(counts.values()) >= job.total
    if not is_whole and not job.cancel_requested:
        return  # others have parts in hand, or will
    result: JobResult = kind.result(work, opened, counts) if is_whole else {"counts": counts}
    with database.writing() as session:
        store.finish(session, work.job_id, result)


def _work_of(context: Context, job: Job) -> Work[Any]:
    kind = kind_named(job.kind)
    principal = Principal(job.author, kind.role, job.operator)
    return Work(job.id, context, principal, job.operator, kind.parameters.model_validate(job.parameters))
