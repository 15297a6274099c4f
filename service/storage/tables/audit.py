"""Who changed what, and when, and the chain that proves that nobody has changed it since."""

from datetime import datetime

from sqlalchemy import Index
from sqlalchemy.orm import Mapped, mapped_column

from service.answers.documents import JsonObject
from service.storage.tables.base import Base


class AuditEntry(Base):
    """One change; ``operator`` is the tenant whose data changed, None for what holds for all. Rows are only added.

    ``salt`` goes into the entry's hash and away with the entry; it is empty where an older release wrote the row.
    """

    __tablename__ = "audit_entries"
    __table_args__ = (Index("ix_audit_entries_operator_id", "operator", "id"), {"sqlite_autoincrement": True})

    id: Mapped[int] = mapped_column(primary_key=True)
    at: Mapped[datetime] = mapped_column(index=True)
    actor: Mapped[str]
    role: Mapped[str]
    operator: Mapped[str | None]
    action: Mapped[str]
    subject: Mapped[str]
    details: Mapped[JsonObject]
    salt: Mapped[str | None]


class AuditLink(Base):
    """One link of the chain: it stays when its entry is erased with its operator, so it refers to it by number only."""

    __tablename__ = "audit_links"

    position: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    entry_id: Mapped[int] = mapped_column(unique=True)
    content_hash: Mapped[str]
    link: Mapped[str]


class AuditHead(Base):
    """End of the chain, one row: who writes locks it. ``signature`` is empty until a process with a key has started."""

    __tablename__ = "audit_heads"

    id: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    chain_id: Mapped[str]
    count: Mapped[int]
    link: Mapped[str]
    public_key: Mapped[str]
    signature: Mapped[str]
    signed_at: Mapped[datetime | None]
