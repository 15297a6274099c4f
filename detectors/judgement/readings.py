"""What a record measured, as points of the trend, and what a sensor at its full scale is worth."""

from collections.abc import Mapping
from dataclasses import replace

from detectors.bank.measurement import Measured
from detectors.bank.prediction import CASE
from detectors.judgement.coverage import Coverage
from detectors.judgement.plausibility import SATURATED_BAR, Doubt
from detectors.words.numbers import Z_90
from detectors.words.observation import Observation, Residual
from detectors.words.verdict import Estimate, Quality
from twin.parameters import PumpType

_RESIDUALS = {"case_pressure_bar": "case_residual_bar", "discharge_pressure_bar": "discharge_residual_bar"}


def measured_trend(observation: Observation, residuals: Mapping[str, Residual]) -> dict[str, Estimate]:
    """Residuals, temperature and reservoir pressure of a record with their 90 % intervals, by metric."""
    trend = {}
    for name, residual in residuals.items():
        half = Z_90 * residual.standard_deviation
        trend[_RESIDUALS[name]] = Estimate(residual.residual, residual.residual - half, residual.residual + half)
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


def quality_of(
    pump: PumpType,
    records: tuple[int, int],
    coverage: Coverage,
    doubted: tuple[Doubt | None, int],
    outside_curve: Mapping[str, int],
) -> Quality:
    """What a verdict rests on, with a flag for everything that it misses, which no flag is where the pump type lacks it.

    Parameters
    ----------
    pump
        Type of the pump: which channels it lacks, and whether it has a twin of its own.
    records
        Records that taught something, and windows that were rejected.
    coverage
        What the records held.
    doubted
        Why the last records cannot be true, and how many they are.
    outside_curve
        Records outside the measured healthy curve, by the reason.
    """
    used, rejected = records
    flags = []
    without_zero, without_reservoir = used - coverage.zeros, used - coverage.reservoirs
    if without_zero and "case_pressure_bar" not in pump.lacks:
        flags.append(
            f"no pump-off zero in {without_zero} of {used} records: the case sensor's offset is carried as unknown"
        )
    reservoir = "measured"
    if without_reservoir:
        reservoir = "nominal" if without_reservoir == used else "mixed"
    if without_reservoir and not pump.reservoir_is_known:
        flags.append(
            f"reservoir pressure not measured in {without_reservoir} of {used} records: "
            "leakage below about 0.6 L/min cannot be told from a change of reservoir pressure"
        )
    doubtful, doubts = doubted
    if doubtful is not None:
        flags.append(
            f"{doubtful.channel} {doubtful.why}: the last {doubts} record(s) are no evidence for pump or circuit"
        )
    instead = "judged against the twin" if pump.own_twin else "not judged"
    looked_at = used + (0 if pump.own_twin else sum(outside_curve.values()))
    flags += [
        f"{n} of {looked_at} records outside the measured healthy curve ({why}): {instead}"
        for why, n in sorted(outside_curve.items())
    ]
    return Quality(used, rejected, reservoir, tuple(flags))
