"""A pump's history beside its records: installations, maintenance, findings."""

from typing import Annotated

from fastapi import APIRouter, Query, Response
from pydantic import BaseModel
from sqlalchemy.orm import Session

from service.access import audit
from service.access.security import Principal
from service.answers import history as answers
from service.answers.history import PlaceInTime
from service.answers.words import Page
from service.history.knowledge import entries
from service.reading import queries
from service.registry import findings as finding_entries
from service.registry import installations as installation_entries
from service.registry import maintenance as maintenance_entries
from service.registry.entries import entry, withdraw
from service.registry.locks import locked_pump
from service.storage.tables import Finding, MaintenanceEvent, Pump
from service.web.addresses import location
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf

router = APIRouter(prefix="/pumps/{serial}", tags=["history"], route_class=AnswerRoute)
Operator = Annotated[str | None, Query(description="Needed only where several operators have this serial number")]


@router.get("/installations", summary="Where a pump sat")
def installations(serial: str, context: ContextOf, asker: Asker, operator: Operator = None) -> Page[PlaceInTime]:
    """Entered installations and those inferred from the records, in event order."""
    with context.database.reading() as session:
        row = queries.pump(session, asker, serial, operator)
        return {"items": installation_entries.installations(session, row), "next": None}


@router.post("/installations", status_code=201, summary="Enter an installation")
def install(
    serial: str,
    body: installation_entries.NewInstallation,
    response: Response,
    context: ContextOf,
    asker: Asker,
    operator: Operator = None,
) -> PlaceInTime:
    """Say where a pump sat; it wins over the records, starts a baseline, and folds the pump anew."""
    asker.require("engineer")
    with context.database.writing() as session:
        pump = locked_pump(session, asker, serial, operator)
        row = installation_entries.create(session, pump, body, asker.owner, context.archive)
        _note(session, asker, pump, "installation.enter", row.id, body)
        response.headers["Location"] = location("pumps", serial, "installations", row.id)
        return installation_entries.document(row)


@router.patch("/installations/{entry_id}", summary="Correct an installation")
def correct_installation(
    serial: str,
    entry_id: str,
    body: installation_entries.InstallationChange,
    context: ContextOf,
    asker: Asker,
    operator: Operator = None,
) -> PlaceInTime:
    """Set what the body names and fold the pump anew; what was entered before stays readable at its time."""
    asker.require("engineer")
    with context.database.writing() as session:
        pump = locked_pump(session, asker, serial, operator)
        row = installation_entries.change(session, pump, entry_id, body, asker.owner, context.archive)
        _note(session, asker, pump, "installation.correct", entry_id, body)
        return installation_entries.document(row)


@router.delete("/installations/{entry_id}", status_code=204, summary="Withdraw an installation")
def withdraw_installation(
    serial: str, entry_id: str, context: ContextOf, asker: Asker, operator: Operator = None
) -> None:
    """Take an entry back; the records decide again, and the pump is folded anew."""
    asker.require("engineer")
    with context.database.writing() as session:
        pump = locked_pump(session, asker, serial, operator)
        installation_entries.remove(session, pump, entry_id, context.archive)
        _note(session, asker, pump, "installation.withdraw", entry_id)


@router.get("/maintenance", summary="What was done to a pump")
def maintenance(
    serial: str, context: ContextOf, asker: Asker, operator: Operator = None
) -> Page[answers.MaintenanceEvent]:
    """Maintenance events in event order."""
    with context.database.reading() as session:
        row = queries.pump(session, asker, serial, operator)
        found = sorted(entries(session, MaintenanceEvent, row.id), key=lambda e: (e.at, e.row_id))
        return {"items": [maintenance_entries.document(e) for e in found], "next": None}


@router.post("/maintenance", status_code=201, summary="Enter a maintenance event")
def maintain(
    serial: str,
    body: maintenance_entries.NewMaintenance,
    response: Response,
    context: ContextOf,
    asker: Asker,
    operator: Operator = None,
) -> answers.MaintenanceEvent:
    """Say what was done; it resets what it touches, and the pump is folded anew."""
    asker.require("engineer")
    with context.database.writing() as session:
        pump = locked_pump(session, asker, serial, operator)
        row = maintenance_entries.create(session, pump, body, asker.owner, context.archive)
        _note(session, asker, pump, "maintenance.enter", row.id, body)
        response.headers["Location"] = location("pumps", serial, "maintenance", row.id)
        return maintenance_entries.document(row)


@router.patch("/maintenance/{entry_id}", summary="Correct a maintenance event")
def correct_maintenance(
    serial: str,
    entry_id: str,
    body: maintenance_entries.MaintenanceChange,
    context: ContextOf,
    asker: Asker,
    operator: Operator = None,
) -> answers.MaintenanceEvent:
    """Set what the body names and fold the pump anew."""
    asker.require("engineer")
    with context.database.writing() as session:
        pump = locked_pump(session, asker, serial, operator)
        row = maintenance_entries.change(session, pump, entry_id, body, asker.owner, context.archive)
        _note(session, asker, pump, "maintenance.correct", entry_id, body)
        return maintenance_entries.document(row)


@router.delete("/maintenance/{entry_id}", status_code=204, summary="Withdraw a maintenance event")
def withdraw_maintenance(
    serial: str, entry_id: str, context: ContextOf, asker: Asker, operator: Operator = None
) -> None:
    """Take an event back and fold the pump anew."""
    asker.require("engineer")
    with context.database.writing() as session:
        pump = locked_pump(session, asker, serial, operator)
        maintenance_entries.remove(session, pump, entry_id, context.archive)
        _note(session, asker, pump, "maintenance.withdraw", entry_id)


@router.get("/findings", summary="What the workshop found")
def findings(serial: str, context: ContextOf, asker: Asker, operator: Operator = None) -> Page[answers.Finding]:
    """Findings about a pump in event order."""
    with context.database.reading() as session:
        row = queries.pump(session, asker, serial, operator)
        found = sorted(entries(session, Finding, row.id), key=lambda e: (e.at, e.row_id))
        return {"items": [finding_entries.document(e) for e in found], "next": None}


@router.post("/findings", status_code=201, summary="Enter a finding")
def find(
    serial: str,
    body: finding_entries.NewFinding,
    response: Response,
    context: ContextOf,
    asker: Asker,
    operator: Operator = None,
) -> answers.Finding:
    """Say what was found at teardown or inspection; it counts in the fleet's rates."""
    asker.require("analyst")
    with context.database.writing() as session:
        pump = locked_pump(session, asker, serial, operator)
        row = finding_entries.create(session, pump, body, asker.owner)
        _note(session, asker, pump, "finding.enter", row.id, body)
        response.headers["Location"] = location("pumps", serial, "findings", row.id)
        return finding_entries.document(row)


@router.patch("/findings/{entry_id}", summary="Correct a finding")
def correct_finding(
    serial: str,
    entry_id: str,
    body: finding_entries.FindingChange,
    context: ContextOf,
    asker: Asker,
    operator: Operator = None,
) -> answers.Finding:
    """Set what the body names."""
    asker.require("analyst")
    with context.database.writing() as session:
        pump = locked_pump(session, asker, serial, operator)
        row = finding_entries.change(session, pump, entry_id, body, asker.owner)
        _note(session, asker, pump, "finding.correct", entry_id, body)
        return finding_entries.document(row)


@router.delete("/findings/{entry_id}", status_code=204, summary="Withdraw a finding")
def withdraw_finding(serial: str, entry_id: str, context: ContextOf, asker: Asker, operator: Operator = None) -> None:
    """Take a finding back."""
    asker.require("analyst")
    with context.database.writing() as session:
        pump = locked_pump(session, asker, serial, operator)
        withdraw(session, entry(session, Finding, pump, entry_id))
        _note(session, asker, pump, "finding.withdraw", entry_id)


def _note(
    session: Session, asker: Principal, pump: Pump, action: str, entry_id: str, body: BaseModel | None = None
) -> None:
    kind = action.partition(".")[0]
    details = {} if body is None else body.model_dump(mode="json", by_alias=True, exclude_unset=True)
    audit.note(session, asker, action, f"pump/{pump.serial}/{kind}/{entry_id}", pump.operator, details)
