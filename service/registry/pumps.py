"""Pumps: registered, confirmed, given another type, with every version kept."""

from datetime import UTC, datetime

from pydantic import ConfigDict
from sqlalchemy import select
from sqlalchemy.orm import Session

from service.answers.documents import JsonObject
from service.bodies import Body
from service.errors import Conflict
from service.history.archive import Archive
from service.history.knowledge import registry_values
from service.ingest.decode import DEFAULT_PUMP_TYPE
from service.ingest.names import look_of
from service.monitoring.behind import fold_behind
from service.monitoring.refold import Cause
from service.pump_types.parameter_sets import asked_type
from service.registry.fields import Name
from service.storage.tables import Pump, RegistryVersion


class NewPump(Body):
    """A pump to register; an operator's serial number is unique."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"serial": "P-7", "pump_type": "h225"}]})
    serial: Name
    pump_type: Name = DEFAULT_PUMP_TYPE
    operator: Name | None = None


class PumpChange(Body):
    """Fields of a pump to set; any change confirms it unless it says otherwise."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"pump_type": "h225", "confirmed": True}]})
    pump_type: Name | None = None
    confirmed: bool = True


def create(session: Session, operator: str, body: NewPump, author: str) -> Pump:
    """Register a pump.

    Raises
    ------
    Conflict
        when the operator has it already.
    Invalid
        when the pump type does not exist.
    """
    asked_type(session, operator, body.pump_type, "body.pump_type")
    if session.scalar(select(Pump.id).where(Pump.operator == operator, Pump.serial == body.serial)):
        raise Conflict(f"pump {body.serial} is registered already: confirm or change it with PATCH")
    pump = Pump(
        operator=operator,
        serial=body.serial,
        pump_type=body.pump_type,
        confirmed=True,
        created_at=datetime.now(UTC),
        look=look_of(body.serial),
    )
    session.add(pump)
    _append(session, pump, {"pump_type": body.pump_type, "confirmed": True}, author)
    return pump


def change(session: Session, pump: Pump, body: PumpChange, author: str, archive: Archive) -> None:
    """Confirm a locked pump or give it another type, which folds it anew.

    Raises
    ------
    Invalid
        when the pump type does not exist.
    """
    if body.pump_type is not None:
        asked_type(session, pump.operator, body.pump_type, "body.pump_type")
    values: JsonObject = {"pump_type": body.pump_type or pump.pump_type, "confirmed": body.confirmed}
    if values == registry_values(session, pump.operator, "pump", pump.serial):
        return
    _append(session, pump, values, author)
    pump.confirmed = body.confirmed
    fold_behind(session, [pump], archive, Cause("pump_changed", pump.serial))


def _append(session: Session, pump: Pump, values: JsonObject, author: str) -> None:
    session.add(
        RegistryVersion(
            operator=pump.operator,
            kind="pump",
            name=pump.serial,
            values=values,
            recorded_at=datetime.now(UTC),
            author=author,
        )
    )
    session.flush()
