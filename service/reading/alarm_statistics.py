"""Alarms counted: how often, how long, by kind and by pump, and how many were a nuisance."""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from statistics import median
from typing import Any

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from service.access.security import Principal
from service.alarms import reading
from service.alarms.life_cycle import ACKNOWLEDGE, CLOSE
from service.answers.alarms import AlarmFigures, AlarmStatistics
from service.errors import Fault, Invalid
from service.reading.agreement import share_of
from service.storage.tables import Alarm, AlarmAction, Finding, Installation, MaintenanceEvent, StoredAssessment
from service.storage.tables.history import NO_FAULT_FOUND


@dataclass(frozen=True, slots=True)
class Period:
    """Event times at which alarms were raised, ``until`` not among them; None is open."""

    since: datetime | None = None
    until: datetime | None = None


@dataclass(slots=True)
class _Done:
    """What was done to pumps and found at them, by pump: instants in order of nothing."""

    works: dict[int, list[datetime]] = field(default_factory=lambda: defaultdict(list))
    faults: dict[int, list[datetime]] = field(default_factory=lambda: defaultdict(list))
    refutations: dict[int, list[datetime]] = field(default_factory=lambda: defaultdict(list))
    moved: set[str] = field(default_factory=set)
    acknowledged: dict[str, datetime] = field(default_factory=dict)


def statistics(
    session: Session, principal: Principal, wanted: reading.Wanted, period: Period, most_pumps: int
) -> AlarmStatistics:
    """Figures over the alarms that the principal may see, in five statements however many there are.

    An alarm counts as a nuisance where it ended without maintenance, an exchange or a finding of a fault since its
    onset, or where a finding within it says that there was none.

    Raises
    ------
    Invalid
        when the period ends before it begins.
    """
    if period.since is not None and period.until is not None and period.until <= period.since:
        raise Invalid("the period holds nothing", [Fault("to", "does not lie after from")])
    query = reading.alarms(principal, wanted).order_by(None)
    if period.since is not None:
        query = query.where(Alarm.raised_at >= period.since)
    if period.until is not None:
        query = query.where(Alarm.raised_at < period.until)
    rows = session.execute(query).all()
    done = _done(session, query.with_only_columns(Alarm.id, Alarm.pump_id).subquery()) if rows else _Done()
    kinds: dict[str, list[Alarm]] = defaultdict(list)
    pumps: dict[tuple[str, str], list[Alarm]] = defaultdict(list)
    for alarm, serial, _ in rows:
        kinds[alarm.verdict_state].append(alarm)
        pumps[serial, alarm.operator].append(alarm)
    by_pump = sorted(pumps, key=lambda name: (-_living(pumps[name]), name))
    return {
        "all": _figures([alarm for alarm, _, _ in rows], done),
        "by_kind": [
            {"verdict_state": kind, **_figures(kinds[kind], done)}
            for kind in sorted(kinds, key=lambda kind: (-_living(kinds[kind]), kind))
        ],
        "by_pump": [
            {"pump_serial": name[0], "operator": name[1], **_figures(pumps[name], done)}
            for name in by_pump[:most_pumps]
        ],
        "pumps": len(pumps),
    }


def _living(rows: Iterable[Alarm]) -> int:
    return sum(row.withdrawn_at is None for row in rows)


def _figures(rows: Sequence[Alarm], done: _Done) -> AlarmFigures:
    living = [row for row in rows if row.withdrawn_at is None]
    days = [(row.cleared_at - row.onset_at) / timedelta(days=1) for row in living if row.cleared_at is not None]
    hours = [
        max((done.acknowledged[row.id] - row.created_at) / timedelta(hours=1), 0.0)
        for row in living
        if row.id in done.acknowledged
    ]
    refuted = [row for row in living if _has(done.refutations, row)]
    idle = [row for row in living if row.cleared_at is not None and row not in refuted]
    nuisance = len(refuted) + sum(not _was_seen_to(row, done) for row in idle)
    events = [entry["event"] for row in living for entry in row.history]
    return {
        "raised": len(living),
        "open": sum(reading.state_of(row) not in ("closed", "cleared_acknowledged") for row in living),
        "cleared": len(days),
        "withdrawn": len(rows) - len(living),
        "escalations": events.count("escalated"),
        "reopened": events.count("reopened"),
        "median_days": median(days) if days else None,
        "longest_days": max(days, default=None),
        "median_hours_to_acknowledge": median(hours) if hours else None,
        "nuisance": share_of(nuisance, len(refuted) + len(idle)),
    }


def _was_seen_to(row: Alarm, done: _Done) -> bool:
    return row.id in done.moved or _has(done.works, row) or _has(done.faults, row)


def _has(instants: Mapping[int, Sequence[datetime]], row: Alarm) -> bool:
    end = row.cleared_at or datetime.now(UTC)
    return any(row.onset_at <= at <= end for at in instants.get(row.pump_id, ()))


def _done(session: Session, chosen: Any) -> _Done:
    """Everything that was done about the chosen alarms and their pumps."""
    found = _Done()
    pump_ids = select(chosen.c.pump_id)

    def held(table: type[Any], *columns: Any) -> Sequence[Any]:
        query = select(table.pump_id, *columns).where(table.pump_id.in_(pump_ids), table.withdrawn_at.is_(None))
        return session.execute(query).all()

    for pump_id, at in held(MaintenanceEvent, MaintenanceEvent.at):
        found.works[pump_id].append(at)
    for pump_id, installed_at, removed_at in held(Installation, Installation.installed_at, Installation.removed_at):
        found.works[pump_id] += [at for at in (installed_at, removed_at) if at is not None]
    for pump_id, at, what in held(Finding, Finding.at, Finding.found):
        (found.refutations if what == NO_FAULT_FOUND else found.faults)[pump_id].append(at)
    seen = select(AlarmAction.alarm_id, func.min(AlarmAction.done_at)).group_by(AlarmAction.alarm_id)
    seen = seen.where(AlarmAction.kind.in_((ACKNOWLEDGE, CLOSE)), AlarmAction.alarm_id.in_(select(chosen.c.id)))
    found.acknowledged = {row[0]: row[1] for row in session.execute(seen)}
    place = StoredAssessment
    there = (place.pump_id == Alarm.pump_id) & place.at.between(Alarm.onset_at, Alarm.cleared_at)
    moved = select(Alarm.id).join(place, there).where(Alarm.id.in_(select(chosen.c.id))).group_by(Alarm.id)
    several = (func.count(place.aircraft.distinct()) > 1) | (func.count(place.position.distinct()) > 1)
    found.moved = set(session.scalars(moved.having(several)))
    return found
