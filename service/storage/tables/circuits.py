"""Circuits that operators and engineers have added to the twin's own."""

from datetime import datetime

from sqlalchemy import UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from service.answers.documents import JsonObject
from service.storage.tables.base import Base


class StoredCircuit(Base):
    """A circuit, whole; ``operator`` None is for everybody. Rows are never changed: verdicts rest on them."""

    __tablename__ = "circuits"
    __table_args__ = (UniqueConstraint("operator", "name"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    operator: Mapped[str | None]
    name: Mapped[str]
    document: Mapped[JsonObject]
    created_at: Mapped[datetime]
    author: Mapped[str]
