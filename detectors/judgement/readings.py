"""What a record measured, as points of the trend, and what a sensor at its full scale is worth."""

from collections.abc import Mapping
from dataclasses import replace

from detectors.bank.measurement import Measured
from detectors.bank.prediction import CASE
from detectors.judgement.plausibility import SATURATED_BAR
from detectors.words.numbers import Z_90
from detectors.words.observation import Observation, Residual
from detectors.words.verdict import Estimate


def measured_trend(observation: Observation, residuals: Mapping[str, Residual]) -> dict[str, Estimate]:
    """Residuals, temperature and reservoir pressure of a record with their 90 % intervals, by metric."""
    trend = {}
    for name, residual in residuals.items():
        half = Z_90 * residual.standard_deviation
        metric = f"{name.removesuffix('_pressure_bar')}_residual_bar"
        trend[metric] = Estimate(residual.residual, residual.residual - half, residual.residual + half)
    window = observation.reduction.zero_flow
    for name in ("fluid_temperature_degc", "reservoir_pressure_bar"):
        mean = window.means.get(name) if window is not None else None
        if mean is not None:
            half = Z_90 * mean.standard_error
            trend[name] = Estimate(mean.mean, mean.mean - half, mean.mean + half)
    return trend


def lower_bound(found: Measured) -> Measured:
    """What a sensor at its full scale shows: at least that, give or take what a blocked drain may add."""
    *rest, last = found.measurements
    values, noise = last.values.copy(), last.noise.copy()
    above, sd = SATURATED_BAR
    values[CASE] += above
    noise[CASE, CASE] += sd**2
    return replace(found, measurements=(*rest, replace(last, values=values, noise=noise)))
