"""Backups that were made: who deletes an operator is told which copies of its data are still about."""

from datetime import datetime

from sqlalchemy.orm import Mapped, mapped_column

from service.storage.tables.base import Base


class Backup(Base):
    """A backup that was begun; ``finished_at`` is empty in the backup itself, ``removed_at`` until somebody says so."""

    __tablename__ = "backups"

    id: Mapped[str] = mapped_column(primary_key=True)
    started_at: Mapped[datetime]
    finished_at: Mapped[datetime | None]
    removed_at: Mapped[datetime | None]
    place: Mapped[str]
