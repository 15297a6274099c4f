"""Flights of a pump: one record each, and dates that do not run against its flight hours."""

from sqlalchemy import and_, or_, select
from sqlalchemy.orm import Session

from service.errors import Conflict, Fault, Invalid, NotFound
from service.history.contradictions import OVERHAUL, Said, contradicted
from service.history.knowledge import entries
from service.history.neighbours import SAID, said_by
from service.ingest.decode import DecodedRecord
from service.storage.tables import ANALYSED, MaintenanceEvent, Pump, Record


def check_flight(
    session: Session,
    operator: str,
    pump: Pump | None,
    decoded: DecodedRecord,
    identity: str | None,
    supersedes: str | None,
    own: str | None = None,
) -> Record | None:
    """Refuse a second record for the same flight, pump and segment, unless it supersedes the first, and a lost clock.

    Parameters
    ----------
    pump
        The record's; None for one that nobody knows.
    identity
        Identity of the upload: the stored record that has it is given back, and nothing is checked; None without one.
    supersedes
        Id of the record that it replaces.
    own
        Id of the record itself, where it is stored already.

    Raises
    ------
    Conflict
        naming the first.
    Invalid
        when date and flight hours contradict a stored record.
    NotFound
        when there is no record to supersede.
    """
    metadata = decoded.metadata
    same_flight = and_(
        Record.pump_id == (pump.id if pump else None),
        Record.flight_id == metadata.flight_id,
        Record.segment == metadata.segment,
        Record.status == ANALYSED,
    )
    columns = (Record.id, Record.identity_hash, Record.status)
    found = session.execute(
        select(*columns).where(same_flight if identity is None else or_(Record.identity_hash == identity, same_flight))
    ).all()
    for row in found:
        if identity is not None and row.identity_hash == identity and row.id != own:
            return session.get(Record, row.id)
    held = next((row for row in found if row.id != own), None)
    if supersedes is not None:
        older = session.get(Record, supersedes)
        if older is None or older.operator != operator:
            raise NotFound(f"there is no record {supersedes} to supersede")
        if held is None or held.id != supersedes:
            raise Conflict(f"record {supersedes} is not the one that counts for this flight, pump and segment")
    elif held is not None:
        raise Conflict(
            f"record {held.id} already stands for flight {metadata.flight_id} of pump {metadata.pump_serial}: "
            f"repeat with ?supersedes={held.id} to replace it",
            extra={"record_id": held.id},
        )
    if pump is not None:
        _check_hours(session, pump, decoded, supersedes)
    return None


def _check_hours(session: Session, pump: Pump, decoded: DecodedRecord, supersedes: str | None) -> None:
    """Refuse a record whose date puts it before one with clearly fewer flight hours: its recorder's clock was lost."""
    said = decoded.metadata
    if said.flight_hours is None:
        return
    stated = select(*SAID).where(
        Record.pump_id == pump.id,
        Record.status == ANALYSED,
        Record.flight_hours.is_not(None),
        Record.id != (supersedes or ""),
    )
    following = stated.where(Record.started_at > said.started_at).order_by(Record.started_at, Record.id).limit(1)
    row = session.execute(following).first()
    if row is None:
        return
    after = said_by(pump.serial, row)
    preceding = stated.where(Record.started_at <= said.started_at)
    row = session.execute(preceding.order_by(Record.started_at.desc(), Record.id.desc()).limit(1)).first()
    before = None if row is None else said_by(pump.serial, row)
    place = said.aircraft, said.position
    new = Said("", pump.serial, said.flight_id, said.segment, *place, said.started_at, None, said.flight_hours, None)
    overhauls = [e.at for e in entries(session, MaintenanceEvent, pump.id) if e.action == OVERHAUL]
    if contradicted(new, before, after, overhauls):
        problem = (
            f"{said.flight_hours:g} h on {said.started_at:%Y-%m-%dT%H:%MZ} run against the dates: record "
            f"{after.record_id} (flight {after.flight_id}) counts {after.hours:g} h on {after.at:%Y-%m-%dT%H:%MZ}, later. "
            "Correct started_at, or that record; if hours were counted anew, enter pump_overhauled or leave them out"
        )
        detail = "date and flight hours contradict a stored record; nothing was stored"
        raise Invalid(detail, [Fault("flight_hours", problem)])
