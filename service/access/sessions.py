"""Sessions of the pages: started by a password or a key, ended by time, by signing out or by an admin."""

import base64
import hashlib
import secrets
import uuid
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from http import HTTPStatus

from sqlalchemy import func, select, update
from sqlalchemy.orm import Session

from service.access.last_use import note_use
from service.access.security import LAST_USED_RESOLUTION, Principal, check_key, key_hash
from service.errors import Forbidden, Problem, Unauthenticated
from service.settings import Settings
from service.storage.database import Database
from service.storage.tables import ApiKey, FailedSignIn, SignedIn, User

_SESSION_COOKIE = "casedrain_session"
_FAILURES_WINDOW = timedelta(minutes=15)
_MOST_FAILURES = {"name and address": 5, "name": 30, "address": 50}
"""Failures within the window after which sign-ins wait: few from one place for one name, more for a name from
everywhere (so that a stranger cannot easily lock somebody out) and for a place that many share."""


def cookie_name(name: str, is_secure: bool) -> str:
    """Name of a cookie; the prefix makes browsers refuse one that another host or an unencrypted page has set."""
    return f"__Host-{name}" if is_secure else name


def session_cookie(is_secure: bool) -> str:
    """Name of the session's cookie."""
    return cookie_name(_SESSION_COOKIE, is_secure)


class TooManySignIns(Problem):
    """Sign-ins failed too often."""

    status, title = HTTPStatus.TOO_MANY_REQUESTS, "Too many requests"


@dataclass(frozen=True, slots=True)
class Visitor:
    """Somebody signed in to the pages; every form must bring ``csrf_token`` back."""

    principal: Principal
    session_id: str
    secret: str

    @property
    def csrf_token(self) -> str:
        """What the session's forms carry: its secret under another mask in every page.

        Pages are compressed and repeat what their address says: the size of many of them would give away a secret that
        is always written alike.
        """
        secret = self.secret.encode()
        mask = secrets.token_bytes(len(secret))
        return base64.urlsafe_b64encode(mask + _masked(secret, mask)).decode()

    def check_form(self, token: str) -> None:
        """Raise ``Forbidden`` unless a form comes from a page of this session."""
        try:
            held = base64.b64decode(token.encode(), b"-_", validate=True)
        except ValueError:
            held = b""
        half = len(held) // 2
        if not secrets.compare_digest(self.secret.encode(), _masked(held[half:], held[:half])):
            raise Forbidden("the form does not belong to this session: open the page again and repeat")


def _masked(text: bytes, mask: bytes) -> bytes:
    return bytes(a ^ b for a, b in zip(text, mask, strict=False))


def start_session(session: Session, settings: Settings, *, user_id: str | None, key_id: str | None) -> str:
    """Start a session of a user or of a key; gives the token for the cookie, which is kept as a hash only."""
    token, now = secrets.token_urlsafe(32), datetime.now(UTC)
    session.add(
        SignedIn(
            id=uuid.uuid4().hex,
            token_hash=_hash(token),
            csrf_token=secrets.token_urlsafe(32),
            user_id=user_id,
            key_id=key_id,
            created_at=now,
            expires_at=now + timedelta(hours=settings.session_hours),
            last_used_at=now,
            revoked_at=None,
        )
    )
    if user_id is not None:
        session.execute(update(User).where(User.id == user_id).values(last_signed_in_at=now))
    return token


def find_session(database: Database, token: str, settings: Settings) -> Visitor | None:
    """Who a cookie's token belongs to; None when the session is unknown, over, idle for too long or revoked."""
    now = datetime.now(UTC)
    with database.reading() as session:
        row = session.scalar(select(SignedIn).where(SignedIn.token_hash == _hash(token)))
        if row is None or row.revoked_at is not None or row.expires_at <= now:
            return None
        if now - row.last_used_at > timedelta(minutes=settings.session_idle_minutes):
            return None
        principal = _principal(session, row, now)
    if principal is None:
        return None
    if now - row.last_used_at > LAST_USED_RESOLUTION:
        used = update(SignedIn).where(SignedIn.id == row.id).values(last_used_at=now)
        note_use(database, f"session {row.id}", lambda session: session.execute(used))
    return Visitor(principal, row.id, row.csrf_token)


def end_session(session: Session, session_id: str) -> None:
    """End one session."""
    session.execute(update(SignedIn).where(SignedIn.id == session_id).values(revoked_at=datetime.now(UTC)))


def end_sessions_of(session: Session, user: User) -> int:
    """End every session of a user; gives how many were alive."""
    living = (SignedIn.user_id == user.id) & SignedIn.revoked_at.is_(None) & (SignedIn.expires_at > datetime.now(UTC))
    ids = list(session.scalars(select(SignedIn.id).where(living)))
    session.execute(update(SignedIn).where(SignedIn.id.in_(ids)).values(revoked_at=datetime.now(UTC)))
    return len(ids)


def check_pace(session: Session, name: str, address: str) -> None:
    """Slow down who guesses.

    Raises
    ------
    TooManySignIns
        with ``Retry-After``, when too many sign-ins failed for this name or from this address.
    """
    now = datetime.now(UTC)
    recent = FailedSignIn.at > now - _FAILURES_WINDOW
    by_name, by_address = FailedSignIn.name_hash == name_hash(name), FailedSignIn.address == address
    for what, condition in (
        ("name and address", by_name & by_address),
        ("name", by_name),
        ("address", by_address),
    ):
        count, first = session.execute(select(func.count(), func.min(FailedSignIn.at)).where(recent, condition)).one()
        if count >= _MOST_FAILURES[what]:
            wait = max(1, int((first + _FAILURES_WINDOW - now).total_seconds()) + 1)
            raise TooManySignIns(f"too many sign-ins failed: try again in {wait} s", headers={"Retry-After": str(wait)})


def note_failure(session: Session, name: str, address: str) -> None:
    """Remember a sign-in that failed."""
    session.add(FailedSignIn(name_hash=name_hash(name), address=address, at=datetime.now(UTC)))


def name_hash(name: str) -> str:
    """What is kept of a name that failed to sign in; half a surrogate pair counts as the replacement character."""
    return _hash(name)


def forget_failures(session: Session, name: str, address: str) -> None:
    """Somebody came in: the mistakes before count no longer."""
    mine = (FailedSignIn.name_hash == name_hash(name)) & (FailedSignIn.address == address)
    for row in session.scalars(select(FailedSignIn).where(mine)):
        session.delete(row)


def key_of(session: Session, key: str) -> ApiKey | None:
    """The living key of that text; None without one, and for a key with scopes: the pages are for all that a role may."""
    row = session.scalar(select(ApiKey).where(ApiKey.key_hash == key_hash(key)))
    try:
        if row is not None:
            check_key(row, datetime.now(UTC))
    except Unauthenticated:
        return None
    return None if row is None or row.scopes is not None else row


def _principal(session: Session, row: SignedIn, now: datetime) -> Principal | None:
    if row.user_id is not None:
        user = session.get(User, row.user_id)
        if user is None or user.disabled_at is not None:
            return None
        return Principal(user.name, user.role, user.operator, user.id)
    key = session.get(ApiKey, row.key_id) if row.key_id is not None else None
    if key is None or key.revoked_at is not None or (key.expires_at is not None and key.expires_at <= now):
        return None
    return Principal(key.owner, key.role, key.operator, key.id)


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "replace")).hexdigest()
