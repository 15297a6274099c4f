"""Operators: how long their raw data are kept, and proof that one was deleted."""

from datetime import datetime

from sqlalchemy import false
from sqlalchemy.orm import Mapped, mapped_column

from service.answers.administration import Receipt
from service.answers.documents import JsonObject
from service.storage.tables.base import JSON_COLUMN, Base


class OperatorSettings(Base):
    """What one operator has set; an operator without a row keeps everything.

    ``retention_days`` are of raw bytes. Under ``legal_hold`` nothing of the operator goes, whatever its age.
    """

    __tablename__ = "operator_settings"

    operator: Mapped[str] = mapped_column(primary_key=True)
    retention_days: Mapped[int | None]
    job_days: Mapped[int | None]
    audit_days: Mapped[int | None]
    legal_hold: Mapped[bool] = mapped_column(default=False, server_default=false())
    changed_at: Mapped[datetime]
    author: Mapped[str]


class Deletion(Base):
    """An operator's deletion: ``pending`` names raw bytes still to be removed, ``receipt`` is the proof afterwards.

    The column of the deleted operator is called ``deleted_operator`` so that the row outlives what it proves.
    """

    __tablename__ = "deletions"

    id: Mapped[str] = mapped_column(primary_key=True)
    deleted_operator: Mapped[str]
    author: Mapped[str]
    reason: Mapped[str]
    started_at: Mapped[datetime]
    finished_at: Mapped[datetime | None]
    pending: Mapped[JsonObject]
    receipt: Mapped[Receipt] = mapped_column(JSON_COLUMN)
