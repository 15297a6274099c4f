"""Pumps and where they belong."""

from datetime import datetime

from sqlalchemy import UniqueConstraint
from sqlalchemy.orm import Mapped, mapped_column

from service.tables.base import Base


class Pump(Base):
    """A pump of an operator; ``confirmed`` is False for one that a record brought along."""

    __tablename__ = "pumps"
    __table_args__ = (UniqueConstraint("operator", "serial"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    operator: Mapped[str]
    serial: Mapped[str]
    pump_type: Mapped[str]
    confirmed: Mapped[bool]
    created_at: Mapped[datetime]
