"""Time from instants: one column of them, or date, time of day and offset apart, as seconds and the instant of the first.

Repeats of a coarse clock are spread over their step, a clock without a date goes on over midnight.
"""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, timezone, tzinfo
from functools import lru_cache
from typing import Any

import numpy as np

from service.errors import Fault
from service.ingest.raw import MOST_FAULTS_OF_A_KIND, Samples, capped

EPOCHS = {"epoch_s": 1.0, "epoch_ms": 1e-3, "epoch_us": 1e-6, "epoch_ns": 1e-9}
"""Counts from 1970 in UTC, and their unit [s]."""
SERIALS = {"excel_days": 25569.0, "matlab_days": 719529.0}
"""Days of local time, and their number on 1 January 1970."""
_DAY = 86400.0
_DATE = re.compile(r"(\d{1,4})([./-])(\d{1,2})\2(\d{1,4})(?:$|[T ,;]+)")
_NAMED = re.compile(r"(\d{1,2})([ ./-])([A-Za-z]{3,9})\.?\2(\d{4}|\d{2})(?=$|[T ,;:])")
_MONTHS = (
    "january",
    "february",
    "march",
    "april",
    "may",
    "june",
    "july",
    "august",
    "september",
    "october",
    "november",
    "december",
)
_COMPACT = re.compile(r"(\d{4})(\d{2})(\d{2})(?:$|[T _-]+)")
_CLOCK = re.compile(r"T?(\d{1,3}):(\d{1,2})(?::(\d{1,2})(?:[.,:](\d{1,9}))?)?\s*([AaPp])?\.?[Mm]?\.?")
_COMPACT_CLOCK = re.compile(r"T?\d{6}([.,]\d+)?")
_ZONE = re.compile(r"\s*(?:(Z|UTC|GMT)|(?:UTC|GMT)?\s*([+-])(\d{1,2}):?(\d{2})?)$", re.IGNORECASE)
_HALF_DAY = 43200.0
_ISO = len("2026-05-02T07:11")
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_FEWEST_REPEATS = 2.0
_WIDTHS = {"Y": 4, "f": 6, "j": 3}


@dataclass(frozen=True, slots=True)
class Reading:
    """How instants are written.

    Attributes
    ----------
    format
        As strptime reads it, one of ``EPOCHS`` or ``SERIALS``; None: recognised.
    zone
        Zone of instants that name none.
    day_first
        Whether 02/05/2026 is in May; None: only where it can be nothing else.
    spread
        Whether instants that repeat are spread over the step to the next; None: where most of them repeat.
    """

    format: str | None = None
    zone: tzinfo | None = None
    day_first: bool | None = None
    spread: bool | None = None


@dataclass(slots=True)
class Instants:
    """Seconds of samples, shape (n,), NaN where there is none, and what they count from.

    Attributes
    ----------
    seconds
        Since 1970 UTC where ``dated``, else since midnight.
    dated
        Whether there is a date.
    faults, flags
        Instants that cannot be read, and what was mended.
    """

    seconds: Samples
    dated: bool
    faults: list[Fault]
    flags: list[str]


class _UnreadableError(ValueError):
    """A cell that is no instant; its text says why."""


def instants_of(columns: Sequence[Sequence[Any] | Samples], reading: Reading, where: str) -> Instants:
    """Instants from columns of texts or numbers, whose cells are joined with a blank row by row.

    Parameters
    ----------
    columns
        One to three, n cells each; None and NaN are missing.
    reading
        How they are written.
    where
        What faults call the place.
    """
    if reading.format in EPOCHS or reading.format in SERIALS:
        return _counted(columns[0], reading)
    texts = _joined(columns, reading.format)
    faults: list[Fault] = []
    known: dict[str, tuple[float, bool, bool]] = {}
    bad: dict[str, str] = {}
    seconds = np.full(len(texts), math.nan)
    n_bad = n_dated = n_plain = 0
    parse = _parser(reading)
    for i, text in enumerate(texts):
        if text is None or text in bad:
            n_bad += text is not None
            continue
        if text not in known:
            try:
                known[text] = parse(text)
            except ValueError as problem:
                bad[text] = str(problem)
                n_bad += 1
                if len(bad) <= MOST_FAULTS_OF_A_KIND:
                    faults.append(Fault(f"{where}[{i}]", str(problem)))
                continue
        seconds[i], dated, aware = known[text]
        n_dated += dated
        n_plain += dated and not aware
    faults = capped(faults, n_bad - len(faults), "samples are no instants", where)
    n_read = int(np.isfinite(seconds).sum())
    if n_plain and reading.zone is None:
        faults.append(Fault(where, "holds instants without a zone: say the `zone` of the mapping's time, e.g. UTC"))
    found = Instants(seconds, n_dated > 0, faults, [])
    if 0 < n_dated < n_read:
        found.faults.append(Fault(where, f"{n_read - n_dated} of {n_read} samples have no date"))
    _local(found, n_plain, reading)
    return _mended(found, reading)


def _counted(column: Sequence[Any] | Samples, reading: Reading) -> Instants:
    """Instants from counts of seconds or days."""
    numbers = np.array([_number(cell) for cell in column], dtype=np.float64)
    if reading.format in EPOCHS:
        return _mended(Instants(numbers * EPOCHS[reading.format], True, [], []), reading)
    seconds = (numbers - SERIALS[str(reading.format)]) * _DAY
    found = Instants(np.round(seconds, 4), True, [], [])  # a serial of days resolves some 10 us
    if reading.zone is None:
        found.faults.append(
            Fault("time", "counts days of a local time: say the `zone` of the mapping's time, e.g. UTC")
        )
    _local(found, len(numbers), reading)
    return _mended(found, reading)


def _number(cell: Any) -> float:
    try:
        return math.nan if cell is None else float(cell)
    except ValueError:
        return math.nan


def _joined(columns: Sequence[Sequence[Any] | Samples], form: str | None) -> list[str | None]:
    """Cells of a row as one text; numbers as digits, as many as the format's part has."""
    parts = form.split(" ") if form is not None and len(columns) > 1 else [form] * len(columns)
    wanted = [_width(part) for part in (*parts, *[None] * len(columns))]
    texts = [[_text(cell, wanted[k]) for cell in column] for k, column in enumerate(columns)]
    return [
        None if any(cell is None for cell in row) else " ".join(str(cell) for cell in row)
        for row in zip(*texts, strict=True)
    ]


def _text(cell: Any, width: int) -> str | None:
    if cell is None or isinstance(cell, str):
        return (cell or "").strip() or None
    if not math.isfinite(cell):
        return None
    whole = float(cell).is_integer()
    return str(int(cell)).zfill(width) if whole else f"{cell:.6f}".zfill(width + 7 if width else 0)


def _width(form: str | None) -> int:
    """Digits of what a format writes; 0 without one."""
    if form is None or not re.fullmatch(r"(%[A-Za-z])+", form):
        return 0
    return sum(_WIDTHS.get(c, 2) for c in form.replace("%", ""))


def _parser(reading: Reading) -> Callable[[str], tuple[float, bool, bool]]:
    """Function from text to seconds, whether it has a date, and whether it names its zone."""
    form = reading.format
    if form is None:
        return lambda text: _recognised(text, reading.day_first)
    dated = any(f"%{c}" in form for c in "YymdbBjcxDGu")

    def formatted(text: str) -> tuple[float, bool, bool]:
        try:
            found = datetime.strptime(text, form)  # noqa: DTZ007 - its zone is asked for below
        except ValueError:
            raise _UnreadableError(f"{text[:40]!r} is not written as {form}") from None
        aware = found.tzinfo is not None
        if not dated:
            return (found.replace(tzinfo=None) - datetime(1900, 1, 1)).total_seconds(), False, False  # noqa: DTZ001
        return (found if aware else found.replace(tzinfo=UTC)).timestamp(), True, aware

    return formatted


@lru_cache(maxsize=4096)
def _date_of(text: str, day_first: bool | None) -> tuple[datetime, int] | None:
    """Date at the start of a text, and where it ends; None without one.

    Raises
    ------
    ValueError
        for a date that is none, or may be two.
    """
    found = _DATE.match(text)
    named = _NAMED.match(text)
    if named is not None:
        month = _month(named[3], text)
        year, day = int(named[4]) + (2000 if len(named[4]) == 2 else 0), int(named[1])
        end = named.end()
    elif found is None:
        compact = _COMPACT.match(text)
        if compact is None:
            return None
        year, month, day = (int(part) for part in compact.groups())
        end = compact.end()
    else:
        first, _, second, third = found.groups()
        end = found.end()
        if len(first) == 4:
            year, month, day = int(first), int(second), int(third)
        else:
            year = int(third) + (2000 if len(third) <= 2 else 0)
            day, month = int(first), int(second)
            swapped = day <= 12 < month
            if found[2] == "." or day > 12 or swapped or day == month or day_first is not None:
                if swapped or (day_first is False and day <= 12 and found[2] != "."):
                    day, month = month, day
            else:
                raise _UnreadableError(f"{text[:40]!r} may be two dates: say `day_first` or a `format`")
    try:
        return datetime(year, month, day, tzinfo=UTC), end
    except ValueError:
        raise _UnreadableError(f"{text[:40]!r} is not in the calendar") from None


def _month(name: str, text: str) -> int:
    """Number of a month by its English name, or the beginning of it."""
    found = [i for i, month in enumerate(_MONTHS, 1) if month.startswith(name.lower())]
    if len(found) != 1:
        raise _UnreadableError(f"{text[:40]!r} names no month in English: say its `format`")
    return found[0]


def _recognised(text: str, day_first: bool | None) -> tuple[float, bool, bool]:
    """An instant or a time of day as most exports write it."""
    if len(text) >= _ISO and text[4] == "-" and text[13] == ":":  # the usual form, many times as quick
        try:
            found = datetime.fromisoformat(text)
        except ValueError:
            pass
        else:
            aware = found.tzinfo is not None
            since = found - (_EPOCH if aware else _EPOCH.replace(tzinfo=None))
            return since.total_seconds(), True, aware
    zone = _ZONE.search(text)
    rest = text
    offset = 0.0
    if zone and (zone[1] or ":" in text[: zone.start()]):
        rest = text[: zone.start()].rstrip()
        sign = -1.0 if zone[2] == "-" else 1.0
        offset = 0.0 if zone[1] else sign * (3600.0 * int(zone[3]) + 60.0 * int(zone[4] or 0))
    else:
        zone = None
    date = _date_of(rest, day_first) if ":" not in rest[:4] else None
    clock = rest[date[1] :].strip() if date else rest
    seconds = _clock(clock) if clock or date is None else 0.0
    if date is None:
        return seconds - offset, False, False
    return date[0].timestamp() + seconds - offset, True, zone is not None


def _clock(text: str) -> float:
    if _COMPACT_CLOCK.fullmatch(text):  # ISO's basic form
        text = f"{text.lstrip('T')[:2]}:{text.lstrip('T')[2:4]}:{text.lstrip('T')[4:]}"
    found = _CLOCK.fullmatch(text)
    if found is None:
        raise _UnreadableError(f"{text[:40]!r} is no instant like 2026-05-02 07:11:00 or 07:11:00.5: say its `format`")
    hours, minutes, seconds = int(found[1]), int(found[2]), float(found[3] or 0)
    if found[4]:
        seconds += int(found[4]) / 10.0 ** len(found[4])
    if found[5]:
        hours = hours % 12 + (12 if found[5] in "Pp" else 0)
    if minutes >= 60 or seconds > 60.0:
        raise _UnreadableError(f"{text[:40]!r} is no time of day")
    return 3600.0 * hours + 60.0 * minutes + seconds


def _local(found: Instants, n_plain: int, reading: Reading) -> None:
    """Instants of a local time brought to UTC; over a change of the clock the later ones take the later offset."""
    if reading.zone is None or n_plain == 0 or not found.dated:
        return
    known = np.flatnonzero(np.isfinite(found.seconds))
    if not len(known):
        return
    ends = {_offset(found.seconds[i], reading.zone, 0) for i in (known[0], known[-1])}
    ends |= {_offset(found.seconds[known[0]], reading.zone, 1)}
    if len(ends) == 1:
        found.seconds = found.seconds - ends.pop()
        return
    fold = 0
    before = -math.inf
    for i in known:
        local = found.seconds[i]
        fold = 1 if local < before - 1800.0 else fold
        before = local
        found.seconds[i] = local - _offset(local, reading.zone, fold)


def _offset(local: float, zone: tzinfo, fold: int) -> float:
    """Offset of a zone at a local time [s]."""
    if isinstance(zone, timezone):
        return (zone.utcoffset(None) or timedelta()).total_seconds()
    try:
        at = datetime(1970, 1, 1) + timedelta(seconds=local)  # noqa: DTZ001 - local by its meaning
    except OverflowError:
        return 0.0
    return (at.replace(tzinfo=zone, fold=fold).utcoffset() or timedelta()).total_seconds()


def _mended(found: Instants, reading: Reading) -> Instants:
    """Midnight passed and repeats spread."""
    known = np.flatnonzero(np.isfinite(found.seconds))
    if len(known) < 2:
        return found
    seconds = found.seconds[known]
    nights = np.flatnonzero(np.diff(seconds) < -_HALF_DAY)
    same_day = not found.dated or math.ceil(np.ptp(seconds) / _DAY) <= 1
    if len(nights) and same_day:
        days = np.zeros(len(seconds))
        days[nights + 1] = _DAY
        seconds = seconds + np.cumsum(days)
        found.flags.append(f"the clock passes midnight {len(nights)} time(s): the time goes on")
    starts = np.flatnonzero(np.diff(seconds, prepend=-math.inf) != 0.0)
    lengths = np.diff(starts, append=len(seconds))
    if reading.spread is not False and len(starts) > 1:
        inner = lengths[1:-1] if len(lengths) > 2 else lengths
        usual = float(np.median(inner))
        if usual >= _FEWEST_REPEATS or reading.spread:
            seconds = spread(seconds)
            if usual >= _FEWEST_REPEATS:
                text = f"instants repeat {usual:g} times: samples are spread evenly over the step to the next instant"
                found.flags.append(text)
    found.seconds = found.seconds.copy()
    found.seconds[known] = seconds
    return found


def spread(seconds: Samples) -> Samples:
    """Samples of equal instants [s] spread over the step; the first run may have begun late, the last may end early."""
    starts = np.flatnonzero(np.diff(seconds, prepend=-math.inf) != 0.0)
    lengths = np.diff(starts, append=len(seconds))
    usual = float(np.median(lengths[1:-1] if len(lengths) > 2 else lengths))
    stamps = seconds[starts]
    positive = np.diff(stamps)[np.diff(stamps) > 0.0]
    step = float(np.median(positive)) if len(positive) else 0.0
    run = np.repeat(np.arange(len(starts)), lengths)
    within = np.arange(len(seconds)) - starts[run]
    full = np.maximum(lengths.astype(np.float64), 1.0)
    full[-1] = max(full[-1], usual)
    late = np.zeros(len(starts))
    if full[0] < usual:
        late[0], full[0] = usual - full[0], usual
    return np.asarray(seconds + step * (within + late[run]) / full[run])
