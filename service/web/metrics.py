"""What an installation says of itself when it is scraped: queues, backlog, jobs, deliveries, verdicts, pool, disks.

Numbers of the database are asked at most every ten seconds, each from an index, and are left out while it is away. Labels
are words of ours only: no serial, no operator, no address ever becomes one.
"""

import shutil
import threading
import time
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from typing import Any

import structlog
from prometheus_client import REGISTRY
from prometheus_client.core import GaugeMetricFamily, Metric
from sqlalchemy import func, select
from sqlalchemy.orm import Session
from sqlalchemy.pool import QueuePool

from service.context import Context
from service.reading.queries import pumps_by_state
from service.storage.tables import QUEUED, RUNNING, STORED, Delivery, Job, Record

_AGAIN_S = 10.0
_PENDING = "pending"
log = structlog.get_logger("casedrain")
_Numbers = dict[str, float | dict[str, float]]
_WORDS = {
    "casedrain_backlog_records": "Records that are stored and not analysed yet",
    "casedrain_backlog_age_seconds": "Age of the oldest of them",
    "casedrain_jobs": "Jobs that have not ended, by status",
    "casedrain_jobs_age_seconds": "Age of the oldest of them",
    "casedrain_deliveries_pending": "Messages that wait for their webhook or mail server",
    "casedrain_deliveries_overdue_seconds": "How long the first of them has been due",
    "casedrain_pumps": "Pumps by the state of their newest verdict",
}
_LABELS = {"casedrain_jobs": "status", "casedrain_pumps": "state"}


class Everything:
    """The process's counters with what this installation says, as one registry."""

    def __init__(self, context: Context) -> None:
        self._context = context

    def collect(self) -> Iterator[Metric]:
        """Families of both."""
        yield from REGISTRY.collect()
        yield from _of_process(self._context)
        numbers = _numbers(self._context)
        yield _gauge("casedrain_database_up", "Whether the database answered", float(numbers is not None))
        for name, words in _WORDS.items():
            if numbers is not None:
                yield _gauge(name, words, numbers[name], _LABELS.get(name))


_lock = threading.Lock()
_kept: dict[int, tuple[float, _Numbers | None]] = {}


def _numbers(context: Context) -> _Numbers | None:
    with _lock:
        at, numbers = _kept.get(id(context), (-_AGAIN_S, None))
        if time.monotonic() - at < _AGAIN_S:
            return numbers
        try:
            with context.database.reading() as session:
                numbers = _of_database(session)
        except Exception as error:
            log.warning("metrics without the database", error=type(error).__name__)
            numbers = None
        _kept.clear()
        _kept[id(context)] = (time.monotonic(), numbers)
        return numbers


def _of_database(session: Session) -> _Numbers:
    now = datetime.now(UTC)
    waiting, oldest = session.execute(
        select(func.count(), func.min(Record.received_at)).where(Record.status == STORED)
    ).one()
    jobs = session.execute(
        select(Job.status, func.count(), func.min(Job.created_at))
        .where(Job.status.in_((QUEUED, RUNNING)))
        .group_by(Job.status)
    ).all()
    pending, due = session.execute(
        select(func.count(), func.min(Delivery.due_at)).where(Delivery.status == _PENDING)
    ).one()
    return {
        "casedrain_backlog_records": float(waiting),
        "casedrain_backlog_age_seconds": _age(now, oldest),
        "casedrain_jobs": {QUEUED: 0.0, RUNNING: 0.0, **{status: float(n) for status, n, _ in jobs}},
        "casedrain_jobs_age_seconds": max((_age(now, made) for _, _, made in jobs), default=0.0),
        "casedrain_deliveries_pending": float(pending),
        "casedrain_deliveries_overdue_seconds": _age(now, due),
        "casedrain_pumps": {state: float(n) for state, n in session.execute(pumps_by_state())},
    }


def _of_process(context: Context) -> Iterable[Metric]:
    yield _gauge("casedrain_parser_waiting", "Files that wait for the parser", float(context.parser.waiting))
    yield _gauge("casedrain_uploads_waiting", "Uploads that wait their turn", float(context.crowd.uploads.waiting))
    yield _gauge("casedrain_requests_in_hand", "Requests that are being answered", float(context.crowd.in_hand))
    pool = context.database.engine.pool
    if isinstance(pool, QueuePool):
        connections = {"in_use": float(pool.checkedout()), "idle": float(pool.checkedin())}
        yield _gauge("casedrain_database_connections", "Connections of this process's pool", connections, "use")
    places = {"spool": [context.spool.folder], "raw": context.raw_store.folders, "database": context.database.folders}
    free = {place: float(shutil.disk_usage(folders[0]).free) for place, folders in places.items() if folders}
    total = {place: float(shutil.disk_usage(folders[0]).total) for place, folders in places.items() if folders}
    yield _gauge("casedrain_disk_free_bytes", "Room left on the disks that are written to", free, "place")
    yield _gauge("casedrain_disk_bytes", "Size of these disks", total, "place")


def _gauge(name: str, words: str, value: float | dict[str, float], label: str | None = None) -> Metric:
    family: Any = GaugeMetricFamily(name, words, labels=None if label is None else [label])
    for word, number in value.items() if isinstance(value, dict) else ((None, value),):
        family.add_metric([] if word is None else [word], number)
    found: Metric = family
    return found


def _age(now: datetime, since: datetime | None) -> float:
    if since is None:
        return 0.0
    return max(0.0, (now - (since if since.tzinfo else since.replace(tzinfo=UTC))).total_seconds())
