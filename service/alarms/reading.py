"""Alarms as the API shows them, and the questions that lists ask."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Literal

from sqlalchemy import ColumnElement, Select, and_, not_, or_, select, tuple_
from sqlalchemy.orm import Session

from service.access.security import Principal
from service.answers import alarms as answers
from service.answers.words import instant
from service.errors import NotFound
from service.storage.tables import Alarm, Pump, StoredAssessment

Filter = Literal[
    "active_unacknowledged",
    "active_acknowledged",
    "cleared_unacknowledged",
    "cleared_acknowledged",
    "closed",
    "withdrawn",
    "open",
    "active",
    "unacknowledged",
    "shelved",
]
"""Values of the list's ``state``: the six states of an alarm, of which ``cleared_acknowledged`` is ISA-18.2's normal,
and four groups; ``open`` leaves out what is closed, withdrawn, or cleared and acknowledged."""


def state_of(row: Alarm) -> str:
    """State of a stored alarm."""
    if row.withdrawn_at is not None:
        return "withdrawn"
    if row.closed_at is not None:
        return "closed"
    return f"{row.condition}_{'acknowledged' if row.acknowledged else 'unacknowledged'}"


def is_shelved(row: Alarm, now: datetime) -> bool:
    """True while an alarm is on the shelf."""
    return row.withdrawn_at is None and row.shelved_until is not None and row.shelved_until > now


def is_overdue(row: Alarm, now: datetime) -> bool:
    """True where the day is past until which an alarm should have been seen to, while it still wants that."""
    wants = state_of(row) not in ("withdrawn", "closed", "cleared_acknowledged")
    return wants and row.due_at is not None and row.due_at < now


def shown(row: Alarm, serial: str, pump_type: str, now: datetime | None = None) -> answers.Alarm:
    """One alarm in the shape of the API."""
    return {
        "id": row.id,
        "pump_serial": serial,
        "pump_type": pump_type,
        "operator": row.operator,
        "state": state_of(row),
        "condition": row.condition,
        "acknowledged": row.acknowledged,
        "shelved": is_shelved(row, now or datetime.now(UTC)),
        "shelved_until": instant(row.shelved_until),
        "priority": row.priority,
        "verdict_state": row.verdict_state,
        "side": row.side,
        "candidates": row.candidates,
        "beyond_limit": row.beyond_limit,
        "case_pressure_beyond": row.case_pressure_beyond,
        "onset_at": instant(row.onset_at),
        "raised_at": instant(row.raised_at),
        "record_id": row.record_id,
        "cleared_at": instant(row.cleared_at),
        "closed_at": instant(row.closed_at),
        "withdrawn_at": instant(row.withdrawn_at),
        "cause": row.cause,
        "assignee": row.assignee,
        "due_at": instant(row.due_at),
        "overdue": is_overdue(row, now or datetime.now(UTC)),
        "work_order": row.work_order,
        "comments": row.comments,
        "changed_at": instant(row.changed_at),
        "history": row.history,
    }


@dataclass(frozen=True, slots=True)
class Wanted:
    """What a list of alarms is narrowed to; None takes all."""

    state: Filter | None = None
    serial: str | None = None
    operator: str | None = None
    aircraft: str | None = None
    pump_type: str | None = None
    priority: str | None = None
    side: str | None = None
    verdict_state: str | None = None
    assignee: str | None = None
    work_order: str | None = None
    overdue: bool | None = None


_ALL = Wanted()


def alarms(principal: Principal, wanted: Wanted = _ALL, after: Sequence[Any] | None = None) -> Select[Alarm, str, str]:
    """Alarms that this principal may see with serial and type of their pump, newest first."""
    query = select(Alarm, Pump.serial, Pump.pump_type).join(Pump, Pump.id == Alarm.pump_id)
    if principal.operator is not None:
        query = query.where(Alarm.operator == principal.operator)
    equal = {
        Alarm.operator: wanted.operator,
        Pump.serial: wanted.serial,
        Pump.pump_type: wanted.pump_type,
        Alarm.priority: wanted.priority,
        Alarm.side: wanted.side,
        Alarm.verdict_state: wanted.verdict_state,
        Alarm.assignee: wanted.assignee,
        Alarm.work_order: wanted.work_order,
    }
    query = query.where(*(column == value for column, value in equal.items() if value is not None))
    if wanted.aircraft is not None:
        there = select(StoredAssessment.record_id).where(StoredAssessment.aircraft == wanted.aircraft)
        query = query.where(Alarm.record_id.in_(there))
    if wanted.overdue is not None:
        late = and_(_is_in("open"), Alarm.due_at.is_not(None), Alarm.due_at < datetime.now(UTC))
        query = query.where(late if wanted.overdue else not_(late))
    if wanted.state is not None:
        query = query.where(_is_in(wanted.state))
    if after is not None:
        query = query.where(tuple_(Alarm.raised_at, Alarm.id) < (datetime.fromisoformat(after[0]), after[1]))
    return query.order_by(Alarm.raised_at.desc(), Alarm.id.desc())


def alarm(session: Session, principal: Principal, alarm_id: str) -> tuple[Alarm, Pump]:
    """One alarm with its pump.

    Raises
    ------
    NotFound
        when there is none that this principal may see.
    """
    query = select(Alarm, Pump).join(Pump, Pump.id == Alarm.pump_id).where(Alarm.id == alarm_id)
    found = session.execute(query).first()
    if found is None or principal.operator not in (None, found[0].operator):
        raise NotFound(f"there is no alarm {alarm_id}")
    return found[0], found[1]


def _is_in(state: Filter) -> ColumnElement[bool]:
    living = and_(Alarm.withdrawn_at.is_(None), Alarm.closed_at.is_(None))
    if state == "withdrawn":
        return Alarm.withdrawn_at.is_not(None)
    if state == "closed":
        return and_(Alarm.withdrawn_at.is_(None), Alarm.closed_at.is_not(None))
    if state == "open":
        return and_(living, or_(Alarm.condition == "active", Alarm.acknowledged.is_(False)))
    if state == "active":
        return and_(living, Alarm.condition == "active")
    if state == "unacknowledged":
        return and_(living, Alarm.acknowledged.is_(False))
    if state == "shelved":
        return and_(living, Alarm.shelved_until > datetime.now(UTC))
    condition, _, acknowledged = state.partition("_")
    return and_(living, Alarm.condition == condition, Alarm.acknowledged.is_(acknowledged == "acknowledged"))
