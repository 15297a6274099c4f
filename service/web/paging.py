"""Lists paged by cursor; a cursor works for the query that it came from and for no other."""

import base64
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from service.answers.words import Page
from service.errors import Fault, Invalid

MOST_ITEMS = 500
DEFAULT_ITEMS = 100
Row = TypeVar("Row")
Shown = TypeVar("Shown")


def _signature(query: Mapping[str, Any], place: Any) -> str:
    """Tells a cursor of another query, and one that was cut or changed on the way."""
    return hashlib.sha256(json.dumps([query, place], sort_keys=True, default=str).encode()).hexdigest()[:12]


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
    except (ValueError, TypeError):
        raise Invalid("the cursor is not one of ours", [Fault("cursor", "cannot be read")]) from None
    if signature != _signature(query, place):
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
