"""How often the workshop agreed with the verdicts: false alarms, missed faults, right sides."""

from collections.abc import Iterable
from dataclasses import dataclass

from scipy.stats import binomtest
from sqlalchemy import select
from sqlalchemy.orm import Session

from detectors.words.states import QUIET
from detectors.words.verdict import FAULTS, SIDE_OF, State
from service.access.security import Principal
from service.answers.fleet import Agreement
from service.answers.shares import Share
from service.storage.tables import Finding, Pump, StoredAssessment
from service.storage.tables.history import NO_FAULT_FOUND


@dataclass(frozen=True, slots=True)
class JudgedFinding:
    """A finding beside the state that the verdict had by then; ``state`` None without any record."""

    found: str
    state: str | None

    @property
    def was_alarm(self) -> bool:
        """True where the verdict named a fault or said that something has changed."""
        return self.state is not None and self.state not in QUIET


def judged_findings(session: Session, principal: Principal) -> list[JudgedFinding]:
    """Every finding that the asker may see, beside the verdict at its instant (today's knowledge)."""
    # pump by pump from the end of the index: whole histories grow
    by_then = (
        select(StoredAssessment.state)
        .where(StoredAssessment.pump_id == Finding.pump_id, StoredAssessment.at <= Finding.at)
        .order_by(StoredAssessment.at.desc(), StoredAssessment.record_id.desc())
        .limit(1)
        .correlate(Finding)
        .scalar_subquery()
    )
    query = select(Finding.found, by_then).where(Finding.withdrawn_at.is_(None))
    if principal.operator is not None:
        query = query.join(Pump, Finding.pump_id == Pump.id).where(Pump.operator == principal.operator)
    return [JudgedFinding(found, state) for found, state in session.execute(query)]


def rates(judged: Iterable[JudgedFinding]) -> Agreement:
    """How often the workshop agreed, with Wilson 95 % intervals.

    ``false_alarms``: of the findings on a pump in alarm, those where nothing was found. ``missed``: of the findings
    of a fault, those on a pump that was not in alarm. ``side_right``: of the faults found on a pump whose alarm named
    a side, those on that side. A share without any case is null.
    """
    judged = list(judged)
    alarms = [j for j in judged if j.was_alarm]
    faults = [j for j in judged if j.found != NO_FAULT_FOUND]
    named = [j for j in alarms if j.found != NO_FAULT_FOUND and j.state in {f.value for f in FAULTS}]
    right = [j for j in named if SIDE_OF[State(j.found)] is SIDE_OF[State(str(j.state))]]
    return {
        "count": len(judged),
        "false_alarms": share_of(sum(j.found == NO_FAULT_FOUND for j in alarms), len(alarms)),
        "missed": share_of(sum(not j.was_alarm for j in faults), len(faults)),
        "side_right": share_of(len(right), len(named)),
    }


def share_of(cases: int, of: int) -> Share:
    """Share of ``cases`` out of ``of`` with its Wilson 95 % interval; nulls without any."""
    if of == 0:
        return {"cases": 0, "of": 0, "share": None, "low": None, "high": None}
    interval = binomtest(cases, of).proportion_ci(0.95, method="wilson")
    return {"cases": cases, "of": of, "share": cases / of, "low": float(interval.low), "high": float(interval.high)}
