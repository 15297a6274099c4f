"""Versions of thresholds."""

from datetime import datetime
from typing import Any

from sqlalchemy import Index
from sqlalchemy.orm import Mapped, mapped_column

from service.tables.base import Base


class ThresholdVersion(Base):
    """One version of one layer of thresholds; ``number`` counts for the whole service, rows are never changed."""

    __tablename__ = "threshold_versions"
    __table_args__ = (Index("ix_threshold_versions_scope_scope_id", "scope", "scope_id", "operator"),)

    number: Mapped[int] = mapped_column(primary_key=True)
    scope: Mapped[str]
    scope_id: Mapped[str]
    operator: Mapped[str | None]
    values: Mapped[dict[str, Any]]
    author: Mapped[str]
    reason: Mapped[str]
    created_at: Mapped[datetime]
