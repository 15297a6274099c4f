"""Case pressure beyond this pump's reference, over fluid temperature, with the laws that could explain it.

From one temperature a leak of the pump and a restricted drain are the same. They part where the fluid gets warm: a leak
grows as viscosity falls, what resists in the drain falls with it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from detectors.bank.hypotheses import FAULT_KINDS
from detectors.curve.sights import Sight, amplitude_of, moved, size_of
from detectors.expectation.anchor import anchors
from detectors.words.states import State
from twin.condition import Condition
from twin.parameters import Circuit, PumpType

Array = NDArray[np.float64]

NEWEST = 12
"""Records that a law is laid through (our choice: enough to see past one flight's error, few enough not to smear growth)."""
FEWEST = 4
"""Records below which no law is drawn."""
STANDS_OUT = 4.0
"""Standard errors that the newest records must lie beside the reference by, together, before a law is asked for."""
_STEPS = 8
_TRIED = 0.05
_MARGIN_K, _N_TEMPERATURES = 4.0, 13
LARGEST: Mapping[State, float] = {
    State.PUMP_DEGRADATION: 4.0,
    State.SYSTEM_LEAKAGE: 12.0,
    State.DRAIN_RESTRICTION: 20.0,
}
"""Faults that lift the case pressure, with the largest size that is sought [L/min; share of the resistance]."""


@dataclass(frozen=True, slots=True)
class Excess:
    """One record's case pressure beyond this pump's reference at the record's own condition [bar].

    ``fitted`` says whether the laws were laid through it: the newest, where the reservoir's pressure is known.
    """

    at: datetime
    fluid_temperature_degc: float
    residual: float
    standard_deviation: float
    fitted: bool


@dataclass(frozen=True, slots=True)
class Law:
    """What one fault would add to the case pressure over temperature, of the size that fits the records best.

    ``curve`` holds pairs of fluid temperature [degC] and pressure [bar]; ``misfit`` is the root of the mean square by which
    it misses the fitted records, in their standard deviations.
    """

    size: float
    unit: str
    misfit: float
    curve: tuple[tuple[float, float], ...]


def laws_through(
    excess: Sequence[Excess], sight: Sight, pump: PumpType, circuit: Circuit, condition: Condition
) -> dict[str, Law]:
    """Laws of leaks and drain through the newest records, by state: the judge's first kind of each stands for it.

    None where the records do not stand out, or where it would have to be larger than it can be.

    Parameters
    ----------
    excess
        Records in event order.
    sight, pump, circuit
        Whose reference the fault would come on top of.
    condition
        Speed and reservoir pressure at which the laws are drawn.
    """
    fitted = [e for e in excess if e.fitted]
    if len(fitted) < FEWEST:
        return {}
    values = np.array([e.residual for e in fitted])
    weights = np.array([e.standard_deviation for e in fitted]) ** -2.0
    if weights @ values < STANDS_OUT * np.sqrt(weights.sum()):
        return {}
    at = np.array([e.fluid_temperature_degc for e in fitted])
    every = [e.fluid_temperature_degc for e in excess]
    grid = np.linspace(min(every) - _MARGIN_K, max(every) + _MARGIN_K, _N_TEMPERATURES)
    temperatures = np.concatenate((at, grid))
    rows, solved = anchors([condition._replace(fluid_temperature_degc=float(t)) for t in temperatures], pump, circuit)
    if not solved[: len(at)].all():
        return {}
    found: dict[str, Law] = {}
    for k, kind in enumerate(FAULT_KINDS):
        if kind.state not in LARGEST or kind.state.value in found:
            continue
        largest = amplitude_of(kind, LARGEST[kind.state])
        amplitude = _amplitude(sight, rows[: len(at)], k, values, weights, largest)
        if amplitude >= largest:
            continue
        drawn = tuple(
            (float(t), float(moved(sight, row, k, amplitude)[1]))
            for t, row, good in zip(grid, rows[len(at) :], solved[len(at) :], strict=True)
            if good
        )
        missed = values - _added(sight, rows[: len(at)], k, amplitude)
        size, unit = size_of(kind, amplitude), "L/min"
        if kind.state is State.DRAIN_RESTRICTION:
            size, unit = 100.0 * size, "%"
        misfit = float(np.sqrt(np.mean(weights * missed**2)))
        found[kind.state.value] = Law(size, unit, misfit, drawn)
    return found


def _amplitude(sight: Sight, rows: Array, kind: int, values: Array, weights: Array, largest: float) -> float:
    """Amplitude of least squares: Gauss-Newton, for no law is far from its slope."""
    amplitude = _TRIED
    for _ in range(_STEPS):
        here = _added(sight, rows, kind, amplitude)
        slope = (_added(sight, rows, kind, amplitude + _TRIED) - here) / _TRIED
        amplitude += float(weights * slope @ (values - here) / (weights * slope @ slope))
        amplitude = min(max(amplitude, 0.0), largest)
    return amplitude


def _added(sight: Sight, rows: Array, kind: int, amplitude: float) -> Array:
    return np.array([moved(sight, row, kind, amplitude)[1] for row in rows])
