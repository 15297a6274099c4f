"""What other thresholds would have done: the real fold on stored history, without writing."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from service.access.security import Principal
from service.alarms.comparison import gained_and_lost
from service.alarms.ledger import points_of
from service.alarms.life_cycle import Life, Point, lives, rules_of
from service.answers.thresholds import JudgedFindings, Preview, PreviewTotals, PumpPreview
from service.answers.words import instant
from service.errors import Invalid, TooLarge
from service.history.archive import Archive
from service.history.knowledge import entries, knowledge
from service.monitoring.reanalysis import points_of_fold, pumps_of
from service.monitoring.succession import with_neighbours
from service.storage.tables import ANALYSED, Finding, Pump, Record
from service.storage.tables.history import NO_FAULT_FOUND
from service.thresholds.layers import Candidate, Scope, thresholds_of, value_faults


@dataclass(frozen=True, slots=True)
class Workbench:
    """What a preview works with; ``most_records`` bounds the work of one answer."""

    session: Session
    archive: Archive
    most_records: int


def preview(bench: Workbench, principal: Principal, scope: Scope, values: Mapping[str, float]) -> Preview:
    """Compare the alarms of today's thresholds with those of a candidate for one layer.

    Only pumps that the principal may see are looked at. Actions of operators play no part on either side.

    Raises
    ------
    Invalid
        with every fault of the values.
    TooLarge
        when there are more records than one answer may take.
    """
    faults = value_faults(bench.session, scope, values)
    if faults:
        raise Invalid(f"{len(faults)} fault(s) in the thresholds; nothing was computed", faults)
    started = time.perf_counter()
    pumps = pumps_with_records(bench.session, principal.operator, scope)
    total = sum(n for _, n in pumps)
    if total > bench.most_records:
        raise TooLarge(
            f"this preview would fold {total} records, one answer may take {bench.most_records}: "
            "preview a narrower scope",
            extra={"records": total, "limit": bench.most_records, "pumps": len(pumps)},
        )
    items = [compared(bench.session, bench.archive, pump, scope, values) for pump, _ in pumps]
    return {
        "scope": scope.kind,
        "id": scope.id,
        "totals": totals(items),
        "items": [item for item in items if differs(item)],
        "cost": {
            "pumps": len(items),
            "records": total,
            "limit": bench.most_records,
            "seconds": round(time.perf_counter() - started, 3),
        },
    }


def pumps_with_records(session: Session, operator: str | None, scope: Scope) -> list[tuple[Pump, int]]:
    """Pumps that a layer holds for and that have records, with how many; of one operator, or of all for None."""
    counts = select(Record.pump_id, func.count().label("n")).where(Record.status == ANALYSED).group_by(Record.pump_id)
    counted = counts.subquery()
    query = pumps_of(scope).join(counted, counted.c.pump_id == Pump.id).add_columns(counted.c.n)
    if operator is not None:
        query = query.where(Pump.operator == operator)
    return [(pump, int(n)) for pump, n in session.execute(query)]


def compared(session: Session, archive: Archive, pump: Pump, scope: Scope, values: Mapping[str, float]) -> PumpPreview:
    """One pump's alarms with today's thresholds beside those with a candidate for one layer."""
    now = thresholds_of(session, pump.operator, pump.serial, pump.pump_type)
    wanted = thresholds_of(session, pump.operator, pump.serial, pump.pump_type, candidate=Candidate(scope, values))
    then = with_neighbours(session, pump, archive, knowledge(session, pump, archive, thresholds=wanted))
    points = points_of(session, pump.id)
    others = points_of_fold(session, then)
    before, after = lives(points, (), rules_of(now.values)), lives(others, (), rules_of(wanted.values))
    first = [alarms[0].raised_at if alarms else None for alarms in (before, after)]
    findings = entries(session, Finding, pump.id)
    return {
        "pump_serial": pump.serial,
        "operator": pump.operator,
        "alarms_now": len(before),
        "alarms_with_candidate": len(after),
        **gained_and_lost(before, after),
        "changed": [_identity(a) for a in before] != [_identity(a) for a in after],
        "first_alarm": {
            "now": instant(first[0]),
            "with_candidate": instant(first[1]),
            "earlier_by_days": _days(first[0], first[1]),
            "earlier_by_flights": _flights(points, first[0], first[1]),
        },
        "findings": {
            "false_now": _false(before, findings),
            "false_with_candidate": _false(after, findings),
            "missed_now": _missed(before, findings),
            "missed_with_candidate": _missed(after, findings),
        },
    }


def differs(item: Mapping[str, Any]) -> bool:
    """True where a pump's alarms would not be the same."""
    return bool(item["gained"] or item["lost"] or item["changed"])


def totals(items: Sequence[PumpPreview]) -> PreviewTotals:
    """Alarms and findings of several pumps together."""
    return {
        "alarms_now": sum(item["alarms_now"] for item in items),
        "alarms_with_candidate": sum(item["alarms_with_candidate"] for item in items),
        "gained": sum(len(item["gained"]) for item in items),
        "lost": sum(len(item["lost"]) for item in items),
        "findings": _added([item["findings"] for item in items]),
    }


def _identity(alarm: Life) -> tuple[Any, ...]:
    return alarm.onset_at, alarm.raised_at, alarm.cleared_at, alarm.state, alarm.priority


def _days(now: datetime | None, then: datetime | None) -> float | None:
    return None if now is None or then is None else round((now - then).total_seconds() / 86_400.0, 3)


def _flights(points: Sequence[Point], now: datetime | None, then: datetime | None) -> int | None:
    if now is None or then is None:
        return None
    low, high = sorted((now, then))
    n = len({p.flight_id for p in points if low < p.at <= high})
    return n if then < now else -n


def _false(alarms: Sequence[Life], findings: Sequence[Finding]) -> int:
    return sum(f.found == NO_FAULT_FOUND and any(a.covers(f.at) for a in alarms) for f in findings)


def _missed(alarms: Sequence[Life], findings: Sequence[Finding]) -> int:
    return sum(f.found != NO_FAULT_FOUND and not any(a.covers(f.at) for a in alarms) for f in findings)


def _added(counts: Sequence[JudgedFindings]) -> JudgedFindings:
    return {
        "false_now": sum(c["false_now"] for c in counts),
        "false_with_candidate": sum(c["false_with_candidate"] for c in counts),
        "missed_now": sum(c["missed_now"] for c in counts),
        "missed_with_candidate": sum(c["missed_with_candidate"] for c in counts),
    }
