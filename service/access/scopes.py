"""Scopes: what a key is for. A key without any does what its role may; with some, only what they name, and the role still holds."""

from collections.abc import Collection, Iterable
from typing import Literal, get_args

Scope = Literal["read", "upload", "maintain", "admin"]
SCOPES: tuple[str, ...] = get_args(Scope)
"""Reading answers; sending records; changing what is said of a fleet; keys, users, operators, webhooks and the audit log."""
_READING = ("GET", "HEAD", "OPTIONS")
_ADMINISTRATION = ("keys", "users", "webhooks", "operators", "audit")
_UPLOADS = ("/records", "/records/bulk", "/mappings/preview", "/mappings/suggest")
_QUESTIONS = ("twin",)
"""Rooms of the API whose calls change nothing though they are sent with a body."""


def scope_of(method: str, path: str) -> str:
    """Scope that a call takes; what is not known to read or to send is a change.

    Parameters
    ----------
    method, path
        Of the request, the path below the API's prefix: ``/pumps/P-1``.
    """
    room = path.strip("/").partition("/")[0]
    if room in _ADMINISTRATION:
        return "admin"
    if method in _READING or room in _QUESTIONS:
        return "read"
    return "upload" if path.rstrip("/") in _UPLOADS else "maintain"


def stored(scopes: Iterable[str] | None) -> str | None:
    """Scopes as a row keeps them, in the order of ``SCOPES``."""
    return None if scopes is None else " ".join(s for s in SCOPES if s in set(scopes))


def read(text: str | None) -> frozenset[str] | None:
    """Scopes of a row."""
    return None if text is None else frozenset(text.split())


def shown(text: str | None) -> list[str] | None:
    """Scopes of a row in their order."""
    return None if text is None else text.split()


def beyond(wanted: Collection[str] | None, held: Collection[str] | None) -> list[str]:
    """Scopes that somebody would give away without holding them; a key without scopes holds all."""
    if held is None:
        return []
    return [s for s in SCOPES if s in (SCOPES if wanted is None else wanted) and s not in held]
