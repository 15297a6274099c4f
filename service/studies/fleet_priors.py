"""Priors learnt from a stored fleet, frozen into a pump type of its own: another number of the twin's version."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import select

from detectors.judgement.population import Posterior, Spread, learnt, posterior_of
from detectors.judgement.snapshot import fold_from
from service.errors import Fault, Invalid
from service.history.archive import Archive
from service.history.knowledge import knowledge
from service.monitoring.fold import steps
from service.pump_types.parameter_sets import asked_type, find_type
from service.storage.database import Database
from service.storage.tables import Pump
from twin.parameters import PumpType
from twin.pumps.written import pump_type_from


@dataclass(frozen=True, slots=True)
class FleetPriors:
    """The learnt pump type as a document that ``POST /pump-types`` takes, and what it was learnt from."""

    document: dict[str, Any]
    kind: PumpType
    spreads: tuple[Spread, ...]
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
        found = [p for p in (_posterior(archive, session, pump) for pump in pumps) if p is not None]
    try:
        spreads = learnt(found, kind)
    except ValueError as error:
        raise Invalid("nothing was learnt", [Fault("pumps", str(error))]) from None
    of = f"of {operator}" if operator else "of all operators"
    source = f"learnt from {len(found)} healthy pumps {of} on {datetime.now(UTC):%Y-%m-%d}"
    changes = {
        f"population.{s.name}": {"value": float(f"{s.value:.4g}"), "unit": s.unit, "source": source} for s in spreads
    }
    document = {"id": name, "base": base, "title": f"{kind.title}, {source}", "changes": changes}
    return FleetPriors(document, pump_type_from(document, {base: kind}), spreads, len(found), len(pumps))


def remarks(found: FleetPriors) -> Sequence[str]:
    """What a reader of the new pump type should know."""
    lines = [f"{found.healthy} of {found.pumps} pumps are healthy and long enough in place"]
    lines += [
        f"{s.name}: {s.value:.3g} {s.unit} ({s.low:.3g} to {s.high:.3g}), was {s.before:.3g}; {s.pumps} pumps told"
        for s in found.spreads
    ]
    return lines


def _posterior(archive: Archive, session: Any, pump: Pump) -> Posterior | None:
    gathered = knowledge(session, pump, archive)
    known, n = gathered.known, len(gathered.known.placed)
    last = None
    for step in steps(known, gathered.observations(session), snapshots_at={n}):
        last = step.snapshot
    if last is None:
        return None
    setting = known.placed[-1].setting
    kind = setting.pump_type(known.kind)
    return posterior_of(fold_from(last, kind, setting.circuit_parameters, known.thresholds, known.healthy_in(setting)))
