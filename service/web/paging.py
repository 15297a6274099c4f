"""Lists paged by cursor; a cursor works for the query that it came from and for no other."""

import base64
import hashlib
import hmac
import json
import secrets
from collections.abc import Callable, Mapping, Sequence
from contextvars import ContextVar
from typing import Any, TypeVar

from service import __version__
from service.answers.words import Page
from service.errors import Fault, Invalid

MOST_ITEMS = 500
DEFAULT_ITEMS = 100
Row = TypeVar("Row")
Shown = TypeVar("Shown")


_key: ContextVar[bytes] = ContextVar("cursor key", default=secrets.token_bytes(32))  # noqa: B039 - bytes do not change


def sign_with(key: bytes) -> None:
    """Sign and read the cursors of this request with an installation's key."""
    _key.set(key)


def _signature(query: Mapping[str, Any], place: Any) -> str:
    """Tells a cursor of ours from one that was made, cut or changed by others, and from that of another query or release.

    A place is handed to the database as it is: whoever could sign one could ask with anything.
    """
    text = json.dumps([__version__, query, place], sort_keys=True, default=str).encode()
    return hmac.new(_key.get(), text, hashlib.sha256).hexdigest()[:32]


def cursor_after(query: Mapping[str, Any], place: Any) -> str:
    """Opaque cursor of the last row shown."""
    document = json.dumps([_signature(query, place), place], default=str).encode()
    return base64.urlsafe_b64encode(document).decode().rstrip("=")


def place_of(query: Mapping[str, Any], cursor: str | None) -> Any:
    """Place that a cursor stands for; None without one.

    Raises
    ------
    Invalid
        when the cursor is garbled or belongs to another query.
    """
    if cursor is None:
        return None
    try:
        signature, place = json.loads(base64.urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4)))
    except (ValueError, TypeError, RecursionError):
        raise Invalid("the cursor is not one of ours", [Fault("cursor", "cannot be read")]) from None
    if not hmac.compare_digest(str(signature).encode("utf-8", "replace"), _signature(query, place).encode()):
        raise Invalid(
            "the cursor is damaged or belongs to another query: repeat the query that gave it",
            [Fault("cursor", "was given for other parameters")],
        )
    return place


def page(
    rows: Sequence[Row],
    limit: int,
    query: Mapping[str, Any],
    place: Callable[[Row], Any],
    shown: Callable[[Row], Shown],
) -> Page[Shown]:
    """One page of ``rows``, of which one more than ``limit`` was fetched to know whether there are more."""
    more = len(rows) > limit
    rows = rows[:limit]
    return {
        "items": [shown(row) for row in rows],
        "next": cursor_after(query, place(rows[-1])) if more and rows else None,
    }
