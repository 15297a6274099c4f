"""Jobs in the database: made, listed, counted forward, ended."""

import uuid
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import Select, func, select, tuple_, update
from sqlalchemy.orm import Session

from service.access.security import Principal
from service.answers.documents import JsonObject
from service.answers.jobs import JobResult
from service.errors import Conflict, NotFound, Problem
from service.jobs.kinds import NAME_LENGTH, Item
from service.storage.tables import CANCELLED, FAILED, QUEUED, RUNNING, SUCCEEDED, Job, JobItem

UNFINISHED = (QUEUED, RUNNING)
MOST_SHOWN = 500


def new_job(session: Session, kind: str, operator: str | None, author: str, parameters: JsonObject) -> Job:
    """Add a queued job."""
    job = Job(
        id=uuid.uuid4().hex,
        operator=operator,
        kind=kind,
        status=QUEUED,
        done=0,
        total=None,
        parameters=parameters,
        result=None,
        problem=None,
        cancel_requested=False,
        author=author,
        created_at=datetime.now(UTC),
        started_at=None,
        finished_at=None,
        heartbeat_at=None,
    )
    session.add(job)
    session.flush()
    return job


def job_of(session: Session, principal: Principal, job_id: str) -> Job:
    """One job.

    Raises
    ------
    NotFound
        when there is none that this principal may see.
    """
    job = session.get(Job, job_id)
    if job is None or principal.operator not in (None, job.operator):
        raise NotFound(f"there is no job {job_id}")
    return job


def jobs(principal: Principal, kind: str | None, status: str | None, after: Sequence[Any] | None) -> Select[Job]:
    """Jobs that a principal may see, the newest first."""
    query = select(Job)
    if principal.operator is not None:
        query = query.where(Job.operator == principal.operator)
    if kind is not None:
        query = query.where(Job.kind == kind)
    if status is not None:
        query = query.where(Job.status == status)
    if after is not None:
        query = query.where(tuple_(Job.created_at, Job.id) < (datetime.fromisoformat(after[0]), after[1]))
    return query.order_by(Job.created_at.desc(), Job.id.desc())


def same_waiting(session: Session, kind: str, operator: str | None, author: str, parameters: JsonObject) -> Job | None:
    """A job that waits to do just this: asking twice starts one. A running one has begun on older data."""
    query = select(Job).where(
        Job.kind == kind,
        Job.operator == operator if operator is not None else Job.operator.is_(None),
        Job.author == author,
        Job.status == QUEUED,
        Job.cancel_requested.is_(False),
    )
    return next((job for job in session.scalars(query) if job.parameters == parameters), None)


def items(job_id: str, after: int | None = None) -> Select[JobItem]:
    """Items of a job in order."""
    query = select(JobItem).where(JobItem.job_id == job_id)
    if after is not None:
        query = query.where(JobItem.position > after)
    return query.order_by(JobItem.position)


def ask_to_cancel(session: Session, job: Job, *, in_hand: bool) -> None:
    """Cancel a job: at once, or between two items where a worker has one of it ``in_hand``.

    Raises
    ------
    Conflict
        when it has ended already.
    """
    if job.status not in UNFINISHED:
        raise Conflict(f"job {job.id} has ended already: it is {job.status}")
    job.cancel_requested = True
    if job.status == QUEUED or not in_hand:
        _end(job, CANCELLED)


def begin(session: Session, job_id: str) -> bool:
    """Note that a job runs now; False when it must not: it has ended, or is cancelled now as somebody has asked."""
    job = session.get(Job, job_id, with_for_update=True)
    if job is None or job.status not in UNFINISHED:
        return False
    if job.cancel_requested:
        job.result = {"counts": counts(session, job_id)}
        _end(job, CANCELLED)
        return False
    now = datetime.now(UTC)
    job.status, job.heartbeat_at = RUNNING, now
    job.started_at = job.started_at or now
    return True


def set_total(session: Session, job_id: str, total: int) -> set[int]:
    """Note the number of items, and say which are done already."""
    session.execute(update(Job).where(Job.id == job_id).values(total=total))
    return set(session.scalars(select(JobItem.position).where(JobItem.job_id == job_id)))


def done_of(session: Session, job_id: str, first: int, last: int) -> set[int]:
    """Items from ``first`` up to before ``last`` that are done."""
    query = select(JobItem.position).where(JobItem.job_id == job_id)
    return set(session.scalars(query.where(JobItem.position >= first, JobItem.position < last)))


def keep_item(session: Session, job_id: str, position: int, item: Item) -> bool:
    """Store an item's result and count it, once whoever works on it; False when the job shall go no further."""
    job = session.get(Job, job_id, with_for_update=True)
    if job is None or job.status != RUNNING:
        return False
    if session.get(JobItem, (job_id, position)) is None:
        session.add(
            JobItem(
                job_id=job_id, position=position, name=item.name[:NAME_LENGTH], status=item.status, detail=item.detail
            )
        )
        job.done += 1
    job.heartbeat_at = datetime.now(UTC)
    return not job.cancel_requested


def counts(session: Session, job_id: str) -> dict[str, int]:
    """Number of items by status."""
    query = select(JobItem.status, func.count()).where(JobItem.job_id == job_id).group_by(JobItem.status)
    return {status: int(n) for status, n in sorted(session.execute(query))}


def finish(session: Session, job_id: str, result: JobResult) -> None:
    """The job has worked on all of its items, or was asked to stop before."""
    job = session.get(Job, job_id, with_for_update=True)
    if job is not None and job.status == RUNNING:
        job.result = result
        _end(job, SUCCEEDED if job.total is not None and job.done >= job.total else CANCELLED)


def fail(session: Session, job_id: str, problem: Problem) -> None:
    """The job cannot go on."""
    job = session.get(Job, job_id, with_for_update=True)
    if job is not None and job.status in UNFINISHED:
        job.problem = problem.body()
        _end(job, FAILED)


def unfinished(session: Session, limit: int) -> list[Job]:
    """Jobs that have not ended, the oldest first."""
    query = select(Job).where(Job.status.in_(UNFINISHED)).order_by(Job.created_at, Job.id)
    return list(session.scalars(query.limit(limit)))


def _end(job: Job, status: str) -> None:
    job.status, job.finished_at = status, datetime.now(UTC)
