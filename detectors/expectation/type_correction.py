"""A healthy curve measured on a bench stands in for the nominal twin: what it takes off a window's case pressure.

Flights are judged at zero demand. Of the measured points those of zero demand count: of all points near one
temperature and speed the ones of highest discharge pressure, for every demand costs some. Discharge pressures stay as
they are: the setting of the pump on the bench is its own, not its type's.
"""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from detectors.expectation.reference_curve import OutsideRange, ReferenceCurve, Regressor, fit_reference
from twin.condition import Condition, Health, input_rows
from twin.operating_point import operating_points
from twin.parameters import Circuit, Pump, PumpType
from twin.units import KELVIN_AT_0_DEGC

Array = NDArray[np.float64]

_TEMPERATURE, _SPEED = "fluid_temperature_degc", "speed_rpm"
REGRESSORS = (
    Regressor(_TEMPERATURE, "degC", scale=20.0, margin=5.0, degree=2, gap=15.0),
    Regressor(_SPEED, "rpm", scale=300.0, margin=150.0),
)
"""What the difference to the twin follows, and how far beyond and between the points it is believed."""
REPEATABILITY_BAR = 0.01
"""Estimate: scatter of one pump's case pressure between bench points of the same condition."""
DEPARTURE_BAR = 0.15
"""Estimate: what a type's twin may miss of the case pressure; some 40 % of its rise at zero flow and 50 degC."""
WARMING_MARGIN = 1.0
"""How much faster than at the measured points the fluid may warm [K/min] (estimate: a probe and a pump that lag by a minute
are then off by 1 K, twice what steady windows are)."""
WARMING = "warming_k_per_min"
NEAR_K, NEAR_RPM = 5.0, 100.0
"""Points this near are of one condition: the demand is all that their discharge pressures differ by."""
SAME_DEMAND_BAR = 0.1
"""Estimate: what discharge pressure repeats to; half a litre a minute costs half of it."""
_FEWEST_POINTS = 2
"""Points that a measured curve needs to say where it reaches: two ends."""


class HealthyPoint(NamedTuple):
    """One healthy point measured at an unknown demand; pressures gauge, NaN where the type lacks the channel.

    ``warming_k_per_min`` is how fast the fluid warmed meanwhile.
    """

    discharge_pressure_bar: float
    case_minus_reservoir_bar: float
    fluid_temperature_degc: float
    speed_rpm: float
    warming_k_per_min: float = 0.0

    @property
    def order(self) -> tuple[float, ...]:
        """What points are sorted by: not-a-number comes first."""
        return tuple(-math.inf if math.isnan(x) else float(x) for x in self)


@dataclass(frozen=True, slots=True)
class HealthyCurve:
    """Healthy points of a pump type, as measured."""

    points: tuple[HealthyPoint, ...]

    @property
    def version(self) -> str:
        """Name of exactly these points, e.g. ``curve-5f3c09ab``; the same on every machine and in any order."""
        # a point that was measured steadily is named as it was before anybody asked
        kept = (p[:-1] if p.warming_k_per_min == 0.0 else p for p in self.sorted)
        text = ";".join(",".join(repr(float(x)) for x in point) for point in kept)
        return f"curve-{hashlib.sha256(text.encode()).hexdigest()[:8]}"

    @property
    def sorted(self) -> tuple[HealthyPoint, ...]:
        """The points in an order of their own: the one in which they were entered decides nothing."""
        return tuple(sorted(self.points, key=lambda p: p.order))

    def filled(self, pump: PumpType) -> "HealthyCurve":
        """The curve with the conditions that stand in where the type's records lack them (``detectors.reduction.declared``)."""
        temperature = pump.limits["reference_temperature_k"].value - KELVIN_AT_0_DEGC
        return HealthyCurve(
            tuple(
                p._replace(
                    fluid_temperature_degc=temperature
                    if math.isnan(p.fluid_temperature_degc)
                    else p.fluid_temperature_degc,
                    speed_rpm=pump.nominal_speed_rpm if math.isnan(p.speed_rpm) else p.speed_rpm,
                )
                for p in self.points
            )
        )

    def too_fast(self, warming_k_per_min: float | None) -> bool:
        """Whether the fluid warms, or cools, faster than at any point of the curve."""
        if warming_k_per_min is None:
            return False
        rates = [p.warming_k_per_min for p in self.points]
        return not min(rates) - WARMING_MARGIN <= warming_k_per_min <= max(rates) + WARMING_MARGIN


@dataclass(frozen=True, slots=True)
class Correction:
    """What the measured curve lies above the nominal twin at a window's condition, with its own one-sigma [bar].

    ``outside`` names every quantity by which the window lies outside the curve's range; the twin stays then.
    ``discharge_sd_bar`` is the error of a curve that stands in for a twin at discharge pressure too.
    """

    case_bar: float = 0.0
    standard_deviation_bar: float = 0.0
    outside: tuple[str, ...] = ()
    discharge_sd_bar: float = 0.0


def corrections(
    curve: HealthyCurve | None,
    conditions: Sequence[Condition],
    pump: PumpType,
    circuit: Circuit,
    warming: Sequence[float | None] = (),
) -> list[Correction]:
    """Corrections of many windows at once.

    Parameters
    ----------
    curve
        None corrects nothing.
    conditions
        Where the windows were taken, length n.
    pump, circuit
        What the twin is told. The curve stands in for the twin in this circuit: it holds for circuits such as the
        one that it was measured in.
    warming
        How fast the fluid warmed in each window [K/min], length n; None, or nothing at all, where that is not known.
    """
    if curve is None or "case_pressure_bar" in pump.lacks:
        return [Correction()] * len(conditions)
    fitted = _fitted(curve.filled(pump), pump.pump, circuit, pump.nominal_reservoir_pressure_bar)
    if fitted is None:
        return [Correction(outside=("the twin cannot follow the measured points",))] * len(conditions)
    rates = [*warming, *[None] * (len(conditions) - len(warming))]
    return [
        Correction(outside=(WARMING,)) if curve.too_fast(rate) else _correction(fitted, condition)
        for condition, rate in zip(conditions, rates, strict=True)
    ]


def followed(curve: HealthyCurve, pump: PumpType, circuit: Circuit) -> NDArray[np.bool_]:
    """Where the twin has a solution at the measured speed and temperature, shape (n points,)."""
    return np.isfinite(_twin(curve.points, pump.pump, circuit, pump.nominal_reservoir_pressure_bar)[0])


def _correction(fitted: ReferenceCurve, condition: Condition) -> Correction:
    asked = {_TEMPERATURE: condition.fluid_temperature_degc, _SPEED: condition.speed_rpm}
    reference = fitted.at(asked)
    if isinstance(reference, OutsideRange):
        return Correction(outside=tuple(name for name in asked if any(r.startswith(name) for r in reference.reasons)))
    return Correction(reference.mean, reference.standard_deviation)


@lru_cache(maxsize=64)
def _fitted(curve: HealthyCurve, pump: Pump, circuit: Circuit, reservoir_bar: float) -> ReferenceCurve | None:
    """Measured minus twin at zero demand; None where the twin follows too few points."""
    # the order in which points were entered decides nothing
    points = curve.sorted
    discharge, case = _twin(points, pump, circuit, reservoir_bar)
    values = np.array([(p.fluid_temperature_degc, p.speed_rpm) for p in points])
    # a type without the channel measures its curve at zero demand
    excess = np.array([p.discharge_pressure_bar for p in points]) - discharge
    excess[np.isnan([p.discharge_pressure_bar for p in points])] = 0.0
    difference = np.array([p.case_minus_reservoir_bar for p in points]) - case
    counts = _without_demand(values, excess)
    if counts.sum() < _FEWEST_POINTS:
        return None
    return fit_reference(
        REGRESSORS,
        values[counts],
        difference[counts],
        repeatability=REPEATABILITY_BAR,
        departure=DEPARTURE_BAR,
        # the twin is taken off already: few points fall back on it
        shape=_no_difference,
    )


def _without_demand(values: Array, excess: Array) -> NDArray[np.bool_]:
    """Points that no near one exceeds in discharge pressure over the twin's, shape (n,)."""
    counts = np.zeros(len(excess), dtype=np.bool_)
    for i in np.flatnonzero(np.isfinite(excess)):
        near = (np.abs(values - values[i]) <= (NEAR_K, NEAR_RPM)).all(axis=1)
        counts[i] = excess[i] >= np.nanmax(excess[near]) - SAME_DEMAND_BAR
    return counts


def _no_difference(values: Array) -> Array:
    return np.zeros(len(values))


def _twin(points: Sequence[HealthyPoint], pump: Pump, circuit: Circuit, reservoir_bar: float) -> tuple[Array, Array]:
    """Discharge and case-minus-reservoir pressure of the nominal twin at zero demand [bar]; NaN without a solution."""
    conditions = [Condition(p.speed_rpm, p.fluid_temperature_degc, reservoir_bar) for p in points]
    solved = operating_points(pump, input_rows(conditions, [Health()] * len(points)), circuit)
    good = solved.status == 0
    return (
        np.where(good, solved.value("discharge_pressure_bar"), np.nan),
        np.where(good, solved.value("case_pressure_bar") - reservoir_bar, np.nan),
    )
