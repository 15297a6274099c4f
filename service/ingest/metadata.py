"""Metadata of a flight record: what it must say, what it may say, and what is wrong with it."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

from service.errors import Fault
from service.ingest.names import clean_name, name_fault
from service.ingest.raw import METADATA
from twin.parameters import PumpType
from twin.pumps import PUMP_TYPES
from twin.units import STANDARD_ATMOSPHERE_BAR

TypeLookup = Callable[[str | None, str], PumpType | None]
"""Pump type that (operator, name) means; None where there is none."""
TEXTS_REQUIRED = ("pump_serial", "aircraft", "position", "flight_id")
TEXTS_OPTIONAL = ("segment", "pump_type", "operator")
KNOWN = METADATA
_HALVES = range(0xD800, 0xE000)
"""Halves of surrogate pairs: no text, no database and no answer can hold one."""
_LARGEST_WHOLE = 2.0**53
"""Up to here a float holds every whole number exactly."""
EARLIEST = datetime(2001, 1, 1, tzinfo=UTC)
"""No record is older (our choice: years before the first of these pumps flew). A recorder whose clock has lost its
battery begins again in 1970, 1980 or 2000."""
CLOCK_TOLERANCE = timedelta(days=1)
"""A wrong zone shifts by up to 14 h; a record that is later than this cannot have been flown yet."""


def built_in(_operator: str | None, name: str) -> PumpType | None:
    """The twin's own parameter sets alone."""
    return PUMP_TYPES.get(name)


@dataclass(frozen=True, slots=True)
class RecordMetadata:
    """Checked metadata of one record; pressures of the record are relative to ``ambient_pressure_bar``."""

    pump_serial: str
    aircraft: str
    position: str
    flight_id: str
    started_at: datetime
    segment: str
    pump_type: str | None
    operator: str | None
    flight_hours: float | None
    pressure_reference: str
    ambient_pressure_bar: float
    foreign: Mapping[str, Any]


def checked_metadata(
    values: Mapping[str, Any],
    now: datetime | None = None,
    is_type: Callable[[str], bool] = PUMP_TYPES.__contains__,
    earliest: datetime | None = EARLIEST,
) -> tuple[RecordMetadata | None, list[Fault]]:
    """Metadata with every fault in it; None when there is any. ``now`` is the latest instant but for clocks' error.

    ``is_type`` tells whether a pump type is known; ``earliest`` is the first instant that can be, None for any.
    """
    faults: list[Fault] = []
    texts = {
        name: _text(name, values.get(name), name in TEXTS_REQUIRED, faults)
        for name in (*TEXTS_REQUIRED, *TEXTS_OPTIONAL)
    }
    if texts["pump_type"] and not is_type(texts["pump_type"]):
        faults.append(
            Fault("pump_type", f"{texts['pump_type']!r} is not known; known: {', '.join(sorted(PUMP_TYPES))}")
        )
    started_at = _instant(values.get("started_at"), earliest, now or datetime.now(UTC), faults)
    hours = _number("flight_hours", values.get("flight_hours"), 0.0, 1e6, faults)
    reference = str(values.get("pressure_reference") or "gauge")
    if reference not in ("gauge", "absolute"):
        faults.append(Fault("pressure_reference", f"{reference!r} is neither gauge nor absolute"))
    ambient = _number("ambient_pressure_bar", values.get("ambient_pressure_bar"), 0.2, 1.2, faults)
    if reference == "absolute" and ambient is None:
        faults.append(Fault("ambient_pressure_bar", "is needed when pressures are absolute"))
    if faults or started_at is None:
        return None, faults
    return RecordMetadata(
        pump_serial=texts["pump_serial"] or "",
        aircraft=texts["aircraft"] or "",
        position=texts["position"] or "",
        flight_id=texts["flight_id"] or "",
        started_at=started_at,
        segment=texts["segment"] or "",
        pump_type=texts["pump_type"],
        operator=texts["operator"],
        flight_hours=hours,
        pressure_reference=reference,
        ambient_pressure_bar=STANDARD_ATMOSPHERE_BAR if ambient is None else ambient,
        foreign={_storable(k): _storable(v) for k, v in values.items() if k not in KNOWN},
    ), []


def _storable(value: Any) -> Any:
    """A foreign value that every database can hold: what is no character becomes the replacement character."""
    if not isinstance(value, str):
        return value
    return "".join("\ufffd" if c == "\0" or ord(c) in _HALVES else c for c in value)


def _text(name: str, value: Any, required: bool, faults: list[Fault]) -> str | None:
    if value is None or (isinstance(value, str) and not value.strip()):
        if required:
            faults.append(Fault(name, "is missing"))
        return None
    text = _written(value)
    if text is None:
        kind = f"the number {value!r}" if isinstance(value, float) else f"a {type(value).__name__}"
        faults.append(Fault(name, f"is {kind}, not text"))
        return None
    text = clean_name(text)
    fault = name_fault(text)
    if fault is not None:
        faults.append(Fault(name, fault))
        return None
    return text


def _written(value: Any) -> str | None:
    """A text, or the digits of a whole number: some formats know no other numbers than floats. None for all else."""
    if isinstance(value, float) and value.is_integer() and abs(value) <= _LARGEST_WHOLE:
        value = int(value)
    return str(value) if isinstance(value, (str, int)) and not isinstance(value, bool) else None


def _instant(value: Any, earliest: datetime | None, now: datetime, faults: list[Fault]) -> datetime | None:
    if value is None or value == "":
        faults.append(Fault("started_at", "is missing"))
        return None
    try:
        instant = datetime.fromisoformat(str(value))
    except ValueError:
        faults.append(Fault("started_at", f"{str(value)[:40]!r} is not an instant like 2026-05-02T07:11:00Z"))
        return None
    if instant.tzinfo is None:
        faults.append(Fault("started_at", f"{value!r} has no time zone: write Z for UTC"))
        return None
    try:
        instant = instant.astimezone(UTC)
    except OverflowError:
        faults.append(Fault("started_at", f"{value!r} is outside the calendar"))
        return None
    if instant > now + CLOCK_TOLERANCE:
        text = f"{value!s} lies in the future: check the recorder's clock and the time zone"
        faults.append(Fault("started_at", text))
        return None
    if earliest is not None and instant < earliest:
        text = f"{value!s} lies before {earliest:%Y}, before any such record: the recorder's clock was lost"
        faults.append(Fault("started_at", text))
        return None
    return instant


def _number(name: str, value: Any, low: float, high: float, faults: list[Fault]) -> float | None:
    if value is None or value == "":
        return None
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not low <= number <= high:
        faults.append(Fault(name, f"{str(value)[:40]!r} is not a number between {low:g} and {high:g}"))
        return None
    return number
