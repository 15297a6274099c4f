"""Versions of channel mappings."""

from datetime import datetime

from sqlalchemy import UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from service.answers.documents import JsonObject
from service.storage.tables.base import Base


class StoredMapping(Base):
    """One version of an operator's channel mapping; the highest version holds, rows are never changed."""

    __tablename__ = "channel_mappings"
    __table_args__ = (UniqueConstraint("operator", "name", "version"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    operator: Mapped[str]
    name: Mapped[str]
    version: Mapped[int]
    aircraft_type: Mapped[str | None]
    description: Mapped[str]
    document: Mapped[JsonObject]
    author: Mapped[str]
    created_at: Mapped[datetime]
