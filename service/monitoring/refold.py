"""Fold a pump anew and store its verdicts, with a note of every past one that changed; its alarms follow."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from service.alarms.ledger import follow
from service.monitoring.analysis import empty_verdict
from service.monitoring.archive import Archive
from service.monitoring.codec import trend_to_json, verdict_to_json
from service.monitoring.fold import fold
from service.monitoring.knowledge import knowledge
from service.tables import Pump, Record, StoredAssessment, VerdictRevision


@dataclass(frozen=True, slots=True)
class Cause:
    """Why a pump is folded anew: ``record_received``, ``installation_changed`` …, and the id of what came."""

    kind: str
    id: str | None = None


REPROCESSED = Cause("reprocessed")


def refold(session: Session, pump: Pump, archive: Archive, cause: Cause = REPROCESSED) -> None:
    """Fold the pump's history anew, store an assessment per record and bring its alarms in line.

    The caller holds the pump's row lock (Postgres) or the write transaction (SQLite), so that two changes of one
    pump follow each other. Records whose thresholds, surroundings or pump type changed are analysed anew.

    Raises
    ------
    Unavailable
        when a record must be analysed anew and its raw bytes are gone; nothing is stored then.
    """
    found = knowledge(session, pump, archive)
    if found.anew:
        for row in session.scalars(select(Record).where(Record.id.in_(found.anew))):
            analysis = found.anew[row.id]
            row.reduction, row.residuals, row.reduced_with = analysis.reduction, analysis.residuals, analysis.key
    pump.pump_type = found.kind
    before = _states(session, pump)
    assessments = fold(found.known)
    session.execute(delete(StoredAssessment).where(StoredAssessment.pump_id == pump.id))
    session.add_all(
        StoredAssessment(
            record_id=a.record_id,
            pump_id=pump.id,
            at=a.at,
            aircraft=found.places[a.record_id].aircraft,
            position=found.places[a.record_id].position,
            state=a.verdict.state.value,
            trend=trend_to_json(a.trend),
            verdict=verdict_to_json(a.verdict, found.twin_version, found.thresholds.version),
        )
        for a in assessments
    )
    after = {a.record_id: (a.at, a.verdict.state.value) for a in assessments}
    session.add_all(_revisions(pump, before, after, cause))
    follow(session, pump, found.thresholds.values)


def verdict_known_at(
    session: Session, pump: Pump, archive: Archive, known_at: datetime, at: datetime | None
) -> dict[str, Any]:
    """Verdict as it stood with what was known at an instant, by today's twin.

    Raises
    ------
    Unavailable
        when a record must be analysed as it was then and its raw bytes are gone.
    """
    found = knowledge(session, pump, archive, known_at)
    assessments = [a for a in fold(found.known) if at is None or a.at <= at]
    if not assessments:
        return empty_verdict(found.kind, found.thresholds)
    return verdict_to_json(assessments[-1].verdict, found.twin_version, found.thresholds.version)


_States = Mapping[str, tuple[datetime, str]]


def _states(session: Session, pump: Pump) -> _States:
    query = select(StoredAssessment.record_id, StoredAssessment.at, StoredAssessment.state)
    return {r: (at, state) for r, at, state in session.execute(query.where(StoredAssessment.pump_id == pump.id))}


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
