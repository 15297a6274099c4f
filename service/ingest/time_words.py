"""How files say when: names and units of time, instants as seconds from the first of them."""

import re
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from service.ingest.raw import Samples

TIME_NAMES = frozenset(
    ("time", "time_s", "t", "timestamp", "timestamps", "time_stamp", "datetime", "date_time", "utc", "index")
)
"""Names of columns that may be a clock, in lower case; what makes them one is their unit or their type."""
_SECONDS_IN = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "µs", "μs", "usec", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nanosecond", "nanoseconds"), 1e-9),
    **dict.fromkeys(("min", "minute", "minutes"), 60.0),
    **dict.fromkeys(("h", "hr", "hrs", "hour", "hours"), 3600.0),
    **dict.fromkeys(("d", "day", "days"), 86_400.0),
}
_SINCE = re.compile(r"\s*(\S+)\s+since\s+(.+?)\s*", re.IGNORECASE)
_DATENUM_OF_1970 = 719_529.0
_LONGEST_S = 48.0 * 3600.0

TimesAndStart = tuple[Samples, datetime | None]


def is_time_name(name: str) -> bool:
    """Whether a column of this name may be a clock."""
    return name.strip().lower() in TIME_NAMES


def clock_in(samples: Samples, unit: str) -> TimesAndStart | None:
    """Times [s] and the instant of their zero, from numbers in a unit of time; None where the unit is none of time.

    ``seconds since 2026-05-02 07:11:00`` (CF) means UTC where it names no zone; ``datenum`` is MATLAB's day number.
    """
    word = unit.strip()
    if word.lower() in ("datenum", "matlab datenum"):
        return _from_first((samples - _DATENUM_OF_1970) * 86_400.0, datetime(1970, 1, 1))  # noqa: DTZ001 - MATLAB's days know no zone
    since = _SINCE.fullmatch(word)
    if since is None:
        factor = _SECONDS_IN.get(word.lower())
        return None if factor is None else (samples if factor == 1.0 else samples * factor, None)
    factor = _SECONDS_IN.get(since[1].lower())
    epoch = instant(since[2])
    if factor is None or epoch is None:
        return None
    times = samples if factor == 1.0 else samples * factor
    return _from_first(times, epoch if epoch.tzinfo else epoch.replace(tzinfo=UTC))


def instant(text: Any) -> datetime | None:
    """Instant that a text says as RFC 3339, blanks for the T; None where it says none."""
    word = str(text).strip().removesuffix("UTC").strip()
    try:
        return datetime.fromisoformat(word)
    except ValueError:
        return None


def clock_of_instants(instants: Any, *, utc: bool) -> TimesAndStart | None:
    """Times [s] from the first instant, shape (n,), NaN where there is none; None without any instant.

    Parameters
    ----------
    instants
        datetime64 of any resolution, shape (n,).
    utc
        Whether they are UTC; else they are in a zone that nobody states.
    """
    known = np.flatnonzero(~np.isnat(instants))
    if not len(known):
        return None
    first = instants[known[0]]
    times = (instants - first) / np.timedelta64(1, "ns" if "[ns]" in str(instants.dtype) else "us")
    per_second = 1e9 if "[ns]" in str(instants.dtype) else 1e6
    start: datetime | None = None
    try:
        start = first.astype("datetime64[us]").astype(datetime)
    except (OverflowError, ValueError):
        return None
    if not isinstance(start, datetime):  # outside the calendar of Python
        return None
    return np.asarray(times / per_second, dtype=np.float64), start.replace(tzinfo=UTC) if utc else start


def texts_of_instants(instants: Any, *, utc: bool) -> list[str | None]:
    """Instants as RFC 3339, None where there is none."""
    words = np.datetime_as_string(instants.astype("datetime64[us]"), unit="us")
    return [None if word == "NaT" else f"{word}Z" if utc else str(word) for word in words]


def _from_first(times: Samples, epoch: datetime) -> TimesAndStart:
    """Far from their epoch, times count from their own first."""
    known = times[np.isfinite(times)]
    if not len(known) or abs(known[0]) <= _LONGEST_S:
        return times, epoch
    first = float(np.floor(known[0] + 1e-4))  # day numbers tell 0.01 ms apart
    try:
        return times - first, epoch + timedelta(seconds=first)
    except OverflowError:
        return times, None
