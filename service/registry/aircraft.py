"""Aircraft: fluid, circuit and sensors, with every version kept."""

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any, Literal, cast

from pydantic import ConfigDict, Field, field_serializer
from sqlalchemy import Select, or_, select, tuple_
from sqlalchemy.orm import Session

from service.access.security import Principal
from service.answers import registry as answers
from service.answers.documents import JsonObject
from service.answers.words import instant
from service.bodies import Body
from service.errors import Conflict, Fault, Invalid
from service.history.archive import Archive
from service.history.knowledge import registry_values
from service.history.setting import CIRCUIT_DOCUMENT, DEFAULT_CIRCUIT
from service.ingest.names import look_of
from service.monitoring.behind import fold_behind
from service.monitoring.refold import Cause
from service.pump_types.circuits import asked_circuit
from service.registry.fields import Instant, Name
from service.registry.locks import lock_aircraft, locked_pumps
from service.storage.tables import Aircraft, Installation, Pump, Record, RegistryVersion
from twin.pumps.circuit_sets import CIRCUIT_SETS, circuit_document


class SensorEntry(Body):
    """A pressure sensor as fitted; ``since`` is when, in event time."""

    channel: Literal["discharge_pressure_bar", "case_pressure_bar", "reservoir_pressure_bar"]
    identity: Name
    full_scale_bar: float = Field(gt=0.0, le=2000.0)
    accuracy_percent_full_scale: float | None = Field(default=None, gt=0.0, le=10.0)
    since: Instant

    @field_serializer("since")
    def _utc(self, since: datetime) -> str:
        return since.isoformat()


class AircraftChange(Body):
    """Fields of an aircraft to set; those left out stay as they are. ``sensors`` replaces the whole list."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "fluid": "MIL-PRF-83282",
                    "sensors": [
                        {
                            "channel": "case_pressure_bar",
                            "identity": "SN 4711",
                            "full_scale_bar": 5.0,
                            "since": "2026-05-02T00:00:00Z",
                        }
                    ],
                }
            ]
        }
    )
    aircraft_type: Name | None = None
    fluid: Name | None = None
    circuit: Name = DEFAULT_CIRCUIT
    sensors: list[SensorEntry] = Field(default_factory=list, max_length=200)
    confirmed: bool = True


class NewAircraft(AircraftChange):
    """A new aircraft; ``aircraft`` is its tail or serial number."""

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"aircraft": "F-HCAA", "aircraft_type": "H225", "circuit": "shared_return"}]}
    )
    aircraft: Name
    operator: Name | None = None


_DEFAULTS: JsonObject = {
    "aircraft_type": None,
    "fluid": None,
    "circuit": DEFAULT_CIRCUIT,
    "sensors": [],
    "confirmed": False,
}


def listed(principal: Principal, after: Sequence[Any] | None = None) -> Select[Aircraft]:
    """Aircraft by operator and name."""
    query = select(Aircraft)
    if principal.operator is not None:
        query = query.where(Aircraft.operator == principal.operator)
    if after is not None:
        query = query.where(tuple_(Aircraft.operator, Aircraft.name) > tuple(after))
    return query.order_by(Aircraft.operator, Aircraft.name)


def document(session: Session, row: Aircraft) -> answers.Aircraft:
    """An aircraft in the shape of the API."""
    values = _DEFAULTS | registry_values(session, row.operator, "aircraft", row.name)
    values.pop(CIRCUIT_DOCUMENT, None)
    named = {"aircraft": row.name, "operator": row.operator, **values, "created_at": instant(row.created_at)}
    return cast("answers.Aircraft", named)


def look_alikes(session: Session, row: Aircraft) -> list[answers.LookAlike]:
    """Other aircraft of the operator whose names are easily taken for this one's."""
    query = select(Aircraft).where(Aircraft.operator == row.operator, Aircraft.id != row.id).order_by(Aircraft.name)
    look = look_of(row.name)
    alike = [other for other in session.scalars(query) if look_of(other.name) == look]
    return [{"name": other.name, "since": instant(other.created_at)} for other in alike]


def create(session: Session, operator: str, body: NewAircraft, author: str) -> Aircraft:
    """Register an aircraft.

    Raises
    ------
    Conflict
        when the operator has it already.
    """
    check_sensors(body.sensors)
    if session.scalar(select(Aircraft.id).where(Aircraft.operator == operator, Aircraft.name == body.aircraft)):
        raise Conflict(f"aircraft {body.aircraft} is registered already: change it with PATCH")
    around = _around(session, operator, body.circuit)
    row = Aircraft(operator=operator, name=body.aircraft, created_at=datetime.now(UTC))
    session.add(row)
    session.flush()
    _append(session, row, _DEFAULTS | body.model_dump(exclude={"aircraft", "operator"}) | around, author)
    return row


def change(session: Session, row: Aircraft, body: AircraftChange, author: str, archive: Archive) -> None:
    """Change an aircraft; every pump that was ever on it is folded anew behind the commit."""
    check_sensors(body.sensors)
    locked_pumps(session, _pumps_on(session, row))
    lock_aircraft(session, row)
    held = _DEFAULTS | registry_values(session, row.operator, "aircraft", row.name)
    values = held | {"confirmed": True} | body.model_dump(include=body.model_fields_set)
    if values == held:
        return
    if "circuit" in body.model_fields_set:
        values.pop(CIRCUIT_DOCUMENT, None)
        values |= _around(session, row.operator, body.circuit)
    _append(session, row, values, author)
    if any(values[name] != held[name] for name in ("fluid", "circuit", "sensors")):
        pumps = locked_pumps(session, _pumps_on(session, row))
        fold_behind(session, pumps, archive, Cause("aircraft_changed", row.name))


def _around(session: Session, operator: str, circuit: str) -> JsonObject:
    """A stored circuit's document beside its name: it is never changed, and a fold needs no look into another table.

    Raises
    ------
    Invalid
        when the operator has no such circuit.
    """
    found = asked_circuit(session, operator, circuit, "body.circuit")
    return {} if circuit in CIRCUIT_SETS else {CIRCUIT_DOCUMENT: circuit_document(found)}


def check_sensors(sensors: Sequence[SensorEntry]) -> None:
    """Refuse two sensors of one channel from the same instant on."""
    seen: set[tuple[str, datetime]] = set()
    faults = []
    for i, sensor in enumerate(sensors):
        if (sensor.channel, sensor.since) in seen:
            faults.append(Fault(f"body.sensors.{i}", f"is the second one of {sensor.channel} since {sensor.since}"))
        seen.add((sensor.channel, sensor.since))
    if faults:
        raise Invalid("a channel has one sensor at a time; nothing was changed", faults)


def _append(session: Session, row: Aircraft, values: JsonObject, author: str) -> None:
    session.add(
        RegistryVersion(
            operator=row.operator,
            kind="aircraft",
            name=row.name,
            values=values,
            recorded_at=datetime.now(UTC),
            author=author,
        )
    )
    session.flush()


def _pumps_on(session: Session, row: Aircraft) -> list[int]:
    """Pumps that were ever on an aircraft, by their records or by an entry."""
    recorded = select(Record.pump_id).where(Record.aircraft == row.name, Record.operator == row.operator)
    entered = select(Installation.pump_id).where(Installation.aircraft == row.name)
    query = select(Pump.id).where(
        Pump.operator == row.operator,
        or_(Pump.id.in_(recorded.where(Record.pump_id.is_not(None))), Pump.id.in_(entered)),
    )
    return list(session.scalars(query))
