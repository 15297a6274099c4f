"""Fold a pump anew and store its verdicts: apart from other writers where it can be, under the pump's lock where it must."""

import threading
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from datetime import datetime
from functools import partial
from typing import Any, cast

import structlog
from sqlalchemy import ColumnElement, CursorResult, or_, select, update
from sqlalchemy.orm import Session

from service.answers import verdicts as answers
from service.answers.documents import JsonObject
from service.errors import Problem
from service.history.archive import Archive
from service.history.codec import trend_to_json, verdict_to_json
from service.history.dossier import ChangedError, Dossier, dossier, outside_numbers
from service.history.knowledge import knowledge
from service.history.verdicts import empty_verdict
from service.identity import release_number, software
from service.ingest.names import look_of
from service.monitoring.fold import fold
from service.monitoring.folded import Cause, Folded, folded, keep
from service.monitoring.precedence import left_to_newer, made_with, take_over
from service.monitoring.reduction import reduced_again
from service.monitoring.succession import nobody_else_at, with_neighbours
from service.monitoring.telling import IN_HAND, News, news_of, told_now
from service.reading.forecast import crossed
from service.reading.queries import TrendOfRecord
from service.storage.database import Database, afterwards
from service.storage.tables import Pump

__all__ = [
    "REPROCESSED",
    "Cause",
    "apart",
    "claimed",
    "kept",
    "queue_of",
    "refold",
    "refold_others",
    "verdict_known_at",
]
REPROCESSED = Cause("reprocessed")
TRIES = 3
"""Folds without the lock that may find their pump changed; the next one is made under it, so that all come to an end."""
_queues: dict[tuple[str, str], threading.Lock] = {}
_waiting: Counter[tuple[str, str]] = Counter()
_guard = threading.Lock()
_held = threading.local()
log = structlog.get_logger("casedrain")


def refold(
    session: Session, pump: Pump, archive: Archive, cause: Cause = REPROCESSED, *, from_scratch: bool = False
) -> None:
    """Fold the pump's history anew, store an assessment per record and bring its alarms in line.

    The caller holds the pump's row lock (Postgres) or the write transaction (SQLite), so that two changes of one
    pump follow each other. Records whose thresholds, surroundings or pump type changed are analysed anew. Assessments
    before the first change stay as they are, and the fold begins at the newest snapshot before it.

    A pump that a newer release has judged is left alone: a process of that release folds it anew soon.

    Parameters
    ----------
    from_scratch
        Trust neither snapshots nor stored assessments.

    Raises
    ------
    Unavailable
        when a record must be analysed anew and its raw bytes are gone; nothing is stored then.
    """
    session.flush()
    if left_to_newer(session, pump):
        return
    pump.look = pump.look or look_of(pump.serial)
    made = folded(session, pump, archive, from_scratch=from_scratch)
    pump.pump_type = made.found.kind
    news = news_of(session, pump, made)
    take_over(pump, whole=news is None)
    pump.standing, pump.standing_at = _kept_standing(made), pump.revision
    pump.standing_link = made.links[-1] if made.links else None
    kept(session, pump, made, archive, cause, news)


def apart(
    database: Database,
    archive: Archive,
    pump_id: int,
    cause: Cause = REPROCESSED,
    *,
    from_scratch: bool = False,
    reduce_first: bool = False,
) -> None:
    """Fold a pump anew without holding up anybody: the fold is made first, and stored if nothing has changed meanwhile.

    Parameters
    ----------
    from_scratch
        Trust neither snapshots nor stored assessments.
    reduce_first
        Where records may have to be reduced again: do that before, in chunks of which each stays done.

    Raises
    ------
    Unavailable
        as ``refold`` does.
    """
    with database.reading() as session:
        pump = session.get(Pump, pump_id)
    if pump is None:
        return
    with queue_of(pump.operator, pump.serial):
        if reduce_first:
            reduced_again(database, archive, pump_id)
        for _ in range(TRIES):
            if attempted(database, archive, pump_id, cause, from_scratch=from_scratch):
                return
        with database.writing() as session:
            query = select(Pump).where(Pump.id == pump_id).with_for_update()
            locked = session.scalar(query.execution_options(populate_existing=True))
            if locked is not None:
                refold(session, locked, archive, cause, from_scratch=from_scratch)


def attempted(
    database: Database,
    archive: Archive,
    pump_id: int,
    cause: Cause = REPROCESSED,
    given_up: Callable[[], bool] = lambda: False,
    *,
    from_scratch: bool = False,
) -> bool:
    """Fold a pump without its lock, then store that: False where the pump has changed meanwhile and nothing was stored.

    Raises
    ------
    GivenUpError
        as soon as ``given_up`` says so.
    """
    with database.reading() as session:
        pump = session.get(Pump, pump_id)
        known = dossier(session, pump.operator, pump.serial) if pump else None
        if known is None:
            return True
        try:
            made = folded(session, known.pump, archive, known, from_scratch=from_scratch, given_up=given_up)
        except ChangedError:
            return False
        news = news_of(session, known.pump, made)
    with database.writing() as session:
        if not claimed(session, known, made, *outside_unchanged(known), is_told=news is None):
            return False
        kept(session, known.pump, made, archive, cause, news)
    return True


def kept(session: Session, pump: Pump, made: Folded, archive: Archive, cause: Cause, news: News | None) -> None:
    """Store what a pump was folded to; pumps that take over from it are folded anew once that is committed.

    Then its own again, where it took over from another pump that may have changed while it was folded: of two folds that
    met, the one that is stored last sees the other.

    Parameters
    ----------
    news
        What ``news_of`` says that others are to be told; until they are, the pump is not marked as through.
    """
    keep(session, pump, made, cause)
    if news is not None:
        afterwards(session, partial(_told, archive=archive, news=news))


def _told(database: Database, archive: Archive, news: News) -> None:
    IN_HAND.begun(database, news)
    waiting: list[Callable[[], None]] | None = getattr(_held, "waiting", None)
    if waiting is not None:  # their own queues may be the one that this thread stands in
        waiting.append(partial(told_now, database, archive, news, refold_others))
        return
    told_now(database, archive, news, refold_others)


def claimed(
    session: Session, known: Dossier, made: Folded, *conditions: ColumnElement[bool], is_told: bool = True
) -> bool:
    """Lock a pump and take it over, unless it has changed since it was read, or conditions fail; True where it is taken.

    Without ``is_told`` it is not marked as through: others are to be told of it first.
    """
    pump = known.pump
    is_ours = or_(Pump.made_by.is_(None), Pump.made_by <= release_number())
    values = {
        "revision": Pump.revision + 1,
        "pump_type": made.found.kind,
        "look": look_of(pump.serial),
        "made_by": release_number(),
        "made_with": made_with() if made.is_whole and is_told else None,
        "standing": _kept_standing(made),
        "standing_at": Pump.revision + 1 if made.is_whole else None,
        "standing_link": made.links[-1] if made.links else None,
    }
    if made.alone_at:
        conditions = (*conditions, nobody_else_at(pump, made.alone_at))
    wanted = update(Pump).where(Pump.id == pump.id, Pump.revision == pump.revision, is_ours, *conditions).values(values)
    taken = session.execute(wanted.execution_options(synchronize_session=False))
    return cast("CursorResult[Any]", taken).rowcount == 1


def _kept_standing(made: Folded) -> JsonObject | None:
    return made.standing.to_json() if made.standing else None


def outside_unchanged(known: Dossier) -> list[ColumnElement[bool]]:
    """Conditions under which what holds for many pumps is as it was."""
    newest = outside_numbers(known.pump.operator)
    return [now == then for now, then in zip(newest, known.outside, strict=True)]


@contextmanager
def queue_of(operator: str, serial: str) -> Iterator[None]:
    """One after the other within this process: folds of one pump at the same time would only find each other's changes.

    Other pumps never wait in it. What they are told of this one, they are told behind the queue.
    """
    waiting: list[Callable[[], None]] = []
    _held.waiting = waiting
    pump = operator, serial
    with _guard:
        lock = _queues.setdefault(pump, threading.Lock())
        _waiting[pump] += 1
    try:
        with lock:
            yield
    finally:
        _held.waiting = None
        with _guard:
            _waiting[pump] -= 1
            if not _waiting[pump]:
                del _waiting[pump], _queues[pump]
        for tell in waiting:
            tell()


def refold_others(database: Database, archive: Archive, pump_ids: Collection[int], cause: Cause) -> bool:
    """Fold other pumps anew whose remarks a change has touched, each in a transaction of its own.

    One that cannot be folded now keeps its verdicts until its next record, or until it is taken up again; False then.
    """
    all_are = True
    for pump_id in sorted(pump_ids):
        try:
            apart(database, archive, pump_id, cause)
        except Problem as problem:
            all_are = False
            log.warning("verdicts left as they were", pump_id=pump_id, problem=problem.detail)
    return all_are


def verdict_known_at(
    session: Session, pump: Pump, archive: Archive, known_at: datetime, at: datetime | None
) -> answers.Verdict:
    """Verdict as it stood with what was known at an instant, by today's twin.

    Raises
    ------
    Unavailable
        when a record must be analysed as it was then and its raw bytes are gone.
    """
    found = with_neighbours(session, pump, archive, knowledge(session, pump, archive, known_at), known_at)
    assessments = [a for a in fold(found.known, found.observations(session), found.others) if at is None or a.at <= at]
    if not assessments:
        return empty_verdict(found.known.kind, found.thresholds)
    last, made_by = assessments[-1].verdict, software().to_json()
    verdict = verdict_to_json(last, found.twin_version, found.thresholds.version, made_by)
    placed = {p.outline.record_id: p.outline for p in found.known.placed}
    trends = [
        TrendOfRecord(
            at=a.at,
            aircraft=placed[a.record_id].aircraft,
            position=placed[a.record_id].position,
            flight_hours=found.flight_hours.get(a.record_id),
            state=a.verdict.state.value,
            trend=trend_to_json(a.trend),
        )
        for a in assessments
    ]
    return crossed(verdict, trends, found.known.installation_changes, found.thresholds.values)
