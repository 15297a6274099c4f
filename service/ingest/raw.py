"""What an adapter hands over before anything is checked: columns of numbers and texts, metadata of any kind."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from service.errors import Fault, TooLarge

METADATA = (
    "pump_serial",
    "aircraft",
    "position",
    "flight_id",
    "segment",
    "pump_type",
    "operator",
    "started_at",
    "flight_hours",
    "pressure_reference",
    "ambient_pressure_bar",
)
"""Metadata that mean something; any other is kept with the record."""
MOST_FAULTS_OF_A_KIND = 5
_BYTES_PER_SAMPLE = 8


@dataclass(frozen=True, slots=True)
class Limits:
    """How much one upload may hold."""

    inflated_bytes: int
    rows: int


@dataclass(frozen=True, slots=True)
class TextDialect:
    """How a text file writes its table; the defaults are those of the documented CSV."""

    delimiter: str = ","
    decimal: str = "."
    encoding: str = "utf-8"


@dataclass(frozen=True, slots=True)
class RawRecord:
    """Decoded content of a file.

    Attributes
    ----------
    metadata
        Keys and values as the file gives them.
    channels
        Name to samples as numbers, shape (n,) each but not yet of equal length; missing samples are NaN.
    faults
        What was wrong already in single cells, with the place of each.
    references
        ``gauge`` or ``absolute`` for those pressure channels whose reference is not the record's.
    """

    metadata: dict[str, Any]
    channels: dict[str, NDArray[np.float64]]
    faults: list[Fault] = field(default_factory=list)
    references: Mapping[str, str] = field(default_factory=dict)


def capped(faults: list[Fault], more: int, what: str, where: str) -> list[Fault]:
    """Faults of one kind, the first few by name and the rest as a count."""
    if more <= 0:
        return faults
    return [*faults, Fault(where, f"{more} more {what}")]


def check_size(n_rows: int, n_channels: int, limits: Limits) -> None:
    """Refuse a table by what its metadata say of its size, before any of it is decoded.

    Raises
    ------
    TooLarge
        naming the limit that it breaks.
    """
    if n_rows > limits.rows:
        raise TooLarge(f"the file has {n_rows} rows, more than {limits.rows}: split the record into segments")
    if n_rows * n_channels * _BYTES_PER_SAMPLE > limits.inflated_bytes:
        raise TooLarge(
            f"{n_rows} rows of {n_channels} channels inflate to more than {limits.inflated_bytes} bytes: "
            "leave out channels or split the record into segments"
        )


def plain(value: Any) -> Any:
    """Attribute of a binary file as a plain Python value; instants become RFC 3339 text in UTC."""
    if isinstance(value, bytes):
        return value.decode(errors="replace")
    if isinstance(value, np.datetime64):
        return f"{np.datetime_as_string(value, unit='us')}Z"
    if isinstance(value, np.ndarray):
        return plain(value.reshape(-1)[0]) if value.size == 1 else str(value.tolist())[:1000]
    return value.item() if isinstance(value, np.generic) else value
