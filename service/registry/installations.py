"""Installations: entered as intervals without overlap, inferred from the records where nobody entered any."""

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime

from pydantic import ConfigDict, Field
from sqlalchemy import select
from sqlalchemy.orm import Session

from service.answers.documents import RowValues
from service.answers.history import PlaceInTime
from service.answers.words import instant
from service.bodies import Body
from service.errors import Conflict, Fault, Invalid
from service.history.archive import Archive
from service.history.arrival import known_aircraft
from service.history.knowledge import entries
from service.monitoring.behind import fold_behind
from service.monitoring.refold import Cause
from service.reading import queries
from service.registry.entries import add, correct, entry, withdraw
from service.registry.fields import Instant, Name
from service.storage.tables import Installation, Pump

CHANGED = "installation_changed"


class NewInstallation(Body):
    """Where a pump sits: from ``from`` on, up to ``to`` (open-ended without)."""

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"aircraft": "F-HCAA", "position": "LH", "from": "2026-05-02T00:00:00Z"}]}
    )
    aircraft: Name
    position: Name
    start: Instant = Field(alias="from")
    end: Instant | None = Field(default=None, alias="to")


class InstallationChange(Body):
    """Fields of an installation to set; ``to`` null opens it again."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"to": "2026-06-02T00:00:00Z"}]})
    aircraft: Name | None = None
    position: Name | None = None
    start: Instant | None = Field(default=None, alias="from")
    end: Instant | None = Field(default=None, alias="to")


def create(session: Session, pump: Pump, body: NewInstallation, author: str, archive: Archive) -> Installation:
    """Enter an installation of a locked pump and fold it anew."""
    row = entered(session, pump, body, author)
    fold_behind(session, [pump], archive, Cause(CHANGED, row.id))
    return row


def entered(session: Session, pump: Pump, body: NewInstallation, author: str) -> Installation:
    """Enter an installation of a locked pump without folding it.

    Raises
    ------
    Conflict
        when it overlaps another one of the pump or at the position; the answer names it.
    Invalid
        when it ends before it starts.
    """
    return add(session, Installation, pump, author, _checked(session, pump, body, None))


def change(
    session: Session, pump: Pump, entry_id: str, body: InstallationChange, author: str, archive: Archive
) -> Installation:
    """Correct an installation of a locked pump and fold it anew; raises like ``entered``."""
    row = entry(session, Installation, pump, entry_id)
    wanted = NewInstallation(
        aircraft=body.aircraft or row.aircraft,
        position=body.position or row.position,
        **{
            "from": body.start or row.installed_at,
            "to": body.end if "end" in body.model_fields_set else row.removed_at,
        },
    )
    corrected = correct(session, row, pump, author, _checked(session, pump, wanted, row))
    fold_behind(session, [pump], archive, Cause(CHANGED, entry_id))
    return corrected


def remove(session: Session, pump: Pump, entry_id: str, archive: Archive) -> None:
    """Withdraw an installation of a locked pump and fold it anew."""
    withdraw(session, entry(session, Installation, pump, entry_id))
    fold_behind(session, [pump], archive, Cause(CHANGED, entry_id))


def document(row: Installation) -> PlaceInTime:
    """An entered installation in the shape of the API."""
    return {
        "id": row.id,
        "aircraft": row.aircraft,
        "position": row.position,
        "from": instant(row.installed_at),
        "to": instant(row.removed_at),
        "source": "entry",
        "recorded_at": instant(row.recorded_at),
        "author": row.author,
    }


def installations(session: Session, pump: Pump) -> list[PlaceInTime]:
    """Entered installations and, outside them, those that the records show; in event order."""
    return [stay.document() for stay in _stays(session, pump)]


def current_installation(session: Session, pump: Pump, now: datetime) -> PlaceInTime | None:
    """Where a pump sits now: as entered, else where its records last came from; None once it was removed."""
    lasting = [s for s in _stays(session, pump) if s.start <= now and (s.end is None or s.end > now)]
    return lasting[-1].document() if lasting else None


@dataclass(slots=True)
class _Stay:
    """A stretch of time at one place; ``entry`` is None where records show it."""

    aircraft: str
    position: str
    start: datetime
    end: datetime | None
    entry: Installation | None = None

    def document(self) -> PlaceInTime:
        """In the shape of the API."""
        if self.entry is not None:
            return document(self.entry)
        return {
            "id": None,
            "aircraft": self.aircraft,
            "position": self.position,
            "from": instant(self.start),
            "to": instant(self.end),
            "source": "records",
        }


def _stays(session: Session, pump: Pump) -> list[_Stay]:
    entered_ones = entries(session, Installation, pump.id)
    found = [_Stay(i.aircraft, i.position, i.installed_at, i.removed_at, i) for i in entered_ones]
    run: _Stay | None = None
    for assessment in session.scalars(queries.assessments(pump.id)):
        place, at = (assessment.aircraft, assessment.position), assessment.at
        covered = any(i.installed_at <= at and (i.removed_at is None or at < i.removed_at) for i in entered_ones)
        if run is not None and (covered or place != (run.aircraft, run.position)):
            run.end = at
            run = None
        if covered:
            continue
        if run is None:
            run = _Stay(*place, at, None)
            found.append(run)
    _close([s for s in found if s.entry is None], [row.installed_at for row in entered_ones])
    return sorted(found, key=lambda s: s.start)


def _close(inferred: Iterable[_Stay], starts: Iterable[datetime]) -> None:
    """An inferred installation ends at the latest where an entered one starts."""
    for stay in inferred:
        later = [s for s in starts if s > stay.start]
        if later and (stay.end is None or min(later) < stay.end):
            stay.end = min(later)


def _checked(session: Session, pump: Pump, body: NewInstallation, old: Installation | None) -> RowValues:
    if body.end is not None and body.end <= body.start:
        raise Invalid(
            "an installation ends after it starts; nothing was changed", [Fault("body.to", "is not after from")]
        )
    known_aircraft(session, pump.operator, body.aircraft, for_change=True)
    clashes = (
        select(Installation, Pump.serial)
        .join(Pump, Installation.pump_id == Pump.id)
        .where(
            Pump.operator == pump.operator,
            Installation.withdrawn_at.is_(None),
            (Installation.pump_id == pump.id)
            | ((Installation.aircraft == body.aircraft) & (Installation.position == body.position)),
            Installation.removed_at.is_(None) | (Installation.removed_at > body.start),
        )
        .order_by(Installation.installed_at)
    )
    if body.end is not None:
        clashes = clashes.where(Installation.installed_at < body.end)
    if old is not None:
        clashes = clashes.where(Installation.row_id != old.row_id)
    faults, others = [], []
    for other, serial in session.execute(clashes):
        until = f"to {other.removed_at.isoformat()}" if other.removed_at else "and still there"
        what = f"pump {serial} on {other.aircraft} {other.position} from {other.installed_at.isoformat()} {until}"
        faults.append(Fault("body.from", f"overlaps installation {other.id}: {what}"))
        others.append(other.id)
    if faults:
        raise Conflict(
            "a pump is in one place at a time, and a place holds one pump: end or correct the other one first",
            faults,
            extra={"installations": others},
        )
    return {
        "aircraft": body.aircraft,
        "position": body.position,
        "installed_at": body.start,
        "removed_at": body.end,
    }
