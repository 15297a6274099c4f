"""Stored alarms follow the pump's history: they move, split and are withdrawn with it, and nothing goes unsaid."""

import uuid
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import Row, exists, or_, select
from sqlalchemy.orm import Session

from detectors.words.states import QUIET
from service.alarms.life_cycle import PRIORITIES, Action, Life, Plan, Point, lives, rules_of
from service.alarms.reading import shown
from service.answers.alarms import AlarmEvent
from service.answers.documents import RowValues
from service.answers.verdicts import Verdict
from service.answers.words import instant
from service.identity import release_number
from service.notifications.outbox import Event, announce
from service.storage.database import Database
from service.storage.tables import (
    Alarm,
    AlarmAction,
    Pump,
    Record,
    StoredAssessment,
    case_flow_of,
    case_pressure_beyond,
)
from service.thresholds.layers import thresholds_of


def follow(session: Session, pump: Pump, thresholds: Mapping[str, float], alarms: Sequence[Life] | None = None) -> None:
    """Bring the alarms of one pump in line with its stored assessments, and announce what changed.

    The caller holds the pump's row lock (Postgres) or the write transaction (SQLite). ``alarms`` are those of the history as
    it is stored, where somebody has found them already.
    """
    session.flush()
    rows = list(session.scalars(select(Alarm).where(Alarm.pump_id == pump.id).order_by(Alarm.created_at, Alarm.id)))
    now = datetime.now(UTC)
    if alarms is None:
        actions = actions_of(session, pump.id) if rows else []
        alarms = lives(points_of(session, pump.id), actions, rules_of(thresholds))
    matched = _matched(alarms, rows)
    held = {row.id: alarm for alarm, row in zip(alarms, matched, strict=True) if row is not None}
    for alarm, row in zip(alarms, matched, strict=True):
        before = None if row is None else _snapshot(row)
        taken = row or _new(pump, now)
        _write(taken, alarm)
        if before is None:
            session.add(taken)
        _announce(session, pump, taken, before, now)
    for row in rows:
        if row.id not in held and row.withdrawn_at is None:
            before = _snapshot(row)
            _withdraw(row, alarms, matched, now)
            _announce(session, pump, row, before, now)
    session.flush()


def catch_up(database: Database) -> int:
    """Raise the alarms of pumps whose history was folded before there were alarms; gives how many pumps.

    Safe to repeat: a pump that has alarms is left alone, and so is one that a newer release has judged.
    """
    kept = StoredAssessment
    is_faulty = or_(kept.state.not_in([s.value for s in QUIET]), kept.case_pressure_beyond)
    faulty = select(kept.pump_id).where(is_faulty).distinct()
    without = ~exists().where(Alarm.pump_id == Pump.id)
    with database.reading() as session:
        ours = or_(Pump.made_by.is_(None), Pump.made_by <= release_number())
        pump_ids = list(session.scalars(select(Pump.id).where(Pump.id.in_(faulty), without, ours).order_by(Pump.id)))
    for pump_id in pump_ids:
        with database.writing() as session:
            pump = session.scalars(select(Pump).where(Pump.id == pump_id).with_for_update()).one()
            follow(session, pump, thresholds_of(session, pump.operator, pump.serial, pump.pump_type).values)
    return len(pump_ids)


def points_of(session: Session, pump_id: int) -> list[Point]:
    """What alarms need of a pump's stored assessments, in event order."""
    kept = StoredAssessment
    said = (kept.state, kept.side, kept.candidates, kept.case_flow_lpm, kept.case_pressure_beyond)
    query = (
        select(kept.record_id, kept.at, Record.flight_id, *said)
        .join(Record, Record.id == kept.record_id)
        .where(kept.pump_id == pump_id)
    )
    rows = session.execute(query.order_by(kept.at, kept.record_id)).all()
    if any(row.side is None for row in rows):
        return _points_of_verdicts(session, pump_id)
    return [point_of_row(row, row.flight_id) for row in rows]


def point_of_row(row: StoredAssessment | Row[*tuple[Any, ...]], flight_id: str | None) -> Point:
    """One assessment as it is stored, as alarms see it; it must repeat what they need."""
    return Point(
        record_id=row.record_id,
        at=row.at,
        flight_id=flight_id or row.record_id,
        state=row.state,
        side=row.side or "",
        candidates=tuple(row.candidates or ()),
        case_flow_lpm=row.case_flow_lpm,
        case_pressure_beyond=row.case_pressure_beyond,
    )


def _points_of_verdicts(session: Session, pump_id: int) -> list[Point]:
    """The same from whole verdicts, for a history that has not been folded since rows repeat what alarms need."""
    query = (
        select(StoredAssessment.record_id, StoredAssessment.at, StoredAssessment.verdict, Record.flight_id)
        .join(Record, Record.id == StoredAssessment.record_id)
        .where(StoredAssessment.pump_id == pump_id)
        .order_by(StoredAssessment.at, StoredAssessment.record_id)
    )
    return [point_of(*row) for row in session.execute(query)]


def point_of(record_id: str, at: datetime, verdict: Verdict, flight_id: str | None) -> Point:
    """One assessment, in the shape of the API, as alarms see it."""
    return Point(
        record_id=record_id,
        at=at,
        flight_id=flight_id or record_id,
        state=verdict["state"],
        side=verdict["side"],
        candidates=tuple(verdict["candidates"]),
        case_flow_lpm=case_flow_of(verdict),
        case_pressure_beyond=case_pressure_beyond(verdict),
    )


def actions_of(session: Session, pump_id: int) -> list[Action]:
    """Everything that was done about a pump's alarms."""
    return [
        Action(
            number=row.id,
            kind=row.kind,
            by=row.by,
            reason=row.reason,
            until=row.until,
            onset_at=row.onset_at,
            seen_at=row.seen_at,
            seen_state=row.seen_state,
            seen_priority=row.seen_priority,
            done_at=row.done_at,
            plan=Plan(row.assignee, row.due_at, row.work_order),
        )
        for row in session.scalars(select(AlarmAction).where(AlarmAction.pump_id == pump_id).order_by(AlarmAction.id))
    ]


def _matched(alarms: Sequence[Life], rows: Sequence[Alarm]) -> list[Alarm | None]:
    """The stored alarm that each one continues: first by the same onset, then by a shared stretch."""
    found: list[Alarm | None] = [None] * len(alarms)
    # a withdrawn alarm comes back only where no living one claims the stretch
    waiting = sorted(rows, key=lambda r: r.withdrawn_at is not None)
    for fits in (_same_onset, _shares_a_stretch):
        for row in list(waiting):
            place = next((i for i, a in enumerate(alarms) if found[i] is None and fits(a, row)), None)
            if place is not None:
                found[place] = row
                waiting.remove(row)
    return found


def _same_onset(alarm: Life, row: Alarm) -> bool:
    return alarm.covers(row.onset_at)


def _shares_a_stretch(alarm: Life, row: Alarm) -> bool:
    return row.withdrawn_at is None and alarm.overlaps(row.onset_at, row.cleared_at)


def _new(pump: Pump, now: datetime) -> Alarm:
    return Alarm(id=uuid.uuid4().hex, pump_id=pump.id, operator=pump.operator, created_at=now, changed_at=now)


def _write(row: Alarm, alarm: Life) -> None:
    row.onset_at, row.raised_at, row.record_id = alarm.onset_at, alarm.raised_at, alarm.record_id
    row.condition = "active" if alarm.cleared_at is None else "cleared"
    row.cleared_at, row.acknowledged = alarm.cleared_at, alarm.acknowledged
    row.priority, row.beyond_limit = alarm.priority, alarm.beyond_limit
    row.case_pressure_beyond = alarm.case_pressure_beyond
    row.verdict_state, row.side, row.candidates = alarm.state, alarm.side, list(alarm.candidates)
    row.shelved_until, row.closed_at = alarm.shelved_until, alarm.closed_at
    row.assignee, row.due_at, row.work_order = alarm.plan.assignee, alarm.plan.due_at, alarm.plan.work_order
    row.comments = alarm.comments
    row.withdrawn_at, row.cause = None, None
    row.history = list(alarm.history)


def _withdraw(row: Alarm, alarms: Sequence[Life], matched: Sequence[Alarm | None], now: datetime) -> None:
    other = next(
        (m for a, m in zip(alarms, matched, strict=True) if m is not None and a.covers(row.onset_at)),
        None,
    )
    row.withdrawn_at = now
    row.cause = (
        "the pump's records, as they stand now, no longer support it"
        if other is None
        else f"its stretch became part of alarm {other.id}, with what was done about it"
    )
    entry: AlarmEvent = {"event": "withdrawn", "at": instant(now), "reason": row.cause}
    row.history = [*row.history, entry]


_WATCHED = (
    "onset_at",
    "raised_at",
    "condition",
    "acknowledged",
    "priority",
    "verdict_state",
    "beyond_limit",
    "case_pressure_beyond",
    "shelved_until",
    "closed_at",
    "withdrawn_at",
    "assignee",
    "due_at",
    "work_order",
    "comments",
)


def _snapshot(row: Alarm) -> RowValues:
    return {name: getattr(row, name) for name in _WATCHED}


def _announce(session: Session, pump: Pump, row: Alarm, before: Mapping[str, Any] | None, now: datetime) -> None:
    if before is not None and before == _snapshot(row):
        return
    row.changed_at = now
    document = shown(row, pump.serial, pump.pump_type, now)
    for event in _events(row, before):
        announce(session, pump.operator, event, document, now)


def _events(row: Alarm, before: Mapping[str, Any] | None) -> list[Event]:
    """Names of what happened between two versions of an alarm."""
    if before is None:
        return ["alarm.raised", "alarm.cleared"] if row.condition == "cleared" else ["alarm.raised"]
    after = _snapshot(row)
    if after["withdrawn_at"] is not None:
        return ["alarm.withdrawn"]
    if before["withdrawn_at"] is not None:
        return ["alarm.raised"]
    happened: dict[Event, bool] = {
        "alarm.escalated": PRIORITIES.index(after["priority"]) > PRIORITIES.index(before["priority"]),
        "alarm.reopened": (before["acknowledged"] and not after["acknowledged"])
        or (before["condition"] == "cleared" and after["condition"] == "active"),
        "alarm.shelved": after["shelved_until"] is not None and after["shelved_until"] != before["shelved_until"],
        "alarm.unshelved": before["shelved_until"] is not None and after["shelved_until"] is None,
        "alarm.closed": before["closed_at"] is None and after["closed_at"] is not None,
        "alarm.acknowledged": not before["acknowledged"] and after["acknowledged"] and after["closed_at"] is None,
        "alarm.cleared": before["condition"] == "active" and after["condition"] == "cleared",
    }
    return [name for name, has in happened.items() if has] or ["alarm.changed"]
