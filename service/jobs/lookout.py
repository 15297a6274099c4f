"""The lookout: one question every two seconds whether the rows hold work that nobody has in hand, and who takes it.

dbos is launched while there is work and destroyed when there has been none for a while: at rest it would ask its database
some twenty times a second, and so would its own schedules, which are workflows too.
"""

import logging
import sys
import time
import uuid
from collections.abc import Callable, Collection
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import structlog
from dbos import DBOS, DBOSConfig, SetEnqueueOptions, SetWorkflowID, WorkflowStatus
from sqlalchemy import exists, select

from service.jobs import store, upkeep, work
from service.jobs.state import JOBS, RECORDS, UPKEEP, VERSION, Engine
from service.notifications.worker import is_due
from service.storage.failures import is_passing
from service.storage.tables import Delivery, Job, Record

log = structlog.get_logger("casedrain.jobs")
LOOK_S = 2.0
LINGER_S = 20.0
"""How long dbos stays launched without work."""
RENEWAL_S = 20.0
_HOUR_S = 3600.0
_POLLING_S = 0.25
_CLAIMED_S = 15.0
"""A workflow that this very process took from the queue must have begun within so long."""
_MOST_JOBS = 200
_ACTIVE = ["ENQUEUED", "PENDING", "DELAYED"]


@dataclass(slots=True)
class _Memory:
    """What the lookout remembers from look to look; instants of the monotonic clock [s]."""

    began: datetime
    worked_at: float
    renewal_at: float
    hour: str
    missing: dict[str, float]
    is_away: bool = False


def look_out(engine: Engine) -> None:
    """Look until the process stops."""
    now = time.monotonic()
    memory = _Memory(datetime.now(UTC), now, now, "", {})
    while not engine.stopping.is_set():
        times = memory.renewal_at, memory.hour
        try:
            _look(engine, memory)
            memory.is_away = False
        except Exception as error:
            memory.renewal_at, memory.hour = times  # what was due is due still
            if not is_passing(error):
                log.exception("looking for work failed")
            elif not memory.is_away:
                log.warning("the database is away; whatever is acknowledged waits in it", error=str(error)[:200])
            memory.is_away = is_passing(error)
        engine.called.wait(LOOK_S)
        engine.called.clear()


def awake(engine: Engine) -> None:
    """Launch dbos where it is not."""
    if engine.awake:
        return
    settings = engine.context.settings
    config: DBOSConfig = {
        "name": "casedrain",
        "system_database_url": engine.url,
        "application_version": VERSION,
        "executor_id": engine.name,
        "log_level": "ERROR",
        "enable_otlp": False,
        "sys_db_pool_size": 5,
        "notification_listener_polling_interval_sec": 1.0,
    }
    for handler in logging.getLogger("dbos").handlers:  # made at its import, for what was the stream then
        if type(handler) is logging.StreamHandler:
            handler.stream = sys.stderr
    try:
        DBOS(config=config)
        DBOS.launch()
        for name, at_once in ((JOBS, settings.job_concurrency), (RECORDS, settings.parse_workers), (UPKEEP, None)):
            DBOS.register_queue(name, worker_concurrency=at_once, polling_interval_sec=_POLLING_S)
    except Exception:
        DBOS.destroy()
        raise
    engine.awake = True


def _look(engine: Engine, memory: _Memory) -> None:
    now = datetime.now(UTC)
    jobs, stored, due = engine.presence.seen(
        select(
            exists(select(Job.id).where(Job.status.in_(store.UNFINISHED))),
            exists(select(Record.id).where(upkeep.is_stored())),
            exists(select(Delivery.id).where(is_due(now))),
        )
    )
    wanted: list[tuple[str, Callable[[], Any]]] = []
    if engine.upkeep:
        wanted = _upkeep(engine, memory, now, stored=stored, due=due)
    if not jobs and not wanted:
        if engine.awake and not engine.running and time.monotonic() - memory.worked_at > LINGER_S:
            DBOS.destroy()
            engine.awake = False
        return
    awake(engine)
    memory.worked_at = time.monotonic()
    active = DBOS.list_workflows(status=_ACTIVE, app_version=VERSION, load_input=False, load_output=False)
    alive = _without_lost(engine, memory, active)
    for name, begin in wanted:
        if name not in {_name_of(w) for w in alive}:
            _once(name, begin)
    if jobs:
        engine.n_workers = engine.presence.number()
        _take_up(engine, {w.workflow_id.partition("/")[0] for w in alive})


def _upkeep(
    engine: Engine, memory: _Memory, now: datetime, *, stored: bool, due: bool
) -> list[tuple[str, Callable[[], Any]]]:
    """Workflows that should be at work, by a name under which there is one at a time."""
    wanted: list[tuple[str, Callable[[], Any]]] = []
    if stored:
        slots = {upkeep.slot_of(i) for i in upkeep.waiting(engine, memory.began)}
        since = memory.began.isoformat()
        wanted += [(f"records-{n}", _records(n, since)) for n in sorted(slots)]
    if due:
        wanted.append(("deliveries", lambda: DBOS.enqueue_workflow(UPKEEP, upkeep.deliveries)))
    if time.monotonic() >= memory.renewal_at:
        memory.renewal_at = time.monotonic() + RENEWAL_S
        if engine.renewal.due():
            name = f"renewal-{engine.name}"
            wanted.append((name, lambda: DBOS.enqueue_workflow(UPKEEP, upkeep.renewal)))
    hour = now.strftime("%Y-%m-%dT%H")
    if hour != memory.hour:
        # once an hour by whoever is first, and at every start
        number, memory.hour = hour if memory.hour else f"{hour}-{engine.name}", hour
        wanted.append((f"housekeeping-{number}", lambda: DBOS.enqueue_workflow(UPKEEP, upkeep.housekeeping)))
    return wanted


def _records(slot: int, since: str) -> Callable[[], Any]:
    return lambda: DBOS.enqueue_workflow(RECORDS, upkeep.records, slot, since)


def _once(name: str, begin: Callable[[], Any]) -> None:
    """Hand a workflow over unless another worker has done so in this moment."""
    number = "0" if name.startswith("housekeeping-") else uuid.uuid4().hex
    with (
        SetWorkflowID(f"{name}/{number}"),
        SetEnqueueOptions(deduplication_id=name, duplication_policy="return-existing"),
    ):
        begin()


def _name_of(workflow: WorkflowStatus) -> str:
    return workflow.workflow_id.partition("/")[0]


def _without_lost(engine: Engine, memory: _Memory, active: Collection[WorkflowStatus]) -> list[WorkflowStatus]:
    """Workflows that are queued or in a living worker's hand; what dead ones had is ended, and parts of jobs go on."""
    pending = [w for w in active if w.status == "PENDING" and w.executor_id]
    others = {w.executor_id for w in pending if w.executor_id and w.executor_id != engine.name}
    living = engine.presence.living(others) if others else set()
    now = time.monotonic()
    memory.missing = {name: memory.missing.get(name, now) for name in others - living}
    dead = {name for name, since in memory.missing.items() if now - since >= engine.presence.grace_s}
    lost = [w for w in pending if w.executor_id in dead or _is_dropped(engine, w)]
    for workflow in lost:
        log.info("work of a lost worker is taken up", workflow_id=workflow.workflow_id, worker=workflow.executor_id)
        _succeed(engine, workflow)
    gone = {w.workflow_id for w in lost}
    return [w for w in active if w.workflow_id not in gone]


def _is_dropped(engine: Engine, workflow: WorkflowStatus) -> bool:
    """True for one that this process took from the queue and, in an outage, never began."""
    if workflow.executor_id != engine.name or workflow.workflow_id in engine.running:
        return False
    return time.time() - 1e-3 * (workflow.dequeued_at or 0) > _CLAIMED_S


def _succeed(engine: Engine, lost: WorkflowStatus) -> None:
    """End a lost workflow, and hand on what it had in hand: of a job the whole or a part; the rest, the rows say."""
    job_id, _, rest = lost.workflow_id.partition("/")
    if lost.name == "casedrain-part":
        (found,) = DBOS.list_workflows(workflow_ids=[lost.workflow_id], load_output=False)
        _, first, last, deaths, before = found.input["args"] if found.input else (job_id, 0, 0, 0, -1)
        with engine.context.database.reading() as session:
            undone = last - first - len(store.done_of(session, job_id, first, last))
        deaths = deaths + 1 if undone == before else 0
        if deaths >= work.MOST_DEATHS:
            work.end_as_deadly(engine.context, job_id)
        else:
            name, _, attempt = rest.rpartition(".")
            work.begin_part(f"{job_id}/{name}", int(attempt) + 1, job_id, first, last, deaths, undone)
    # handed on first: who dies between the two leaves work done twice, and never none
    DBOS.cancel_workflow(lost.workflow_id)


def _take_up(engine: Engine, active: Collection[str]) -> None:
    """Hand over jobs that no workflow stands for: new ones, and those whose workflow was lost or ended in error."""
    with engine.context.database.reading() as session:
        jobs = store.unfinished(session, _MOST_JOBS)
    for job in jobs:
        if job.id in active or _is_left_to_its_request(job):
            continue
        known = DBOS.list_workflows(workflow_id_prefix=f"{job.id}/", name="casedrain-job", load_output=False)
        last = max(known, key=lambda w: int(w.workflow_id.rpartition("/")[2]), default=None)
        if last is not None and last.status in _ACTIVE:
            continue
        undone = -1 if job.total is None else job.total - job.done
        generation, deaths = 0, 0
        if last is not None:
            _, generation, deaths, before = last.input["args"] if last.input else (job.id, 0, 0, -1)
            generation, deaths = generation + 1, deaths + 1 if undone == before else 0
            log.info("job taken up again", job_id=job.id, attempt=generation, ended=last.status)
        if deaths >= work.MOST_DEATHS:
            work.end_as_deadly(engine.context, job.id)
        else:
            work.begin_whole(job.id, generation, deaths, undone)


def _is_left_to_its_request(job: Job) -> bool:
    """True while the process that has stored a job may be working on it right after its answer."""
    since = job.heartbeat_at or job.created_at
    return bool(job.parameters.get(work.AT_ONCE)) and datetime.now(UTC) - since < upkeep.IN_HAND
