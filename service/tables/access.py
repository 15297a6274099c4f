"""Who may come in."""

from datetime import datetime

from sqlalchemy.orm import Mapped, mapped_column

from service.tables.base import Base


class ApiKey(Base):
    """A key's hash with what it may do; the key itself is shown once and never stored."""

    __tablename__ = "api_keys"

    id: Mapped[str] = mapped_column(primary_key=True)
    owner: Mapped[str]
    role: Mapped[str]
    operator: Mapped[str | None]
    key_hash: Mapped[str] = mapped_column(unique=True)
    created_at: Mapped[datetime]
    expires_at: Mapped[datetime | None]
    last_used_at: Mapped[datetime | None]
