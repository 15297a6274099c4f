"""Maintenance: what was done to a pump or around it; it frees what it names and nothing else."""

from typing import Annotated, Literal

from pydantic import AfterValidator, ConfigDict, ValidationInfo, field_validator
from sqlalchemy.orm import Session

from service.answers import history as answers
from service.answers.documents import RowValues
from service.answers.words import instant
from service.bodies import Body, known_fluid
from service.errors import Fault, Invalid
from service.history.archive import Archive
from service.monitoring.behind import fold_behind
from service.monitoring.refold import Cause
from service.registry.entries import add, correct, entry, withdraw
from service.registry.fields import Instant, Name, Note
from service.storage.tables import MaintenanceEvent, Pump

CHANGED = "maintenance_changed"
Action = Literal[
    "filter_changed",
    "drain_cleaned",
    "fluid_changed",
    "setting_adjusted",
    "sensor_replaced",
    "pump_overhauled",
]
"""What can be done, in the words of ``detectors.words.observation.ACTIONS``."""
Channel = Literal[
    "discharge_pressure_bar",
    "case_pressure_bar",
    "reservoir_pressure_bar",
    "fluid_temperature_degc",
    "shaft_speed_rpm",
]
"""Channels whose sensor can be replaced."""
_BELONGS = {"fluid": "fluid_changed", "channel": "sensor_replaced"}
"""Details of an entry, and the only action that each says something about."""


Fluid = Annotated[Name, AfterValidator(known_fluid)]


class NewMaintenance(Body):
    """What was done, and when; ``fluid`` names the product of ``fluid_changed``, ``channel`` that of ``sensor_replaced``."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {"at": "2026-05-02T00:00:00Z", "action": "filter_changed"},
                {"at": "2026-05-02T00:00:00Z", "action": "sensor_replaced", "channel": "case_pressure_bar"},
            ]
        }
    )
    at: Instant
    action: Action
    fluid: Fluid | None = None
    channel: Channel | None = None
    note: Note = ""

    @field_validator(*_BELONGS)
    @classmethod
    def _belongs(cls, value: str | None, info: ValidationInfo) -> str | None:
        # an action that is none has been named as a fault of its own
        action, name = info.data.get("action"), str(info.field_name)
        if value is not None and action is not None and action != _BELONGS[name]:
            raise ValueError(_stray(name, action))
        return value


class MaintenanceChange(Body):
    """Fields of a maintenance event to set; another action drops the detail that belonged to the one before."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"note": "both filters"}]})
    at: Instant | None = None
    action: Action | None = None
    fluid: Fluid | None = None
    channel: Channel | None = None
    note: Note | None = None


def create(session: Session, pump: Pump, body: NewMaintenance, author: str, archive: Archive) -> MaintenanceEvent:
    """Enter a maintenance event of a locked pump and fold it anew."""
    row = add(session, MaintenanceEvent, pump, author, body.model_dump())
    fold_behind(session, [pump], archive, Cause(CHANGED, row.id))
    return row


def change(
    session: Session, pump: Pump, entry_id: str, body: MaintenanceChange, author: str, archive: Archive
) -> MaintenanceEvent:
    """Correct a maintenance event of a locked pump and fold it anew.

    Raises
    ------
    Invalid
        naming every detail that does not belong to the action.
    """
    row = entry(session, MaintenanceEvent, pump, entry_id)
    held: RowValues = {"at": row.at, "action": row.action, "note": row.note}
    values = held | body.model_dump(include=set(held), exclude_none=True)
    faults = []
    for name, action in _BELONGS.items():
        said = name in body.model_fields_set
        values[name] = getattr(body if said else row, name)
        if values[name] is not None and values["action"] != action:
            if said:
                faults.append(Fault(f"body.{name}", _stray(name, values["action"])))
            values[name] = None
    if faults:
        raise Invalid(f"{len(faults)} detail(s) belong to another action; nothing was changed", faults)
    corrected = correct(session, row, pump, author, values)
    fold_behind(session, [pump], archive, Cause(CHANGED, entry_id))
    return corrected


def remove(session: Session, pump: Pump, entry_id: str, archive: Archive) -> None:
    """Withdraw a maintenance event of a locked pump and fold it anew."""
    withdraw(session, entry(session, MaintenanceEvent, pump, entry_id))
    fold_behind(session, [pump], archive, Cause(CHANGED, entry_id))


def document(row: MaintenanceEvent) -> answers.MaintenanceEvent:
    """A maintenance event in the shape of the API."""
    return {
        "id": row.id,
        "at": instant(row.at),
        "action": row.action,
        "fluid": row.fluid,
        "channel": row.channel,
        "note": row.note,
        "recorded_at": instant(row.recorded_at),
        "author": row.author,
    }


def _stray(name: str, action: str) -> str:
    return f"says nothing with {action}: it belongs to {_BELONGS[name]}"
