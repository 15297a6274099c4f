"""Zones of instants that name none: a place of the zone database, UTC, or a fixed offset."""

import re
from datetime import UTC, timedelta, timezone, tzinfo
from functools import lru_cache
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

_OFFSET = re.compile(r"(?:UTC|GMT)?\s*([+-])(\d{1,2})(?::?(\d{2}))?", re.IGNORECASE)
_MOST_HOURS = 14


@lru_cache(maxsize=256)
def zone_of(name: str) -> tzinfo:
    """Zone by its name (``Europe/Paris``), as ``UTC`` or ``Z``, or as an offset (``+02:00``).

    Raises
    ------
    ValueError
        when there is none of that name.
    """
    word = name.strip()
    if word.upper() in ("UTC", "Z", "GMT", "ZULU"):
        return UTC
    offset = _OFFSET.fullmatch(word)
    if offset:
        shift = timedelta(hours=int(offset[2]), minutes=int(offset[3] or 0))
        if shift <= timedelta(hours=_MOST_HOURS):
            return timezone(-shift if offset[1] == "-" else shift)
    try:
        return ZoneInfo(word)
    except (ZoneInfoNotFoundError, ValueError, OSError):
        raise ValueError(f"there is no zone {name!r}: write UTC, +02:00 or Europe/Paris") from None
