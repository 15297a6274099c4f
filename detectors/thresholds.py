"""The numbers that an operator may set, each with unit, range and meaning."""

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ThresholdKey:
    """One adjustable number: default with its allowed range (both ends included)."""

    name: str
    unit: str
    default: float
    low: float
    high: float
    meaning: str


KEYS: tuple[ThresholdKey, ...] = ()


def effective(values: Mapping[str, float]) -> dict[str, float]:
    """All thresholds with ``values`` laid over the defaults.

    Raises
    ------
    ValueError
        naming every unknown key and every value outside its range.
    """
    by_name = {key.name: key for key in KEYS}
    faults = []
    for name, value in values.items():
        key = by_name.get(name)
        if key is None:
            faults.append(f"{name}: no such threshold")
        elif not key.low <= value <= key.high:
            faults.append(f"{name}: {value:g} {key.unit} is outside {key.low:g} to {key.high:g} {key.unit}")
    if faults:
        raise ValueError("; ".join(faults))
    return {key.name: float(values.get(key.name, key.default)) for key in KEYS}
