"""Maintenance: what was done to a pump or around it, and resets what it touches."""

from typing import Literal

from pydantic import ConfigDict
from sqlalchemy.orm import Session

from service.answers import history as answers
from service.answers.words import instant
from service.bodies import Body
from service.history.archive import Archive
from service.monitoring.refold import Cause, refold
from service.registry.entries import add, correct, entry, withdraw
from service.registry.fields import Instant, Note
from service.storage.tables import MaintenanceEvent, Pump

CHANGED = "maintenance_changed"
Action = Literal["fluid_changed", "filter_changed", "setting_adjusted", "sensor_replaced"]


class NewMaintenance(Body):
    """What was done, and when."""

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"at": "2026-05-02T00:00:00Z", "action": "filter_changed"}]}
    )
    at: Instant
    action: Action
    note: Note = ""


class MaintenanceChange(Body):
    """Fields of a maintenance event to set."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"note": "both filters"}]})
    at: Instant | None = None
    action: Action | None = None
    note: Note | None = None


def create(session: Session, pump: Pump, body: NewMaintenance, author: str, archive: Archive) -> MaintenanceEvent:
    """Enter a maintenance event of a locked pump and fold it anew."""
    row = add(session, MaintenanceEvent, pump, author, body.model_dump())
    refold(session, pump, archive, Cause(CHANGED, row.id))
    return row


def change(
    session: Session, pump: Pump, entry_id: str, body: MaintenanceChange, author: str, archive: Archive
) -> MaintenanceEvent:
    """Correct a maintenance event of a locked pump and fold it anew."""
    row = entry(session, MaintenanceEvent, pump, entry_id)
    values = {"at": row.at, "action": row.action, "note": row.note} | body.model_dump(exclude_none=True)
    corrected = correct(session, row, pump, author, values)
    refold(session, pump, archive, Cause(CHANGED, entry_id))
    return corrected


def remove(session: Session, pump: Pump, entry_id: str, archive: Archive) -> None:
    """Withdraw a maintenance event of a locked pump and fold it anew."""
    withdraw(session, entry(session, MaintenanceEvent, pump, entry_id))
    refold(session, pump, archive, Cause(CHANGED, entry_id))


def document(row: MaintenanceEvent) -> answers.MaintenanceEvent:
    """A maintenance event in the shape of the API."""
    return {
        "id": row.id,
        "at": instant(row.at),
        "action": row.action,
        "note": row.note,
        "recorded_at": instant(row.recorded_at),
        "author": row.author,
    }
