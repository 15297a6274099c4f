"""Pumps, aircraft and reference curves: what an operator says about its own hardware."""

from datetime import datetime

from sqlalchemy import Index, UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from service.answers.documents import JsonObject
from service.answers.registry import ReferencePoints
from service.storage.tables.base import JSON_COLUMN, Base


class Pump(Base):
    """A pump of an operator; ``confirmed`` is False for one that a record brought along.

    ``look`` is what the serial number looks like to somebody in a hurry (``service.ingest.names``); empty on rows older than it.
    ``made_by`` is the release, as a number that sorts, of the newest process that has written the pump's reductions or
    verdicts, and ``made_with`` the hash of its code: empty where they are to be made again.
    ``revision`` is raised, under the pump's lock, by whoever changes what is stored of it (``changed`` where verdicts stay).
    ``standing`` is how the pump stands by its newest record (``service.reading.standing``), kept with every fold; empty without
    one. It holds where ``standing_at`` is the revision now: a writer that does not know it leaves it behind. ``standing_link`` is
    the last link of the chain of verdicts then, which names all that they were folded from.
    """

    __tablename__ = "pumps"
    __table_args__ = (UniqueConstraint("operator", "serial"), Index("ix_pumps_operator_look", "operator", "look"))

    id: Mapped[int] = mapped_column(primary_key=True)
    operator: Mapped[str]
    serial: Mapped[str]
    pump_type: Mapped[str]
    confirmed: Mapped[bool]
    created_at: Mapped[datetime]
    look: Mapped[str | None]
    made_by: Mapped[int | None]
    made_with: Mapped[str | None]
    revision: Mapped[int] = mapped_column(default=0, server_default="0")
    standing: Mapped[JsonObject | None] = mapped_column(deferred=True)
    standing_at: Mapped[int | None]
    standing_link: Mapped[str | None]

    def changed(self) -> None:
        """Raise the revision for a change that leaves the newest verdict as it is; the caller holds the pump's lock."""
        if self.standing_at == self.revision:
            self.standing_at += 1
        self.revision += 1


class Aircraft(Base):
    """A helicopter of an operator; what is known of it stands in its ``RegistryVersion`` rows."""

    __tablename__ = "aircraft"
    __table_args__ = (UniqueConstraint("operator", "name"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    operator: Mapped[str]
    name: Mapped[str]
    created_at: Mapped[datetime]


class RegistryVersion(Base):
    """What the registry said of one pump or aircraft from ``recorded_at`` on; rows are never changed.

    A verdict as it stood at an instant reads the newest row that was recorded by then.
    """

    __tablename__ = "registry_versions"
    __table_args__ = (Index("ix_registry_versions_entity", "operator", "kind", "name"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    operator: Mapped[str]
    kind: Mapped[str]
    name: Mapped[str]
    values: Mapped[JsonObject]
    recorded_at: Mapped[datetime]
    author: Mapped[str]


class ReferenceCurve(Base):
    """Measured healthy points of a pump type; ``operator`` None holds for every operator. Rows are never changed."""

    __tablename__ = "reference_curves"
    __table_args__ = (Index("ix_reference_curves_pump_type_operator", "pump_type", "operator"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    pump_type: Mapped[str]
    operator: Mapped[str | None]
    points: Mapped[ReferencePoints] = mapped_column(JSON_COLUMN)
    recorded_at: Mapped[datetime]
    author: Mapped[str]
