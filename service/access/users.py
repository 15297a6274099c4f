"""Users of the pages: made by an admin, known by a password that is kept as an Argon2id hash."""

import uuid
from datetime import UTC, datetime

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError
from sqlalchemy import select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from service.access.security import ROLES, Principal
from service.errors import Conflict, Fault, Invalid, NotFound
from service.storage.tables import User

SHORTEST_PASSWORD = 12
LONGEST_PASSWORD = 1000
_hasher = PasswordHasher()
_NOBODY = _hasher.hash("nobody has this password")
"""Verified against where the name is unknown, so that the time to answer does not tell who exists."""


def new_user(
    session: Session,
    name: str,
    password: str,
    role: str,
    operator: str | None,
    email: str | None = None,
    wants_mail: bool = False,
) -> User:
    """Make a user.

    Raises
    ------
    Invalid
        with every fault of name, password, role and address.
    Conflict
        when the name is taken.
    """
    faults = [*_name_faults(name), *password_faults(password)]
    if role not in ROLES:
        faults.append(Fault("role", f"{role!r} is not one of {', '.join(ROLES)}"))
    faults += address_faults(email, wants_mail)
    if faults:
        raise Invalid(f"{len(faults)} fault(s); no user was made", faults)
    row = User(
        id=uuid.uuid4().hex,
        name=name,
        role=role,
        operator=operator,
        email=email,
        wants_mail=wants_mail,
        password_hash=_hasher.hash(password),
        created_at=datetime.now(UTC),
        disabled_at=None,
        last_signed_in_at=None,
    )
    session.add(row)
    try:
        session.flush()
    except IntegrityError:
        raise Conflict(f"the name {name!r} is taken: choose another one") from None
    return row


def user(session: Session, principal: Principal, name: str) -> User:
    """One user.

    Raises
    ------
    NotFound
        when there is none that this admin may manage.
    """
    row = session.scalar(select(User).where(User.name == name))
    if row is None or principal.operator not in (None, row.operator):
        raise NotFound(f"there is no user {name}")
    return row


def with_password(session: Session, name: str, password: str) -> User | None:
    """The user of that name and password; None when either is wrong or the user is disabled.

    It takes a tenth of a second of work: call it in a session for reading, which keeps nobody else waiting.
    """
    row = session.scalar(select(User).where(User.name == name))
    try:
        _hasher.verify(row.password_hash if row is not None else _NOBODY, password)
    except (VerificationError, InvalidHashError):
        return None
    return row if row is not None and row.disabled_at is None else None


def set_password(row: User, password: str) -> None:
    """Replace a password that was checked before."""
    row.password_hash = _hasher.hash(password)


def password_faults(password: str) -> list[Fault]:
    """What is wrong with a new password; only its length is judged."""
    if SHORTEST_PASSWORD <= len(password) <= LONGEST_PASSWORD:
        return []
    return [Fault("password", f"has {len(password)} characters: {SHORTEST_PASSWORD} to {LONGEST_PASSWORD} are needed")]


def address_faults(email: str | None, wants_mail: bool) -> list[Fault]:
    """What is wrong with a mail address."""
    if email is None:
        return [Fault("wants_mail", "needs an email address")] if wants_mail else []
    local, at, domain = email.partition("@")
    if not (local and at and domain) or "@" in domain or not email.isprintable() or any(c in email for c in " ,;<>"):
        return [Fault("email", "is not one address like name@example.org")]
    return []


def _name_faults(name: str) -> list[Fault]:
    if name and name == name.strip() and name.isprintable() and len(name) <= 200:
        return []
    return [Fault("name", "must be printable, without blanks at its ends, up to 200 characters")]
