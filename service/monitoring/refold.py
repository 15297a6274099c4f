"""Fold a pump anew and store its verdicts, with a note of every past one that changed; its alarms follow."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import structlog
from opentelemetry import trace
from prometheus_client import Histogram
from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from detectors.words.verdict import Assessment
from service.alarms.ledger import follow
from service.answers import verdicts as answers
from service.errors import Problem
from service.history.analysis import keep_analysis
from service.history.archive import Archive
from service.history.codec import trend_to_json, verdict_to_json
from service.history.knowledge import AnyRow, Knowledge, knowledge
from service.history.known import Known
from service.history.verdicts import empty_verdict
from service.identity import software
from service.ingest.names import look_of
from service.monitoring import snapshots
from service.monitoring.chain import chain
from service.monitoring.fold import fold, steps
from service.monitoring.precedence import left_to_newer, take_over
from service.reading.forecast import crossed
from service.reading.queries import TrendOfRecord
from service.storage.database import Database
from service.storage.tables import ANALYSED, Pump, Record, StoredAssessment, VerdictRevision


@dataclass(frozen=True, slots=True)
class Cause:
    """Why a pump is folded anew: ``record_received``, ``installation_changed`` …, and the id of what came."""

    kind: str
    id: str | None = None


REPROCESSED = Cause("reprocessed")
_MOST_IDS = 500
"""Ids of one query: SQLite allows 999 bound values in old builds."""
log = structlog.get_logger("casedrain")
_tracer = trace.get_tracer("casedrain")
_FOLD_SECONDS = Histogram("casedrain_fold_seconds", "Time to fold a pump's history anew and store its verdicts")


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
    with _FOLD_SECONDS.time(), _tracer.start_as_current_span("fold"):
        _refold(session, pump, archive, cause, from_scratch=from_scratch)


def _refold(session: Session, pump: Pump, archive: Archive, cause: Cause, *, from_scratch: bool) -> None:
    session.flush()
    if left_to_newer(session, pump):
        return
    _outline_older(session, pump)
    pump.look = pump.look or look_of(pump.serial)
    found = knowledge(session, pump, archive)
    if found.anew:
        for row in session.scalars(select(Record).where(Record.id.in_(found.anew))):
            keep_analysis(row, found.anew[row.id])
    pump.pump_type = found.kind
    take_over(pump, whole=True)
    version, made_by = found.twin_version, software().to_json()
    links = chain(found.known, version, found.thresholds.version)
    stored = _stored(session, pump)
    same = 0 if from_scratch else _unchanged(found.known, links, stored)
    placed = {p.outline.record_id: p.outline for p in found.known.placed}
    changed = [p.outline.record_id for p in found.known.placed[same:]]
    gone = {i for i in stored if i not in placed} | {i for i in changed if i in stored}
    assessments = _folded(session, pump, found, links, same, from_scratch=from_scratch) if changed else []
    _remove(session, pump, stored, gone)
    session.add_all(
        StoredAssessment(
            record_id=a.record_id,
            pump_id=pump.id,
            at=a.at,
            aircraft=placed[a.record_id].aircraft,
            position=placed[a.record_id].position,
            state=a.verdict.state.value,
            trend=trend_to_json(a.trend),
            verdict=verdict_to_json(a.verdict, version, found.thresholds.version, made_by),
            chain=link,
        )
        for a, link in zip(assessments, links[same:], strict=True)
    )
    before = {i: (row.at, row.state) for i, row in stored.items() if i in gone}
    after = {a.record_id: (a.at, a.verdict.state.value) for a in assessments}
    session.add_all(_revisions(pump, before, after, cause))
    follow(session, pump, found.thresholds.values)


def refold_others(database: Database, archive: Archive, pump_ids: Collection[int], cause: Cause) -> None:
    """Fold other pumps anew whose remarks a change has touched, each in a transaction of its own.

    One that cannot be folded now keeps its verdicts until its next record.
    """
    for pump_id in sorted(pump_ids):
        try:
            with database.writing() as session:
                query = select(Pump).where(Pump.id == pump_id).with_for_update()
                pump = session.scalar(query.execution_options(populate_existing=True))
                if pump is not None:
                    refold(session, pump, archive, cause)
        except Problem as problem:
            log.warning("verdicts left as they were", pump_id=pump_id, problem=problem.detail)


def verdict_known_at(
    session: Session, pump: Pump, archive: Archive, known_at: datetime, at: datetime | None
) -> answers.Verdict:
    """Verdict as it stood with what was known at an instant, by today's twin.

    Raises
    ------
    Unavailable
        when a record must be analysed as it was then and its raw bytes are gone.
    """
    found = knowledge(session, pump, archive, known_at)
    assessments = [a for a in fold(found.known, found.observations(session)) if at is None or a.at <= at]
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


def _outline_older(session: Session, pump: Pump) -> None:
    """Outline what was reduced before there were outlines, so that it is read this once."""
    query = select(Record).where(
        Record.pump_id == pump.id, Record.status == ANALYSED, Record.reduction_digest.is_(None)
    )
    for row in session.scalars(query):
        row.reduction = row.reduction  # the row outlines whatever is assigned


def _unchanged(known: Known, links: Sequence[str], stored: Mapping[str, AnyRow]) -> int:
    """Number of records from the first on whose stored assessments still hold."""
    for i, (here, link) in enumerate(zip(known.placed, links, strict=True)):
        row = stored.get(here.outline.record_id)
        if row is None or row.chain != link:
            return i
    return len(links)


def _folded(
    session: Session, pump: Pump, found: Knowledge, links: Sequence[str], same: int, *, from_scratch: bool
) -> list[Assessment]:
    """Assessments of the records behind the first ``same``; snapshots are left on the way."""
    start = None if from_scratch else snapshots.start_of(session, pump.id, found.known, links, same)
    begin = start.records if start else 0
    places = snapshots.missing(session, pump.id, links, start)
    taken = {}
    assessments = []
    for number, step in enumerate(steps(found.known, found.observations(session), start, places), begin + 1):
        if number > same:
            assessments.append(step.assessment)
        if step.snapshot is not None:
            taken[number] = step
    snapshots.keep(session, pump.id, links, taken)
    return assessments


def _stored(session: Session, pump: Pump) -> dict[str, AnyRow]:
    columns = (StoredAssessment.record_id, StoredAssessment.at, StoredAssessment.state, StoredAssessment.chain)
    return {row.record_id: row for row in session.execute(select(*columns).where(StoredAssessment.pump_id == pump.id))}


def _remove(session: Session, pump: Pump, stored: Mapping[str, AnyRow], gone: Collection[str]) -> None:
    """Delete the assessments of some records; in one statement where those are all."""
    if len(gone) == len(stored):
        session.execute(delete(StoredAssessment).where(StoredAssessment.pump_id == pump.id))
        return
    ids = sorted(gone)
    for start in range(0, len(ids), _MOST_IDS):
        session.execute(delete(StoredAssessment).where(StoredAssessment.record_id.in_(ids[start : start + _MOST_IDS])))


_States = Mapping[str, tuple[datetime, str]]


def _revisions(pump: Pump, before: _States, after: _States, cause: Cause) -> list[VerdictRevision]:
    """Past verdicts that changed; a record's first verdict is news, not a revision."""
    now = datetime.now(UTC)
    later = {record_id: state for record_id, (_, state) in after.items()}
    return [
        VerdictRevision(
            pump_id=pump.id,
            record_id=record_id,
            at=at,
            old_state=old,
            new_state=later.get(record_id),
            cause=cause.kind,
            cause_id=cause.id,
            changed_at=now,
        )
        for record_id, (at, old) in sorted(before.items())
        if later.get(record_id) != old
    ]
