"""What happened in a pump's life beside its records, as marks for its trends."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import pairwise
from typing import NamedTuple

from sqlalchemy import or_, select
from sqlalchemy.orm import Session

from detectors.words.states import State
from service.alarms.reading import state_of
from service.history.knowledge import entries
from service.reading.pump_history import PumpHistory
from service.storage.tables import Alarm, Finding, Installation, MaintenanceEvent, Pump, ThresholdVersion

EXCHANGE, MAINTENANCE, FINDING, ALARM, BASELINE, THRESHOLDS = (
    "exchange", "maintenance", "finding", "alarm", "baseline", "thresholds"
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class PumpEvent:
    """One event: when, of which kind, the word that tells it from others of its kind, and a note."""

    at: datetime
    kind: str
    what: str
    note: str = ""


class Entered(NamedTuple):
    """What people have entered about a pump and counts now, in the order in which they did."""

    installations: Sequence[Installation]
    maintenance: Sequence[MaintenanceEvent]
    findings: Sequence[Finding]


def entered_of(session: Session, pump_id: int) -> Entered:
    """What counts of a pump's entries."""
    return Entered(
        entries(session, Installation, pump_id),
        entries(session, MaintenanceEvent, pump_id),
        entries(session, Finding, pump_id),
    )


def events_of(
    session: Session,
    pump: Pump,
    entered: Entered,
    seen: PumpHistory,
    since: datetime | None,
    until: datetime | None,
) -> list[PumpEvent]:
    """Events of a pump from ``since`` on and before ``until``, in order.

    ``seen`` are its records of that time: changes of place and of the baseline are read from them. Thresholds count
    when they were published, everything else in event time.
    """
    found = [*_of_records(seen), *_entered(entered), *_alarms(session, pump), *_thresholds(session, pump)]
    inside = [e for e in found if (since is None or e.at >= since) and (until is None or e.at < until)]
    return sorted(inside, key=lambda e: (e.at, e.kind, e.what))


def _of_records(seen: PumpHistory) -> list[PumpEvent]:
    found = []
    places = pairwise(zip(seen.aircraft, seen.position, seen.state, strict=True))
    for i, (before, after) in enumerate(places, 1):
        if before == after:
            continue
        if before[:2] != after[:2]:
            found.append(PumpEvent(seen.instant(i), EXCHANGE, f"now in {after[0]} {after[1]}"))
        learnt = [state == State.INSUFFICIENT_DATA for state in (before[2], after[2])]
        if learnt == [True, False]:
            found.append(PumpEvent(seen.instant(i), BASELINE, "complete"))
        elif learnt == [False, True]:
            found.append(PumpEvent(seen.instant(i), BASELINE, "begins anew"))
    return found


def _entered(entered: Entered) -> list[PumpEvent]:
    found = [PumpEvent(e.at, MAINTENANCE, e.action, e.note) for e in entered.maintenance]
    found += [PumpEvent(f.at, FINDING, f.found, f.note) for f in entered.findings]
    for place in entered.installations:
        where = f"{place.aircraft} {place.position}"
        found.append(PumpEvent(place.installed_at, EXCHANGE, f"installed in {where}"))
        if place.removed_at is not None:
            found.append(PumpEvent(place.removed_at, EXCHANGE, f"removed from {where}"))
    return found


def _alarms(session: Session, pump: Pump) -> list[PumpEvent]:
    query = select(Alarm).where(Alarm.pump_id == pump.id, Alarm.withdrawn_at.is_(None))
    return [
        PumpEvent(a.onset_at, ALARM, a.verdict_state, f"{a.priority}, {state_of(a).replace('_', ', ')}")
        for a in session.scalars(query)
    ]


def _thresholds(session: Session, pump: Pump) -> list[PumpEvent]:
    layers: Mapping[str, str] = {
        "fleet": "default", "pump-type": pump.pump_type, "operator": pump.operator, "pump": pump.serial
    }  # fmt: skip
    held = ThresholdVersion
    mine = or_(*((held.scope == scope) & (held.scope_id == name) for scope, name in layers.items()))
    query = select(held).where(mine, or_(held.operator.is_(None), held.operator == pump.operator))
    return [PumpEvent(v.created_at, THRESHOLDS, f"version {v.number}", v.reason) for v in session.scalars(query)]
