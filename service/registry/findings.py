"""Findings of the workshop, and what they say about the verdicts: false alarms and missed faults."""

from typing import Literal

from pydantic import ConfigDict, Field
from sqlalchemy.orm import Session

from service.answers import history as answers
from service.answers.words import instant
from service.bodies import Body
from service.registry.entries import add, correct, entry
from service.registry.fields import Instant, Note
from service.storage.tables import Finding, Pump

Found = Literal[
    "pump_degradation",
    "compensator_fault",
    "system_leakage",
    "drain_restriction",
    "sensor_fault",
    "no_fault_found",
]


class NewFinding(Body):
    """What the workshop found; ``at`` is the instant in the pump's life that it speaks of: removal or inspection."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {
                    "at": "2026-06-02T00:00:00Z",
                    "found": "pump_degradation",
                    "measured_case_flow_lpm": 1.7,
                    "removed": True,
                }
            ]
        }
    )
    at: Instant
    found: Found
    measured_case_flow_lpm: float | None = Field(default=None, ge=0.0, le=100.0)
    removed: bool = False
    note: Note = ""


class FindingChange(Body):
    """Fields of a finding to set."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"measured_case_flow_lpm": 1.6}]})
    at: Instant | None = None
    found: Found | None = None
    measured_case_flow_lpm: float | None = Field(default=None, ge=0.0, le=100.0)
    removed: bool | None = None
    note: Note | None = None


def create(session: Session, pump: Pump, body: NewFinding, author: str) -> Finding:
    """Enter a finding about a pump."""
    return add(session, Finding, pump, author, body.model_dump())


def change(session: Session, pump: Pump, entry_id: str, body: FindingChange, author: str) -> Finding:
    """Correct a finding; a null flow takes the measurement back."""
    row = entry(session, Finding, pump, entry_id)
    held = {name: getattr(row, name) for name in ("at", "found", "measured_case_flow_lpm", "removed", "note")}
    given = body.model_dump(include=body.model_fields_set)
    values = {n: v for n, v in given.items() if v is not None or n == "measured_case_flow_lpm"}
    return correct(session, row, pump, author, held | values)


def document(row: Finding) -> answers.Finding:
    """A finding in the shape of the API."""
    return {
        "id": row.id,
        "at": instant(row.at),
        "found": row.found,
        "measured_case_flow_lpm": row.measured_case_flow_lpm,
        "removed": row.removed,
        "note": row.note,
        "recorded_at": instant(row.recorded_at),
        "author": row.author,
    }
