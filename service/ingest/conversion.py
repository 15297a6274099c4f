"""Units at the edge: from a foreign unit to the one in a channel's name."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import pint
from numpy.typing import NDArray

_UNITS_OF_SUFFIX = {"s": "second", "bar": "bar", "rpm": "revolution / minute", "degc": "degC", "lpm": "liter / minute"}
_REFERENCED = {
    "psig": ("psi", "gauge"),
    "psia": ("psi", "absolute"),
    "barg": ("bar", "gauge"),
    "bara": ("bar", "absolute"),
}
_WRITTEN_OTHERWISE = {
    "%": "percent",
    "°c": "degC",
    "°f": "degF",
    "l/min": "liter / minute",
    "lpm": "liter / minute",
    "rpm": "revolution / minute",
    "gpm": "gallon / minute",
}


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

    Raises
    ------
    ValueError
        when there is no such unit, or it measures something else than the channel.
    """
    if unit is None:
        return Conversion(1.0, 0.0)
    registry = _registry()
    name, reference = _REFERENCED.get(unit.strip().lower(), (unit.strip(), None))
    ours = registry.Unit(_UNITS_OF_SUFFIX.get(channel.rsplit("_", 1)[1], "dimensionless"))
    try:
        foreign = registry.Unit(_WRITTEN_OTHERWISE.get(name.lower(), name))
        if channel.endswith("_rpm") and "hertz" in str(foreign):
            # a frequency of a shaft counts revolutions; the registry would take a hertz for a radian per second
            foreign = foreign * registry.revolution
        # two points fix the line, whether or not the unit's zero is elsewhere (degF, degC)
        zero, one = (float(registry.Quantity(x, foreign).to(ours).magnitude) for x in (0.0, 1.0))
    except pint.DimensionalityError:
        raise ValueError(f"{unit!r} cannot become the unit of {channel}") from None
    except Exception:  # the unit parser meets free text and fails in many ways
        raise ValueError(f"there is no unit {unit!r}") from None
    return Conversion(one - zero, zero, reference)
