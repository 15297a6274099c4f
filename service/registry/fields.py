"""Checked pieces that request bodies of the registry are made of."""

import re
from datetime import UTC, datetime
from typing import Annotated

from pydantic import AfterValidator, AwareDatetime, BeforeValidator, StringConstraints

from service.ingest.names import clean_name, name_fault

_NUMBER = re.compile(r"[+-]?[\d_.]+(e[+-]?\d+)?|[+-]?(inf(inity)?|nan)", re.IGNORECASE)


def _written(given: object) -> object:
    """Refuse numbers, also as text: a count of what since when is nobody's guess."""
    if isinstance(given, int | float) or (isinstance(given, str) and _NUMBER.fullmatch(given.strip())):
        raise ValueError("is a number: write an instant like 2026-05-08T12:00:00Z")
    return given


def _sensible(instant: datetime) -> datetime:
    try:
        instant = instant.astimezone(UTC)
    except OverflowError:
        raise ValueError("lies outside the calendar") from None
    if not 1970 <= instant.year < 2200:
        raise ValueError("lies outside the years 1970 to 2199")
    return instant


def _printable(text: str) -> str:
    if any(ord(c) < 32 and c not in "\n\t" for c in text):
        raise ValueError("holds control characters")
    return text


def _named(text: str) -> str:
    name = clean_name(text)
    fault = name_fault(name)
    if fault is not None:
        raise ValueError(fault)
    return name


Written = Annotated[datetime, BeforeValidator(_written)]
"""A date with time, as text; whether it has a zone is looked at elsewhere."""
Instant = Annotated[AwareDatetime, BeforeValidator(_written), AfterValidator(_sensible)]
"""An instant with a time zone, in UTC."""
Name = Annotated[
    str,
    StringConstraints(strip_whitespace=True, min_length=1, max_length=200, pattern=r"^[^\x00-\x1f]+$"),
    AfterValidator(_named),
]
"""A serial number, tail number, position … in its one spelling, as a record's metadata has it."""
Note = Annotated[str, StringConstraints(strip_whitespace=True, max_length=2000), AfterValidator(_printable)]
"""A few lines by hand (our choice: a page)."""
Reason = Annotated[Note, StringConstraints(min_length=1)]
"""A note that cannot be left out."""
