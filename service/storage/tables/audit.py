"""Who changed what, and when."""

from datetime import datetime
from typing import Any

from sqlalchemy import Index
from sqlalchemy.orm import Mapped, mapped_column

from service.storage.tables.base import Base


class AuditEntry(Base):
    """One change; ``operator`` is the tenant whose data changed, None for what holds for all. Rows are only added."""

    __tablename__ = "audit_entries"
    __table_args__ = (Index("ix_audit_entries_operator_id", "operator", "id"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    at: Mapped[datetime] = mapped_column(index=True)
    actor: Mapped[str]
    role: Mapped[str]
    operator: Mapped[str | None]
    action: Mapped[str]
    subject: Mapped[str]
    details: Mapped[dict[str, Any]]
