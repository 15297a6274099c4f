"""What keeps the house, as workflows: analysis of acknowledged records, deliveries, housekeeping, renewal.

None of them carries what it works on: the rows say what there is to do, so that any of them may be lost.
"""

import time
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

import structlog
from dbos import DBOS
from sqlalchemy import ColumnElement, and_, or_, select

from service.alarms.ledger import catch_up
from service.errors import Problem
from service.identity import release_number
from service.jobs import state
from service.jobs.state import Engine, StoppedError
from service.monitoring.precedence import is_ours
from service.notifications.worker import Postman, forget_old
from service.reading.standing import keep_standings
from service.registry.deletion import finish_deletions
from service.registry.retention import expire_all
from service.storage.failures import is_passing
from service.storage.tables import STORED, Record

log = structlog.get_logger("casedrain")
SLOTS = 4
"""Shares of the acknowledged records: of each one workflow at a time, so that no two workers take the same record."""
IN_HAND = timedelta(seconds=15)
"""A stored record that an upload waits for is left to it for so long; then it is taken for interrupted."""
_CHUNK, _LOOKED_AT = 20, 400
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 5.0, 300.0
_KEPT = timedelta(hours=1)
"""How long finished workflows are kept for whoever wants to look at them; what they did is in rows of its own."""
_PURGED_AT_ONCE = 500
_ENDED = ["SUCCESS", "ERROR", "CANCELLED", "MAX_RECOVERY_ATTEMPTS_EXCEEDED"]


@DBOS.workflow(name="casedrain-records")
def records(slot: int, since: str) -> None:
    """Analyse the acknowledged records of one share, until there is none left.

    Parameters
    ----------
    slot
        Number of the share, below ``SLOTS``.
    since
        Instant, ISO 8601, from which on whoever asks has been there: no upload in hand of its own is older.
    """
    engine = state.current()
    with engine.at_work(DBOS.workflow_id):
        engine.lastingly("analysis of stored records", lambda: _records(engine, slot, datetime.fromisoformat(since)))


@DBOS.workflow(name="casedrain-deliveries")
def deliveries() -> None:
    """Send everything that is due."""
    engine = state.current()
    postman = Postman(engine.context.database, engine.context.settings)
    with engine.at_work(DBOS.workflow_id):
        while engine.lastingly("deliveries", postman.turn):
            pass


@DBOS.workflow(name="casedrain-housekeeping")
def housekeeping() -> None:
    """End deletions that a crash interrupted, let what is old expire, forget what nobody asks for."""
    engine = state.current()
    database, raw_store = engine.context.database, engine.context.raw_store
    now = datetime.now(UTC)
    with engine.at_work(DBOS.workflow_id):
        for what, work in (
            ("deletions", lambda: finish_deletions(database, raw_store)),
            ("expiry of what is old", lambda: expire_all(database, raw_store, now)),
            ("old messages", lambda: forget_old(database, now)),
            ("alarms of older histories", lambda: catch_up(database)),
            ("standings of older histories", lambda: keep_standings(database, is_ours())),
            ("finished workflows", _purge),
        ):
            try:
                engine.lastingly(what, work)
            except Exception:
                log.exception("left for the next time", what=what)


@DBOS.workflow(name="casedrain-renewal")
def renewal() -> None:
    """Make again what other code has reduced and folded."""
    engine = state.current()
    with engine.at_work(DBOS.workflow_id):
        engine.lastingly("renewal", lambda: engine.renewal.run(engine.stopping))
        if engine.stopping.is_set():
            raise StoppedError


def is_stored() -> ColumnElement[bool]:
    """Condition that picks records that are stored and for this release or an older one to analyse."""
    return and_(Record.status == STORED, or_(Record.waits_for.is_(None), Record.waits_for <= release_number()))


def waiting(engine: Engine, since: datetime) -> list[str]:
    """Ids of stored records that nobody has in hand, oldest first, so many as are looked at in one go."""
    limit = max(since, datetime.now(UTC) - IN_HAND)
    query = select(Record.id, Record.received_at, Record.request).where(is_stored())
    now, put_off = time.monotonic(), engine.waiting_until
    with engine.context.database.reading() as session:
        oldest = query.order_by(Record.received_at, Record.id).limit(_LOOKED_AT + len(put_off))
        rows = session.execute(oldest).all()
    return [
        row.id
        for row in rows
        if (row.received_at < limit or row.request.get("later")) and put_off.get(row.id, (0.0, 0.0))[0] <= now
    ]


def slot_of(record_id: str) -> int:
    """The share that a record belongs to."""
    return sum(record_id.encode()) % SLOTS


def _records(engine: Engine, slot: int, since: datetime) -> None:
    while ids := [i for i in waiting(engine, since) if slot_of(i) == slot][:_CHUNK]:
        _process(engine, ids)


def _process(engine: Engine, ids: Sequence[str]) -> None:
    for record_id in ids:
        if engine.stopping.is_set():
            raise StoppedError
        try:
            engine.context.acceptance.process(record_id)
        except Exception as error:
            if is_passing(error):
                raise
            pause = min(2.0 * engine.waiting_until.get(record_id, (0.0, 0.5 * _FIRST_PAUSE_S))[1], _LONGEST_PAUSE_S)
            engine.waiting_until[record_id] = (time.monotonic() + pause, pause)
            if isinstance(error, Problem):
                log.warning("record left stored", record_id=record_id, problem=error.detail, again_in_s=pause)
            else:
                log.exception("record left stored", record_id=record_id, again_in_s=pause)
        else:
            engine.waiting_until.pop(record_id, None)


def _purge() -> None:
    before = (datetime.now(UTC) - _KEPT).isoformat()
    while True:
        old = DBOS.list_workflows(
            status=_ENDED, completed_before=before, limit=_PURGED_AT_ONCE, load_input=False, load_output=False
        )
        if old:
            DBOS.delete_workflows([w.workflow_id for w in old])
        if len(old) < _PURGED_AT_ONCE:
            return
