"""What every upload asks of a pump before anything else, in one statement: its row, its registry, and which tables name it.

Whoever changes what is stored of a pump raises its ``revision`` under the pump's lock; what holds for many pumps (thresholds,
registry, curves, pump types) has numbers of its own that only grow. A dossier holds both, so that a fold that was made
without a lock can ask, with the lock, whether it still says what is known.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sqlalchemy import ColumnElement, exists, func, null, or_, select
from sqlalchemy.orm import Session, aliased

from service.storage.tables import (
    Aircraft,
    Alarm,
    Installation,
    MaintenanceEvent,
    Pump,
    RecordMark,
    ReferenceCurve,
    RegistryVersion,
    ThresholdPin,
    ThresholdVersion,
)

_NAMING: Mapping[str, Any] = {
    "installations": Installation,
    "maintenance": MaintenanceEvent,
    "marks": RecordMark,
    "alarms": Alarm,
    "pins": ThresholdPin,
}
"""Tables that name a pump, by what they hold."""


class ChangedError(Exception):
    """What was read of a pump is no longer so."""


@dataclass(frozen=True, slots=True)
class Dossier:
    """A pump as it was read; ``registry`` are the newest values of the pump and of one aircraft, by kind and name.

    ``held`` names what there is at all: entries in ``installations``, ``maintenance``, ``marks``, ``alarms``, ``pins``; pumps that
    are ``alike``; ``curves`` of pump types; ``thresholds`` of any layer; the ``aircraft`` that was asked for. What is not in it
    need not be asked for.
    ``outside`` are the numbers of what holds for many pumps, by ``outside_numbers``.
    """

    pump: Pump
    held: frozenset[str]
    registry: Mapping[tuple[str, str], Mapping[str, Any]]
    outside: tuple[int, int, int]

    def has(self, what: str) -> bool:
        """Whether there is anything of a kind."""
        return what in self.held


def outside_numbers(operator: str) -> tuple[ColumnElement[int], ColumnElement[int], ColumnElement[int]]:
    """Highest numbers of threshold versions, of what an operator's registry says, and of measured curves; 0 without any."""
    own = RegistryVersion.operator == operator
    return (
        func.coalesce(select(func.max(ThresholdVersion.number)).scalar_subquery(), 0),
        func.coalesce(select(func.max(RegistryVersion.id)).where(own).scalar_subquery(), 0),
        func.coalesce(select(func.max(ReferenceCurve.id)).scalar_subquery(), 0),
    )


def dossier(session: Session, operator: str, serial: str, aircraft: str | None = None) -> Dossier | None:
    """The dossier of a pump with the registry values of an aircraft; None where there is no such pump."""
    other = aliased(Pump)
    alike = exists().where(other.operator == Pump.operator, other.look == Pump.look, other.id != Pump.id)
    of_aircraft = null() if aircraft is None else _registered(operator, "aircraft", aircraft)
    naming = [exists().where(table.pump_id == Pump.id) for table in _NAMING.values()]
    known = exists().where(Aircraft.operator == operator, Aircraft.name == aircraft)
    own, asked = _registered(operator, "pump", serial), or_(alike, Pump.look.is_(None))
    query = select(Pump, own, of_aircraft, asked, known, *outside_numbers(operator), *naming)
    row = session.execute(query.where(Pump.operator == operator, Pump.serial == serial)).first()
    if row is None:
        return None
    pump, said, there, is_alike, is_known, thresholds, registered, curves, *named = row
    held = {what for what, has in zip(_NAMING, named, strict=True) if has}
    more = {"alike": is_alike, "aircraft": is_known, "curves": curves, "thresholds": thresholds}
    held |= {what for what, has in more.items() if has}
    registry = {("pump", serial): said or {}}
    if aircraft is not None:
        registry["aircraft", aircraft] = there or {}
    return Dossier(pump, frozenset(held), registry, (thresholds, registered, curves))


def _registered(operator: str, kind: str, name: str) -> ColumnElement[Any]:
    query = select(RegistryVersion.values).where(
        RegistryVersion.operator == operator, RegistryVersion.kind == kind, RegistryVersion.name == name
    )
    return query.order_by(RegistryVersion.id.desc()).limit(1).scalar_subquery()
