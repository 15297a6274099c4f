"""What happened to a pump besides its records, and how its past verdicts changed."""

from datetime import datetime

from sqlalchemy import ForeignKey, Index
from sqlalchemy.orm import Mapped, mapped_column

from service.storage.tables.base import Base

NO_FAULT_FOUND = "no_fault_found"
"""The word for a pump in which the workshop found nothing wrong."""


class Entry:
    """Columns of everything that people enter about a pump.

    A row counts from ``recorded_at`` until ``withdrawn_at``; a correction ends a row and adds another one of the same
    ``id``, so that what was known at any instant can be read back.
    """

    row_id: Mapped[int] = mapped_column(primary_key=True)
    id: Mapped[str] = mapped_column(index=True)
    pump_id: Mapped[int] = mapped_column(ForeignKey("pumps.id"), index=True)
    recorded_at: Mapped[datetime]
    withdrawn_at: Mapped[datetime | None]
    author: Mapped[str]


class Installation(Entry, Base):
    """Where a pump sat from ``installed_at`` until ``removed_at``; open-ended while that is None."""

    __tablename__ = "installations"
    __table_args__ = (Index("ix_installations_aircraft_position", "aircraft", "position"),)

    aircraft: Mapped[str]
    position: Mapped[str]
    installed_at: Mapped[datetime]
    removed_at: Mapped[datetime | None]


class MaintenanceEvent(Entry, Base):
    """Something done that frees what it names; ``action`` in the words of ``detectors.words.observation``.

    ``fluid`` is the product after ``fluid_changed``, ``channel`` the sensor's after ``sensor_replaced``; None where nobody
    said, and on rows older than they.
    """

    __tablename__ = "maintenance_events"

    at: Mapped[datetime]
    action: Mapped[str]
    fluid: Mapped[str | None]
    channel: Mapped[str | None]
    note: Mapped[str]


class Finding(Entry, Base):
    """What the workshop found; ``found`` is a fault state or ``no_fault_found``."""

    __tablename__ = "findings"

    at: Mapped[datetime]
    found: Mapped[str]
    measured_case_flow_lpm: Mapped[float | None]
    removed: Mapped[bool]
    note: Mapped[str]


class RecordMark(Entry, Base):
    """A stretch of a record [s from its start] that an engineer has judged: ``mark`` is ``good`` or ``bad``."""

    __tablename__ = "record_marks"

    record_id: Mapped[str] = mapped_column(ForeignKey("records.id"), index=True)
    start_s: Mapped[float]
    end_s: Mapped[float]
    mark: Mapped[str]
    reason: Mapped[str]


class VerdictRevision(Base):
    """A past verdict that changed when the pump was folded anew, and why.

    ``new_state`` is None where the record no longer counts.
    """

    __tablename__ = "verdict_revisions"
    __table_args__ = (Index("ix_verdict_revisions_pump_id_changed_at", "pump_id", "changed_at"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    pump_id: Mapped[int] = mapped_column(ForeignKey("pumps.id"))
    record_id: Mapped[str] = mapped_column(ForeignKey("records.id"))
    at: Mapped[datetime]
    old_state: Mapped[str]
    new_state: Mapped[str | None]
    cause: Mapped[str]
    cause_id: Mapped[str | None]
    changed_at: Mapped[datetime]
