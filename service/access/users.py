"""Users of the pages: made by an admin, known by a password that is kept as an Argon2id hash."""

import uuid
from datetime import UTC, datetime

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError
from sqlalchemy import select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from service.access.security import ROLES, Principal
from service.bodies import is_storable
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


def user(session: Session, principal: Principal, name: str, operator: str | None = None) -> User:
    """One user; ``operator`` tells namesakes apart for those who see every operator.

    Raises
    ------
    NotFound
        when there is none that this admin may manage.
    Conflict
        when there are several.
    """
    query = select(User).where(User.name == name)
    wanted = principal.operator or operator
    if wanted is not None:
        query = query.where(User.operator == wanted)
    if principal.operator not in (None, wanted) or operator not in (None, wanted):
        raise NotFound(f"there is no user {name}")
    rows = list(session.scalars(query.limit(2)))
    if not rows:
        raise NotFound(f"there is no user {name}")
    if len(rows) > 1:
        raise Conflict(f"several operators have a user {name}: name one with ?operator=")
    return rows[0]


def with_password(session: Session, name: str, password: str) -> User | None:
    """The user of that name and password; None when either is wrong or the user is disabled.

    Somebody whose name another operator has too, with the same password, signs in as ``operator/name``. It takes a tenth
    of a second of work for each namesake: call it in a session for reading, which keeps nobody else waiting.
    """
    operator, slash, bare = name.partition("/")
    named = (User.operator == operator) & (User.name == bare)
    rows = list(session.scalars(select(User).where((User.name == name) | named if slash else User.name == name)))
    found = [row for row in rows if _is_right(row.password_hash, password)]
    if not rows:
        _is_right(_NOBODY, password)
    return found[0] if len(found) == 1 and found[0].disabled_at is None else None


def _is_right(password_hash: str, password: str) -> bool:
    try:
        return _hasher.verify(password_hash, password)
    except (VerificationError, InvalidHashError, UnicodeEncodeError):
        return False


def set_password(row: User, password: str) -> None:
    """Replace a password that was checked before."""
    row.password_hash = _hasher.hash(password)


def link(session: Session, row: User, subject: str | None) -> None:
    """Link a user to an account at the issuer that signs people in; None unlinks.

    Raises
    ------
    Invalid, Conflict
        when it is no text, or another user's.
    """
    if subject is not None and not is_storable(subject):
        raise Invalid("1 fault(s)", [Fault("oidc_subject", "holds characters that are none")])
    row.oidc_subject = subject
    try:
        session.flush()
    except IntegrityError:
        raise Conflict("that account is linked to another user") from None


def password_faults(password: str) -> list[Fault]:
    """What is wrong with a new password; its length is judged, and that all of it is text."""
    if not is_storable(password):
        return [Fault("password", "holds characters that are none")]
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
