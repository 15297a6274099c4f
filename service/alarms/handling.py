"""What an operator does about an alarm: acknowledge, shelve, close, plan, comment; checked, noted, and then followed."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import TypedDict

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.access import audit
from service.access.security import Principal
from service.alarms import reading
from service.alarms.ledger import follow
from service.alarms.life_cycle import ACKNOWLEDGE, CLOSE, COMMENT, PLAN, SHELVE, UNSHELVE
from service.answers import alarms as answers
from service.answers.documents import JsonObject, RowValues
from service.answers.words import instant
from service.errors import Conflict, Fault, Invalid, Problem
from service.storage.database import Database
from service.storage.tables import Alarm, AlarmAction, Pump, StoredAssessment
from service.thresholds.layers import thresholds_of


class Plan(TypedDict):
    """What is planned about an alarm: who works on it, by when, under which number of a work order."""

    assignee: str | None
    due_at: datetime | None
    work_order: str | None


class PartOfPlan(TypedDict, total=False):
    """Parts of a plan that are to change."""

    assignee: str | None
    due_at: datetime | None
    work_order: str | None


@dataclass(frozen=True, slots=True)
class Wish:
    """What shall be done: one of the kinds of ``life_cycle``, why, and for a shelf until when.

    ``plan`` holds what a plan shall say from now on, of ``assignee``, ``due_at`` and ``work_order``: None takes back,
    what is not named stays.
    """

    kind: str
    reason: str | None = None
    until: datetime | None = None
    plan: PartOfPlan = field(default_factory=PartOfPlan)


def handle(database: Database, principal: Principal, alarm_id: str, wish: Wish) -> answers.Alarm:
    """Do it in one transaction and give the alarm as it is now.

    Raises
    ------
    NotFound
        when there is no such alarm for this principal.
    Invalid
        with every fault of reason and time.
    Conflict
        when the alarm is in a state in which it makes no sense.
    """
    principal.require("analyst")
    with database.writing() as session:
        _, pump = reading.alarm(session, principal, alarm_id)
        locked = select(Pump).where(Pump.id == pump.id).with_for_update()
        session.scalars(locked.execution_options(populate_existing=True)).one().changed()
        row, pump = reading.alarm(session, principal, alarm_id)
        session.refresh(row)
        thresholds = thresholds_of(session, pump.operator, pump.serial, pump.pump_type).values
        now = datetime.now(UTC)
        _check_wish(wish, thresholds["alarm_shelving_maximum_h"], now)
        _check_state(row, wish, now)
        plan = _planned(row, wish)
        planned: RowValues = {} if plan is None else {**plan}
        session.add(
            AlarmAction(
                alarm_id=row.id,
                pump_id=pump.id,
                kind=wish.kind,
                by=principal.owner,
                reason=wish.reason,
                until=wish.until,
                **planned,
                onset_at=row.onset_at,
                seen_at=_last_known(session, pump) or row.raised_at,
                seen_state=row.verdict_state,
                seen_priority=row.priority,
                done_at=now,
            )
        )
        details: JsonObject = {"reason": wish.reason, "until": wish.until.isoformat() if wish.until else None}
        if plan is not None:
            details |= {**plan, "due_at": instant(plan["due_at"])}
        audit.note(session, principal, f"alarm.{wish.kind}", f"alarm/{row.id}", pump.operator, details)
        follow(session, pump, thresholds)
        return reading.shown(row, pump.serial, pump.pump_type)


def handle_many(
    database: Database, principal: Principal, alarm_ids: Sequence[str], wish: Wish
) -> list[answers.Alarm | Problem]:
    """Do the same about each of them, each for itself: the alarm as it is now, or why nothing was done about it.

    Raises
    ------
    Forbidden
        when the principal may not handle alarms at all.
    """
    principal.require("analyst")
    found: list[answers.Alarm | Problem] = []
    for alarm_id in dict.fromkeys(alarm_ids):
        try:
            found.append(handle(database, principal, alarm_id, wish))
        except Problem as problem:
            found.append(problem)
    return found


def _planned(row: Alarm, wish: Wish) -> Plan | None:
    """The whole plan as it shall be; None for what is no plan."""
    if wish.kind != PLAN:
        return None
    held: Plan = {"assignee": row.assignee, "due_at": row.due_at, "work_order": row.work_order}
    plan = held | wish.plan
    if plan == held:
        raise Conflict("the alarm has that plan already", extra={"state": reading.state_of(row)})
    return plan


def _plan_faults(plan: PartOfPlan, now: datetime) -> list[Fault]:
    if not set(plan):
        return [Fault("body", "names none of assignee, due_at and work_order: nothing would change")]
    due = plan.get("due_at")
    return [Fault("body.due_at", "lies in the past")] if due is not None and due <= now else []


def _check_wish(wish: Wish, longest_h: float, now: datetime) -> None:
    faults = _plan_faults(wish.plan, now) if wish.kind == PLAN else []
    if wish.kind == COMMENT and not (wish.reason or "").strip():
        faults.append(Fault("body.reason", "is empty: a comment says something"))
    if wish.kind in (SHELVE, CLOSE) and not (wish.reason or "").strip():
        faults.append(Fault("body.reason", "is empty: say why, whoever finds the alarm next will ask"))
    if wish.kind == SHELVE:
        if wish.until is None:
            faults.append(Fault("body.until", "is missing: a shelf has an end"))
        elif wish.until.tzinfo is None:
            faults.append(Fault("body.until", "has no time zone: write Z for UTC"))
        elif wish.until <= now:
            faults.append(Fault("body.until", "lies in the past"))
        elif wish.until > now + timedelta(hours=longest_h):
            faults.append(Fault("body.until", f"is more than {longest_h:g} h away (alarm_shelving_maximum_h)"))
    if faults:
        raise Invalid(f"{len(faults)} fault(s); the alarm is unchanged", faults)


def _check_state(row: Alarm, wish: Wish, now: datetime) -> None:
    state = reading.state_of(row)
    # a work order may be numbered, and a word be said, after the alarm was closed
    if state == "withdrawn" or (state == "closed" and wish.kind not in (COMMENT, PLAN)):
        raise Conflict(f"the alarm is {state}: there is nothing left to {wish.kind}", extra={"state": state})
    if wish.kind == ACKNOWLEDGE and row.acknowledged:
        raise Conflict("the alarm is acknowledged already", extra={"state": state})
    if wish.kind == SHELVE and row.condition == "cleared":
        raise Conflict("the alarm has cleared: a shelf is for active alarms", extra={"state": state})
    if wish.kind == UNSHELVE and not reading.is_shelved(row, now):
        raise Conflict("the alarm is not on the shelf", extra={"state": state})


def _last_known(session: Session, pump: Pump) -> datetime | None:
    query = select(StoredAssessment.at).where(StoredAssessment.pump_id == pump.id)
    return session.scalar(query.order_by(StoredAssessment.at.desc()).limit(1))
