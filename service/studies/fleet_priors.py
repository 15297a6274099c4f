"""Priors learnt from a stored fleet, frozen into a pump type of its own: another number of the twin's version."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from sqlalchemy import select
from sqlalchemy.orm import Session

from detectors.judgement.population import Posterior, Rate, Spread, learnt, learnt_rates, posterior_of
from detectors.judgement.snapshot import fold_from
from detectors.words.verdict import Resolved, State
from service.answers.documents import JsonObject
from service.errors import Fault, Invalid
from service.history.archive import Archive
from service.history.knowledge import entries, knowledge
from service.monitoring.fold import steps
from service.monitoring.succession import with_neighbours
from service.pump_types.parameter_sets import asked_type, find_type
from service.storage.database import Database
from service.storage.tables import Finding, Pump
from service.storage.tables.history import NO_FAULT_FOUND
from twin.parameters import PumpType
from twin.pumps.written import pump_type_from

_SEASON = timedelta(days=90)
"""How far what the workshop found and what ended may lie apart and be one fault (our choice)."""


@dataclass(frozen=True, slots=True)
class FleetPriors:
    """The learnt pump type as a document that ``POST /pump-types`` takes, and what it was learnt from."""

    document: JsonObject
    kind: PumpType
    spreads: tuple[Spread, ...]
    rates: tuple[Rate, ...]
    healthy: int
    pumps: int


def learn(database: Database, archive: Archive, base: str, name: str, operator: str | None) -> FleetPriors:
    """Fold every pump of a type anew and learn from those that are healthy; nothing is stored.

    Parameters
    ----------
    base, name
        Pump type to learn for, and the name of the new one.
    operator
        Whose pumps count; None for all.

    Raises
    ------
    Invalid
        with every fault of what was asked for; too few healthy pumps are one.
    """
    with database.reading() as session:
        kind = asked_type(session, operator, base, "base")
        if find_type(session, operator, name) is not None:
            raise Invalid("nothing was learnt", [Fault("id", f"there is a pump type {name} already")])
        query = select(Pump).where(Pump.pump_type == base).order_by(Pump.id)
        if operator is not None:
            query = query.where(Pump.operator == operator)
        pumps = list(session.scalars(query))
        folded = [_folded(archive, session, pump) for pump in pumps]
    cases, records = _cases(folded), sum(f.records for f in folded)
    found = [f.posterior for f in folded if f.posterior is not None]
    try:
        spreads = learnt(found, kind)
    except ValueError as error:
        raise Invalid("nothing was learnt", [Fault("pumps", str(error))]) from None
    of = f"of {operator}" if operator else "of all operators"
    source = f"learnt from {len(found)} healthy pumps {of} on {datetime.now(UTC):%Y-%m-%d}"
    changes = {
        f"population.{s.name}": {"value": float(f"{s.value:.4g}"), "unit": s.unit, "source": source} for s in spreads
    }
    rates = learnt_rates(cases, records, kind)
    counted = f"{sum(cases.values())} findings in {records} records {of} on {datetime.now(UTC):%Y-%m-%d}"
    changes |= {
        f"population.{r.name}": {"value": float(f"{r.value:.4g}"), "unit": r.unit, "source": f"{r.cases} of {counted}"}
        for r in rates
    }
    document = {"id": name, "base": base, "title": f"{kind.title}, {source}", "changes": changes}
    return FleetPriors(document, pump_type_from(document, {base: kind}), spreads, rates, len(found), len(pumps))


def remarks(found: FleetPriors) -> Sequence[str]:
    """What a reader of the new pump type should know."""
    lines = [f"{found.healthy} of {found.pumps} pumps are healthy and long enough in place"]
    lines += [
        f"{s.name}: {s.value:.3g} {s.unit} ({s.low:.3g} to {s.high:.3g}), was {s.before:.3g}; {s.pumps} pumps told"
        for s in found.spreads
    ]
    lines += [
        f"{r.name}: {r.value:.3g} {r.unit} ({r.low:.3g} to {r.high:.3g}), was {r.before:.3g}; "
        f"found {r.cases} times in {r.records} records"
        for r in found.rates
    ]
    return lines


@dataclass(frozen=True, slots=True)
class _Folded:
    """What one pump adds: its posterior where it is healthy, its records, what was found on it, and what ended."""

    posterior: Posterior | None
    records: int
    findings: tuple[tuple[State, datetime], ...]
    resolved: Resolved | None = None


def _cases(folded: Sequence[_Folded]) -> Counter[State]:
    """Faults found, by state: by the workshop, or by what was done, where no workshop has said so within a season."""
    findings = [finding for f in folded for finding in f.findings]
    ended = [f.resolved for f in folded if f.resolved is not None]
    silent = [r for r in ended if all(s is not r.state or abs(at - r.at) > _SEASON for s, at in findings)]
    return Counter([*(state for state, _ in findings), *(r.state for r in silent)])


def _folded(archive: Archive, session: Session, pump: Pump) -> _Folded:
    gathered = with_neighbours(session, pump, archive, knowledge(session, pump, archive))
    known, n = gathered.known, len(gathered.known.placed)
    found = tuple((State(f.found), f.at) for f in entries(session, Finding, pump.id) if f.found != NO_FAULT_FOUND)
    last = None
    for step in steps(known, gathered.observations(session), snapshots_at={n}, others=gathered.others):
        last = step
    if last is None or last.snapshot is None:
        return _Folded(None, n, found)
    setting = known.placed[-1].setting
    kind = setting.pump_type(known.kind)
    fold = fold_from(last.snapshot, kind, setting.circuit_parameters, known.thresholds, known.healthy_in(setting))
    return _Folded(posterior_of(fold), n, found, last.assessment.verdict.resolved_by)
