"""Units at the edge: from a foreign unit to the one in a channel's name."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import pint
from numpy.typing import NDArray

from service.ingest.unit_words import near, suffix_of, word

_UNITS_OF_SUFFIX = {"s": "second", "bar": "bar", "rpm": "revolution / minute", "degc": "degC", "lpm": "liter / minute"}


@dataclass(frozen=True, slots=True)
class Conversion:
    """Straight line between two units: ``ours = slope * foreign + intercept``; reference if the unit names one."""

    slope: float
    intercept: float
    reference: str | None = None

    def applied(self, samples: NDArray[np.float64]) -> NDArray[np.float64]:
        """Samples in our unit, same shape."""
        return samples * self.slope + self.intercept


@lru_cache(maxsize=1)
def _registry() -> Any:
    return pint.UnitRegistry(autoconvert_offset_to_baseunit=False, cache_folder=None)


@lru_cache(maxsize=1024)
def conversion(unit: str | None, channel: str) -> Conversion:
    """Conversion from a unit to that of a channel; None is the channel's own unit.

    Words as exports print them come first, then whatever the registry of units can read ("kilonewton / cm**2").

    Raises
    ------
    ValueError
        when there is no such unit, or it measures something else than the channel; with words that may be meant.
    """
    if unit is None:
        return Conversion(1.0, 0.0)
    known = word(unit, channel)
    if known is not None:
        return Conversion(known.slope, known.intercept, known.reference)
    registry = _registry()
    ours = registry.Unit(_UNITS_OF_SUFFIX.get(suffix_of(channel), "dimensionless"))
    try:
        foreign = registry.Unit(unit.strip())
        if channel.endswith("_rpm") and "radian" not in str(foreign) and "degree" not in str(foreign):
            # what a shaft does in a time is a revolution; the registry takes a hertz for a radian per second
            foreign = foreign if _turns(str(foreign)) else foreign * registry.revolution
        # two points fix the line, whether or not the unit's zero is elsewhere
        zero, one = (float(registry.Quantity(x, foreign).to(ours).magnitude) for x in (0.0, 1.0))
    except pint.DimensionalityError:
        raise ValueError(f"{unit!r} cannot become the unit of {channel}: {near(unit, channel)}") from None
    except Exception:  # the unit parser meets free text and fails in many ways
        raise ValueError(f"there is no unit {unit!r} for {channel}: {near(unit, channel)}") from None
    return Conversion(one - zero, zero, reference=None)


def _turns(unit: str) -> bool:
    return any(name in unit for name in ("revolution", "turn", "cycle", "grade", "steradian"))
