"""Versions of thresholds, and pumps that are held at an earlier one."""

from datetime import datetime

from sqlalchemy import ForeignKey, Index
from sqlalchemy.orm import Mapped, mapped_column

from service.storage.tables.base import JSON_COLUMN, Base


class ThresholdVersion(Base):
    """One version of one layer of thresholds; ``number`` counts for the whole service, rows are never changed."""

    __tablename__ = "threshold_versions"
    __table_args__ = (Index("ix_threshold_versions_scope_scope_id", "scope", "scope_id", "operator"),)

    number: Mapped[int] = mapped_column(primary_key=True)
    scope: Mapped[str]
    scope_id: Mapped[str]
    operator: Mapped[str | None]
    values: Mapped[dict[str, float]] = mapped_column(JSON_COLUMN)
    author: Mapped[str]
    reason: Mapped[str]
    created_at: Mapped[datetime]


class ThresholdPin(Base):
    """A pump that was reprocessed with an earlier version of the thresholds; rows are never changed.

    The pump's newest pin counts while none of its layers has a version above ``counter``, the highest number when it
    was set: a change of thresholds wins over it. ``number`` None lets the pump follow the newest thresholds again.
    """

    __tablename__ = "threshold_pins"

    id: Mapped[int] = mapped_column(primary_key=True)
    pump_id: Mapped[int] = mapped_column(ForeignKey("pumps.id"), index=True)
    number: Mapped[int | None]
    counter: Mapped[int]
    author: Mapped[str]
    recorded_at: Mapped[datetime]
