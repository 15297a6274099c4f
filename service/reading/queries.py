"""Reading: the questions that routes and pages ask of the database."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, NamedTuple, TypeVar

from sqlalchemy import ColumnElement, ScalarSelect, Select, func, or_, select, tuple_
from sqlalchemy.orm import InstrumentedAttribute, Session

from service.access.security import Principal
from service.answers.pumps import TrendPoint
from service.answers.records import Window
from service.answers.verdicts import Estimate, Verdict
from service.answers.words import instant
from service.errors import NotFound
from service.history.verdicts import empty_verdict
from service.pump_types.parameter_sets import held_type
from service.storage.among import among
from service.storage.tables import (
    Aircraft,
    Alarm,
    ApiKey,
    Pump,
    Record,
    Refusal,
    StoredAssessment,
    VerdictRevision,
    Webhook,
)
from service.thresholds.layers import thresholds_of


def record(session: Session, principal: Principal, record_id: str) -> Record:
    """One record.

    Raises
    ------
    NotFound
        when there is none that this principal may see.
    """
    row = session.get(Record, record_id)
    if row is None or principal.operator not in (None, row.operator):
        raise NotFound(f"there is no record {record_id}")
    return row


def pump(session: Session, principal: Principal, serial: str, operator: str | None) -> Pump:
    """One pump by serial number, within the operator's own.

    Raises
    ------
    NotFound
        when there is none that this principal may see, or several operators have one and none was named.
    """
    return _only(session, select(Pump).where(Pump.serial == serial), Pump, principal, operator, f"pump {serial}")


def aircraft(session: Session, principal: Principal, name: str, operator: str | None) -> Aircraft:
    """One aircraft by name, within the operator's own; raises as ``pump``."""
    query = select(Aircraft).where(Aircraft.name == name)
    return _only(session, query, Aircraft, principal, operator, f"aircraft {name}")


Owned = TypeVar("Owned", Pump, Aircraft)


def _only(
    session: Session,
    query: Select[Owned],
    table: type[Owned],
    principal: Principal,
    operator: str | None,
    words: str,
) -> Owned:
    """The one row of a query that belongs to the principal's operator, or to the one that was named."""
    wanted = principal.operator or operator
    if wanted is not None:
        query = query.where(table.operator == wanted)
    rows = session.scalars(query.limit(2)).all()
    if len(rows) > 1:
        article = "an" if words[0] in "aeiou" else "a"
        raise NotFound(f"several operators have {article} {words}: name one with ?operator=")
    if not rows or (operator is not None and rows[0].operator != operator):
        raise NotFound(f"there is no {words}")
    return rows[0]


Made = TypeVar("Made", ApiKey, Webhook)


def in_order_of_making(table: type[Made], principal: Principal, after: Sequence[Any] | None) -> Select[Made]:
    """Keys or webhooks that an admin may manage, the oldest first, behind the place of a cursor."""
    query = select(table).order_by(table.created_at, table.id)
    if principal.operator is not None:
        query = query.where(table.operator == principal.operator)
    if after is not None:
        query = query.where(tuple_(table.created_at, table.id) > (datetime.fromisoformat(after[0]), after[1]))
    return query


def records(
    principal: Principal,
    *,
    serial: str | None = None,
    since: datetime | None = None,
    until: datetime | None = None,
    status: str | None = None,
    after: Sequence[Any] | None = None,
) -> Select[Record, str | None, str | None]:
    """Records with their pump's serial and the state right after them, newest received first."""
    query = select(Record, Pump.serial, StoredAssessment.state).outerjoin(Pump, Record.pump_id == Pump.id)
    query = query.outerjoin(StoredAssessment, StoredAssessment.record_id == Record.id)
    if principal.operator is not None:
        query = query.where(Record.operator == principal.operator)
    if serial is not None:
        query = query.where(Pump.serial == serial)
    if since is not None:
        query = query.where(Record.started_at >= since)
    if until is not None:
        query = query.where(Record.started_at < until)
    if status is not None:
        query = query.where(Record.status == status)
    if after is not None:
        place = (datetime.fromisoformat(after[0]), after[1])
        query = query.where(tuple_(Record.received_at, Record.id) < place)
    return query.order_by(Record.received_at.desc(), Record.id.desc())


def windows_of(row: Record) -> list[Window]:
    """Windows of a record in time order, each with its residuals; empty where it is not analysed."""
    residuals = row.residuals or {}
    found = (row.reduction or {}).get("windows", [])
    return [{**window, "residuals": residuals.get(str(i), {})} for i, window in enumerate(found)]


def refusals(principal: Principal, after: Sequence[Any] | None = None) -> Select[Refusal]:
    """Uploads that were refused at once, the newest first."""
    query = select(Refusal)
    if principal.operator is not None:
        query = query.where(Refusal.operator == principal.operator)
    if after is not None:
        query = query.where(tuple_(Refusal.received_at, Refusal.id) < (datetime.fromisoformat(after[0]), after[1]))
    return query.order_by(Refusal.received_at.desc(), Refusal.id.desc())


@dataclass(frozen=True, slots=True)
class WantedPumps:
    """What a list of pumps is narrowed to; None takes all. ``silent_ids`` are those that are silent."""

    state: str | None = None
    side: str | None = None
    aircraft: str | None = None
    pump_type: str | None = None
    priority: str | None = None
    silent: bool | None = None
    silent_ids: frozenset[int] = frozenset()


_ALL_PUMPS = WantedPumps()


class Listed(NamedTuple):
    """What lists need of a pump's row: a whole fleet's are read with every page."""

    id: int
    operator: str
    serial: str
    pump_type: str
    confirmed: bool
    revision: int
    standing_at: int | None
    standing_link: str | None


def listed(session: Session, principal: Principal, *conditions: ColumnElement[bool]) -> list[Listed]:
    """Every pump that a principal may see and for which conditions hold, by operator and serial number."""
    held = (Pump.id, Pump.operator, Pump.serial, Pump.pump_type, Pump.confirmed, Pump.revision)
    rows = session.execute(
        pumps(principal).where(*conditions).with_only_columns(*held, Pump.standing_at, Pump.standing_link)
    )
    return [Listed._make(row) for row in rows]


def pumps(principal: Principal, after: Sequence[Any] | None = None, wanted: WantedPumps = _ALL_PUMPS) -> Select[Pump]:
    """Pumps by operator and serial; narrowed by their newest verdict, where they were last, and their open alarm."""
    query = select(Pump)
    if principal.operator is not None:
        query = query.where(Pump.operator == principal.operator)
    if after is not None:
        query = query.where(tuple_(Pump.operator, Pump.serial) > tuple(after))
    if wanted.pump_type is not None:
        query = query.where(Pump.pump_type == wanted.pump_type)
    if wanted.state is not None:
        query = query.where(func.coalesce(_newest(StoredAssessment.state), "insufficient_data") == wanted.state)
    if wanted.side is not None:
        query = query.where(func.coalesce(_newest(StoredAssessment.side), "unknown") == wanted.side)
    if wanted.aircraft is not None:
        query = query.where(_newest(StoredAssessment.aircraft) == wanted.aircraft)
    if wanted.priority is not None:
        query = query.where(func.coalesce(_open_priority(), "none") == wanted.priority)
    if wanted.silent is not None:
        is_silent = among(Pump.id, wanted.silent_ids)
        query = query.where(is_silent if wanted.silent else ~is_silent)
    return query.order_by(Pump.operator, Pump.serial)


def pumps_by_state() -> Select[str, int]:
    """Number of pumps by the state of their newest verdict, of every operator."""
    state = func.coalesce(_newest(StoredAssessment.state), "insufficient_data").label("state")
    states = select(state).select_from(Pump).subquery()
    return select(states.c.state, func.count()).group_by(states.c.state)


def _newest(column: InstrumentedAttribute[Any]) -> ScalarSelect[Any]:
    """A column of each pump's newest assessment."""
    last = select(column).where(StoredAssessment.pump_id == Pump.id)
    last = last.order_by(StoredAssessment.at.desc(), StoredAssessment.record_id.desc()).limit(1)
    return last.correlate(Pump).scalar_subquery()


def _open_priority() -> ScalarSelect[Any]:
    """Priority of each pump's newest open alarm, as the ranking has it."""
    living = select(Alarm.priority).where(
        Alarm.pump_id == Pump.id,
        Alarm.withdrawn_at.is_(None),
        Alarm.closed_at.is_(None),
        or_(Alarm.condition == "active", Alarm.acknowledged.is_(False)),
    )
    return living.order_by(Alarm.raised_at.desc(), Alarm.id.desc()).limit(1).correlate(Pump).scalar_subquery()


def assessments(pump_id: int, until: datetime | None = None) -> Select[StoredAssessment]:
    """A pump's assessments in event order."""
    query = select(StoredAssessment).where(StoredAssessment.pump_id == pump_id)
    if until is not None:
        query = query.where(StoredAssessment.at <= until)
    return query.order_by(StoredAssessment.at, StoredAssessment.record_id)


@dataclass(frozen=True, slots=True)
class TrendOfRecord:
    """What one record added to the trends, and where and when in the pump's life it was taken."""

    at: datetime
    aircraft: str
    position: str
    flight_hours: float | None
    state: str
    trend: dict[str, Estimate]


def trends_of_records(session: Session, pump_id: int, metric: str) -> list[TrendOfRecord]:
    """A pump's points of one metric with their place and flight hours, in event order."""
    kept = StoredAssessment
    query = select(kept.at, kept.aircraft, kept.position, Record.flight_hours, kept.state, kept.trend[metric])
    query = query.join(Record, Record.id == kept.record_id).where(kept.pump_id == pump_id)
    rows = session.execute(query.order_by(kept.at, kept.record_id))
    return [
        TrendOfRecord(at, aircraft, position, hours, state, {} if value is None else {metric: value})
        for at, aircraft, position, hours, state, value in rows
    ]


def newest_assessments(session: Session, pump_id: int, n: int) -> list[StoredAssessment]:
    """A pump's newest ``n`` assessments in event order."""
    query = select(StoredAssessment).where(StoredAssessment.pump_id == pump_id)
    newest = query.order_by(StoredAssessment.at.desc(), StoredAssessment.record_id.desc()).limit(n)
    return list(session.scalars(newest))[::-1]


def newest_flows(session: Session, pump_ids: Sequence[int], n: int) -> dict[int, list[TrendPoint]]:
    """Case flow at the reference condition over each pump's newest ``n`` assessments, in event order."""
    kept = StoredAssessment
    estimate = kept.trend["case_flow_at_reference_lpm"]
    parts = [estimate[part].as_float() for part in ("mean", "low", "high")]
    # pump by pump from the end of the index: numbering the rows of whole histories grows with their length
    since = (
        select(kept.at)
        .where(kept.pump_id == Pump.id)
        .order_by(kept.at.desc())
        .limit(1)
        .offset(n - 1)
        .correlate(Pump)
        .scalar_subquery()
    )
    firsts = select(Pump.id, since.label("since")).where(among(Pump.id, pump_ids)).cte("firsts")
    firsts = firsts.prefix_with("MATERIALIZED")
    query = select(kept.pump_id, kept.at, kept.record_id, *parts)
    query = query.join(firsts, (firsts.c.id == kept.pump_id) & ((kept.at >= firsts.c.since) | firsts.c.since.is_(None)))
    found: dict[int, list[TrendPoint]] = {}
    for pump_id, at, record_id, mean, low, high in session.execute(query.order_by(kept.at, kept.record_id)):
        if mean is not None and low is not None and high is not None:
            point: TrendPoint = {"at": instant(at), "value": mean, "low": low, "high": high, "record_id": record_id}
            found.setdefault(pump_id, []).append(point)
    return found


def last_assessments(session: Session, pump_ids: Sequence[int]) -> dict[int, StoredAssessment]:
    """The newest assessment of each pump that has one."""
    query = select(StoredAssessment).where(StoredAssessment.record_id.in_(newest_records(pump_ids)))
    return {a.pump_id: a for a in session.scalars(query)}


def newest_records(pump_ids: Sequence[int]) -> Select[str | None]:
    """Ids of the records of each pump's newest assessment."""
    # pump by pump from the end of the index: numbering the rows of whole histories grows with their length
    newest = (
        select(StoredAssessment.record_id)
        .where(StoredAssessment.pump_id == Pump.id)
        .order_by(StoredAssessment.at.desc(), StoredAssessment.record_id.desc())
        .limit(1)
        .correlate(Pump)
        .scalar_subquery()
    )
    return select(newest).where(among(Pump.id, pump_ids))


def verdict(session: Session, row: Pump, at: datetime | None = None) -> Verdict:
    """Verdict of a pump now or at an event time, in the shape of the API."""
    query = select(StoredAssessment).where(StoredAssessment.pump_id == row.id)
    if at is not None:
        query = query.where(StoredAssessment.at <= at)
    last = session.scalar(query.order_by(StoredAssessment.at.desc(), StoredAssessment.record_id.desc()).limit(1))
    if last is not None:
        return last.verdict
    kind = held_type(session, row.operator, row.pump_type)
    return empty_verdict(kind, thresholds_of(session, row.operator, row.serial, row.pump_type))


def verdict_changes(session: Session, row: Pump) -> list[StoredAssessment]:
    """The assessments at which the pump's state changed, in event order."""
    kept = StoredAssessment
    before = func.lag(kept.state).over(order_by=(kept.at, kept.record_id)).label("before")
    states = select(kept.record_id, kept.state, before).where(kept.pump_id == row.id).subquery()
    # whole verdicts of those only: a long history has hundreds for each change
    changed = select(states.c.record_id).where(states.c.before.is_(None) | (states.c.before != states.c.state))
    return list(session.scalars(assessments(row.id).where(kept.record_id.in_(changed))))


def revisions(pump_id: int, after: int | None = None) -> Select[VerdictRevision]:
    """Past verdicts of a pump that changed, the newest change first."""
    query = select(VerdictRevision).where(VerdictRevision.pump_id == pump_id)
    if after is not None:
        query = query.where(VerdictRevision.id < after)
    return query.order_by(VerdictRevision.id.desc())


def n_records(session: Session, pump_ids: Sequence[int]) -> dict[int, int]:
    """Number of records that count, by pump."""
    query = select(StoredAssessment.pump_id, func.count()).where(among(StoredAssessment.pump_id, pump_ids))
    return {pump_id: int(n) for pump_id, n in session.execute(query.group_by(StoredAssessment.pump_id))}


@dataclass(frozen=True, slots=True)
class Flight:
    """When a record began, and the pump's flight hours then [h]."""

    started_at: datetime | None
    flight_hours: float | None


def flights_of(session: Session, record_ids: Sequence[str]) -> dict[str, Flight]:
    """Flights of records, without their reductions."""
    query = select(Record.id, Record.started_at, Record.flight_hours).where(Record.id.in_(record_ids))
    return {record_id: Flight(started_at, hours) for record_id, started_at, hours in session.execute(query)}


@dataclass(frozen=True, slots=True)
class AssessmentOfRecord:
    """What was known right after one record."""

    serial: str
    verdict: Verdict


def record_with_assessment(
    session: Session, principal: Principal, record_id: str
) -> tuple[Record, AssessmentOfRecord | None]:
    """One record with the assessment right after it, where there is one; raises as ``record`` does."""
    query: Any = select(Record, Pump.serial, StoredAssessment.verdict)
    query = query.outerjoin(StoredAssessment, StoredAssessment.record_id == Record.id)
    found = session.execute(query.outerjoin(Pump, Pump.id == Record.pump_id).where(Record.id == record_id)).first()
    if found is None or principal.operator not in (None, found[0].operator):
        raise NotFound(f"there is no record {record_id}")
    return found[0], None if found[2] is None else AssessmentOfRecord(found[1], found[2])
