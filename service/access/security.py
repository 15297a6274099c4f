"""Who asks, and what they may do: API keys, hashed, with a role and perhaps an operator."""

import hashlib
import secrets
import uuid
from collections.abc import Collection
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Literal, get_args

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.access import scopes
from service.access.scopes import SCOPES
from service.errors import Forbidden, Unauthenticated
from service.storage.tables import ApiKey

Role = Literal["viewer", "analyst", "engineer", "admin"]
ROLES: tuple[str, ...] = get_args(Role)
"""Roles in rising order, each may do what those before it may: a viewer reads; an analyst uploads and handles alarms;
an engineer sets thresholds; an admin gives keys and sees the audit log."""
DEFAULT_OPERATOR = "default"
_PREFIX = "cd_"
LAST_USED_RESOLUTION = timedelta(minutes=1)


@dataclass(frozen=True, slots=True)
class Principal:
    """The one who asks. ``operator`` None sees every operator; ``key`` is the id of the key or user that came along.

    ``scopes`` None: whatever the role may.
    """

    owner: str
    role: str
    operator: str | None
    key: str = field(default="", compare=False)
    scopes: frozenset[str] | None = None

    def may(self, role: str) -> bool:
        """True with this role or a higher one."""
        return ROLES.index(self.role) >= ROLES.index(role)

    def require(self, role: str) -> None:
        """Raise ``Forbidden`` unless this role or a higher one is held."""
        if not self.may(role):
            raise Forbidden(f"this needs the role {role}; {self.owner} is {self.role}")

    def require_scope(self, scope: str) -> None:
        """Raise ``Forbidden`` when the key is for other things."""
        if self.scopes is not None and scope not in self.scopes:
            held = ", ".join(s for s in SCOPES if s in self.scopes)
            raise Forbidden(f"this needs a key with the scope {scope}; that of {self.owner} has {held}")

    def operator_of(self, wanted: str | None) -> str:
        """Operator to work for: the key's own, else the wanted, else the default.

        Raises
        ------
        Forbidden
            when the key belongs to another operator than the wanted one.
        """
        if self.operator is not None and wanted not in (None, self.operator):
            raise Forbidden(f"{self.owner} belongs to operator {self.operator}")
        return self.operator or wanted or DEFAULT_OPERATOR


EVERYBODY = Principal(owner="local", role="admin", operator=None)
"""Who asks where authentication is off (loopback only)."""
AT_THE_MACHINE = Principal(owner="command line", role="admin", operator=None)
"""Who uses the command line beside the database."""


def key_hash(key: str) -> str:
    """Hash under which a key is stored; keys hold 256 random bits, so one round of SHA-256 is enough."""
    return hashlib.sha256(key.encode()).hexdigest()


def new_key(
    session: Session,
    owner: str,
    role: str,
    operator: str | None,
    expires_at: datetime | None,
    for_scopes: Collection[str] | None = None,
) -> tuple[ApiKey, str]:
    """Make a key: its row and the key itself, which is shown this once.

    Raises
    ------
    ValueError
        when the role or a scope does not exist, or there is none where some are asked for.
    """
    if role not in ROLES:
        raise ValueError(f"no role {role!r}; roles: {', '.join(ROLES)}")
    unknown = [s for s in for_scopes or () if s not in SCOPES]
    if unknown or (for_scopes is not None and not for_scopes):
        raise ValueError(f"no scope {', '.join(unknown) or 'at all'}; scopes: {', '.join(SCOPES)}")
    key = _PREFIX + secrets.token_urlsafe(32)
    row = ApiKey(
        id=uuid.uuid4().hex,
        owner=owner,
        role=role,
        operator=operator,
        scopes=scopes.stored(for_scopes),
        key_hash=key_hash(key),
        created_at=datetime.now(UTC),
        expires_at=expires_at,
        last_used_at=None,
        revoked_at=None,
    )
    session.add(row)
    session.flush()
    return row, key


def principal_of(session: Session, key: str) -> tuple[Principal, bool]:
    """Who a key belongs to, and whether its time of last use wants an update.

    Raises
    ------
    Unauthenticated
        when there is no such key, it has expired or it was revoked.
    """
    # the lookup goes by hash: what a timing could tell is about the hash, not about the key
    row = session.scalar(select(ApiKey).where(ApiKey.key_hash == key_hash(key)))
    now = datetime.now(UTC)
    if row is None or not secrets.compare_digest(row.key_hash, key_hash(key)):
        raise Unauthenticated("no such key", headers={"WWW-Authenticate": "Bearer"})
    check_key(row, now)
    stale = row.last_used_at is None or now - row.last_used_at > LAST_USED_RESOLUTION
    return Principal(row.owner, row.role, row.operator, row.id, scopes.read(row.scopes)), stale


def check_key(row: ApiKey, now: datetime) -> None:
    """Raise ``Unauthenticated`` when a key no longer opens anything."""
    if row.revoked_at is not None:
        raise Unauthenticated("the key was revoked: ask an admin for a new one", headers={"WWW-Authenticate": "Bearer"})
    if row.expires_at is not None and row.expires_at <= now:
        raise Unauthenticated("the key has expired: ask an admin for a new one", headers={"WWW-Authenticate": "Bearer"})


def touch_key(session: Session, key: str) -> None:
    """Note that a key was used now."""
    row = session.scalar(select(ApiKey).where(ApiKey.key_hash == key_hash(key)))
    if row is not None:
        row.last_used_at = datetime.now(UTC)
