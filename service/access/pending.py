"""Sign-ins that are on their way to an issuer and back: kept in the database, so that any replica takes the answer, once."""

import hashlib
import secrets
from datetime import UTC, datetime, timedelta

from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from service.access.oidc import Asked
from service.storage.tables import PendingSignIn, User

PENDING_S = 600
"""How long somebody may take at the issuer [s] (our choice)."""


def keep_pending(session: Session, asked: Asked, browser: str, wanted: str) -> None:
    """Remember a sign-in that begins; those that nobody came back from go."""
    now = datetime.now(UTC)
    session.execute(delete(PendingSignIn).where(PendingSignIn.expires_at < now))
    session.add(
        PendingSignIn(
            state_hash=_hash(asked.state),
            browser_hash=_hash(browser),
            nonce=asked.nonce,
            verifier=asked.verifier,
            wanted=wanted,
            expires_at=now + timedelta(seconds=PENDING_S),
        )
    )


def taken_pending(session: Session, state: str, browser: str) -> PendingSignIn | None:
    """The sign-in of a state, which is gone with it; None where there is none, or it is another browser's.

    Of two that bring the same state only one is given it.
    """
    row = session.get(PendingSignIn, _hash(state), with_for_update=True)
    if row is None:
        return None
    session.delete(row)
    session.flush()
    is_ours = secrets.compare_digest(row.browser_hash, _hash(browser))
    return row if is_ours and row.expires_at > datetime.now(UTC) else None


def with_subject(session: Session, subject: str) -> User | None:
    """The user whom the issuer knows by this subject; None without one, or where access was taken away."""
    user = session.scalar(select(User).where(User.oidc_subject == subject))
    return user if user is not None and user.disabled_at is None else None


def _hash(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "replace")).hexdigest()
