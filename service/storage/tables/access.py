"""Who may come in: keys, users, their sessions, and sign-ins that failed."""

from datetime import datetime

from sqlalchemy import ForeignKey, Index, UniqueConstraint, text
from sqlalchemy.orm import Mapped, mapped_column

from service.storage.tables.base import Base

_OF_ALL = text("operator IS NULL")
"""A unique constraint takes every missing operator for another one."""


class ApiKey(Base):
    """A key's hash with what it may do; the key itself is shown once and never stored."""

    __tablename__ = "api_keys"

    id: Mapped[str] = mapped_column(primary_key=True)
    owner: Mapped[str]
    role: Mapped[str]
    operator: Mapped[str | None]
    scopes: Mapped[str | None]
    """Names with blanks between them; none: whatever the role may."""
    key_hash: Mapped[str] = mapped_column(unique=True)
    created_at: Mapped[datetime]
    expires_at: Mapped[datetime | None]
    last_used_at: Mapped[datetime | None]
    revoked_at: Mapped[datetime | None]


class User(Base):
    """Somebody who signs in to the pages; the password is kept as an Argon2id hash.

    Two operators may have somebody of the same name and learn nothing of it.
    """

    __tablename__ = "users"
    __table_args__ = (
        UniqueConstraint("operator", "name"),
        Index("ix_users_name_of_all", "name", unique=True, sqlite_where=_OF_ALL, postgresql_where=_OF_ALL),
    )

    id: Mapped[str] = mapped_column(primary_key=True)
    name: Mapped[str]
    role: Mapped[str]
    operator: Mapped[str | None]
    email: Mapped[str | None]
    wants_mail: Mapped[bool] = mapped_column(default=False)
    password_hash: Mapped[str]
    created_at: Mapped[datetime]
    disabled_at: Mapped[datetime | None]
    last_signed_in_at: Mapped[datetime | None]
    oidc_subject: Mapped[str | None] = mapped_column(unique=True)
    """Who this is to the issuer that signs people in; none: by password only."""


class PendingSignIn(Base):
    """A sign-in that was sent to the issuer: what its answer must bring back. Taken once, then it is gone."""

    __tablename__ = "pending_sign_ins"
    __table_args__ = (Index("ix_pending_sign_ins_expires_at", "expires_at"),)

    state_hash: Mapped[str] = mapped_column(primary_key=True)
    browser_hash: Mapped[str]
    nonce: Mapped[str]
    verifier: Mapped[str]
    wanted: Mapped[str]
    expires_at: Mapped[datetime]


class SignedIn(Base):
    """A session of the pages, of a user or of a key; the cookie's token is kept as a hash."""

    __tablename__ = "sessions"

    id: Mapped[str] = mapped_column(primary_key=True)
    token_hash: Mapped[str] = mapped_column(unique=True)
    csrf_token: Mapped[str]
    user_id: Mapped[str | None] = mapped_column(ForeignKey("users.id"), index=True)
    key_id: Mapped[str | None] = mapped_column(ForeignKey("api_keys.id"), index=True)
    created_at: Mapped[datetime]
    expires_at: Mapped[datetime] = mapped_column(index=True)
    last_used_at: Mapped[datetime]
    revoked_at: Mapped[datetime | None]


class FailedSignIn(Base):
    """One refused sign-in, to slow down who guesses; the name is kept as a hash, it may be a mistyped secret."""

    __tablename__ = "failed_sign_ins"
    __table_args__ = (Index("ix_failed_sign_ins_at", "at"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    name_hash: Mapped[str]
    address: Mapped[str]
    at: Mapped[datetime]
