"""The pure fold: from a pump's history to its verdicts, one per observation in event order."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np

from detectors import wording
from detectors.estimates import estimates, laminar_ratio, nominal_leakage_lpm, probability_above
from detectors.filter_bank import (
    SPAWN_EVERY,
    Bank,
    Measurement,
    new_bank,
    updated,
    with_growth,
    with_onsets,
    with_reset,
)
from detectors.isolation import Alarm, Decision, decided, evidence
from detectors.observation import History, Maintenance, Observation, Window
from detectors.residuals import (
    TEMPERATURE_SD_K,
    case_noise_sd,
    discharge_noise_sd,
    matching_condition,
    reservoir_noise_sd,
    window_residuals,
)
from detectors.state_model import Scene
from detectors.verdict import SIDE_OF, UNINFORMED, Assessment, Estimate, Quality, Side, State, Verdict
from twin.condition import Health
from twin.operating_point import operating_point
from twin.parameters import Circuit, PumpType

MAINTENANCE_RESETS: Mapping[str, tuple[str, ...]] = {
    "fluid_changed": ("ln_leakage", "drain_viscosity_weight"),
    "filter_changed": ("ln_drain", "drain_flow_weight"),
    "setting_adjusted": ("setting_bar",),
    "sensor_replaced": ("case_offset_bar",),
}
"""Components of the state that each action makes unknown again."""
WORN_PROBABILITY = 0.95
WORN_MARGIN = 1.2
"""A pump is worn on sight when its case flow lies above the limit by this factor with that probability: drain
resistance and leakage of a new installation cannot be told apart any better (estimate)."""
_UNKNOWN_ZERO_VARIANCE = 1.0e6


@dataclass(frozen=True)
class _Progress:
    """What the fold carries from one observation to the next."""

    bank: Bank
    alarm: Alarm
    verdict: Verdict | None = None
    used: int = 0
    since_installed: int = 0
    rejected: int = 0
    without_zero: int = 0
    without_reservoir: int = 0


def assess(
    history: History, pump: PumpType, circuit: Circuit, thresholds: Mapping[str, float]
) -> tuple[Assessment, ...]:
    """Assess a pump's history.

    Parameters
    ----------
    history
        Observations in any order; they are taken by event time, then by record.
    pump, circuit
        What the twin is told; see ``twin.pumps``.
    thresholds
        Effective thresholds (``detectors.thresholds.effective``).

    Returns
    -------
    tuple of Assessment
        One per observation in event order; the same history in any order gives the same answer. A flight counts
        once: its main record where that has a zero-flow window, else its first segment that has one.
    """
    observations = sorted(history.observations, key=lambda o: (o.at, o.record_id))
    counted = _counted(observations)
    leakage = nominal_leakage_lpm(pump, circuit)
    progress = _Progress(new_bank(pump), Alarm())
    assessments = []
    previous: Observation | None = None
    for observation in observations:
        if previous is not None:
            progress = _between(progress, previous, observation, history, pump)
        previous = observation
        trend: dict[str, Estimate] = {}
        window = observation.reduction.zero_flow
        rejected = sum(not w.accepted for w in observation.reduction.windows)
        progress = replace(progress, rejected=progress.rejected + rejected)
        if window is not None and observation.record_id in counted:
            progress = _learned(progress, observation, window, pump, circuit, thresholds)
            trend = _measured_trend(observation, window, pump, circuit)
        progress, verdict = _concluded(progress, observation, pump, circuit, thresholds, leakage)
        if trend:
            known = {*verdict.minimum_detectable, "case_flow_at_reference_lpm"}
            trend |= {name: value for name, value in verdict.estimates.items() if name in known}
        assessments.append(Assessment(observation.record_id, observation.at, trend, verdict))
    return tuple(assessments)


def _counted(observations: list[Observation]) -> set[str]:
    """Records that stand for their flight."""
    best: dict[tuple[str, str, str], Observation] = {}
    for observation in observations:
        if observation.reduction.zero_flow is None:
            continue
        key = (observation.aircraft, observation.position, observation.flight_id)
        held = best.get(key)
        if held is None or (held.segment is not None and observation.segment is None):
            best[key] = observation
    return {o.record_id for o in best.values()}


def _between(
    progress: _Progress, previous: Observation, observation: Observation, history: History, pump: PumpType
) -> _Progress:
    """What happened between two records: an installation starts anew, maintenance resets what it touches."""
    moved = (previous.aircraft, previous.position) != (observation.aircraft, observation.position)
    if moved or any(previous.at < t <= observation.at for t in history.installed_at):
        return replace(progress, bank=new_bank(pump), alarm=Alarm(), since_installed=0)
    for event in _due(history.maintenance, previous.at, observation.at):
        bank = with_reset(progress.bank, MAINTENANCE_RESETS.get(event.action, ()), pump)
        progress = replace(progress, bank=bank)
    return progress


def _due(maintenance: tuple[Maintenance, ...], after: datetime, until: datetime) -> list[Maintenance]:
    return sorted((m for m in maintenance if after < m.at <= until), key=lambda m: (m.at, m.action))


def _learned(
    progress: _Progress,
    observation: Observation,
    window: Window,
    pump: PumpType,
    circuit: Circuit,
    thresholds: Mapping[str, float],
) -> _Progress:
    """Take one zero-flow window into the bank."""
    measurement = _measurement(observation, window, pump, circuit)
    if measurement is None:
        return progress
    bank = updated(progress.bank, measurement, pump, circuit)
    count = progress.since_installed + 1
    baseline = int(thresholds["baseline_records"])
    if count == baseline:
        bank = with_growth(bank)
    if count >= baseline and (count - baseline) % SPAWN_EVERY == 0:
        bank = with_onsets(bank)
    return replace(
        progress,
        bank=bank,
        used=progress.used + 1,
        since_installed=count,
        without_zero=progress.without_zero + (not observation.reduction.zero.measured),
        without_reservoir=progress.without_reservoir + ("reservoir_pressure_bar" not in window.means),
    )


def _measurement(observation: Observation, window: Window, pump: PumpType, circuit: Circuit) -> Measurement | None:
    """Three numbers of one window with their noise; None where the twin has no solution."""
    condition = matching_condition(window, pump)
    point = operating_point(pump.pump, condition, circuit, Health(), derivatives=True)
    if point.status[0] != 0:
        return None
    zero = observation.reduction.zero
    reservoir_measured = "reservoir_pressure_bar" in window.means
    # the zero is a measurement of its own, so the case pressure enters with its offset still in it
    values = np.array([window.means[c].mean for c in ("discharge_pressure_bar", "case_pressure_bar")] + [0.0])
    values[2] = zero.offset_bar if zero.measured else 0.0
    noise = np.diag([discharge_noise_sd(window, pump) ** 2, case_noise_sd(window, pump) ** 2, 0.0])
    noise[2, 2] = zero.standard_deviation_bar**2 if zero.measured else _UNKNOWN_ZERO_VARIANCE
    shared = [("fluid_temperature_degc", TEMPERATURE_SD_K)]
    if reservoir_measured:
        shared.append(("reservoir_pressure_bar", reservoir_noise_sd(window, pump)))
    for name, sd in shared:
        slope = np.array([point.derivative(o, name)[0] for o in ("discharge_pressure_bar", "case_pressure_bar")])
        noise[:2, :2] += sd**2 * np.outer(slope, slope)
    scene = Scene(np.array(condition), laminar_ratio(pump, condition.fluid_temperature_degc), reservoir_measured)
    return Measurement(values, noise, scene)


def _measured_trend(observation: Observation, window: Window, pump: PumpType, circuit: Circuit) -> dict[str, Estimate]:
    trend = {}
    residuals = window_residuals(window, observation.reduction.zero, pump, circuit)
    for name, residual in residuals.items():
        half = 1.645 * residual.standard_deviation
        metric = f"{name.removesuffix('_pressure_bar')}_residual_bar"
        trend[metric] = Estimate(residual.residual, residual.residual - half, residual.residual + half)
    for name in ("fluid_temperature_degc", "reservoir_pressure_bar"):
        mean = window.means.get(name)
        if mean is not None:
            half = 1.645 * mean.standard_error
            trend[name] = Estimate(mean.mean, mean.mean - half, mean.mean + half)
    return trend


def _concluded(
    progress: _Progress,
    observation: Observation,
    pump: PumpType,
    circuit: Circuit,
    thresholds: Mapping[str, float],
    leakage: float,
) -> tuple[_Progress, Verdict]:
    """The verdict after this observation; a record that taught nothing repeats the last one."""
    previous = progress.verdict
    found = evidence(progress.bank, thresholds)
    quality = _quality(progress)
    if previous is not None and previous.quality.records_used == progress.used and progress.since_installed > 0:
        verdict = replace(previous, quality=quality)
        return replace(progress, verdict=verdict), verdict
    values, smallest = estimates(progress.bank, found.weights, pump, circuit, leakage)
    limit = thresholds["case_flow_limit_lpm"]
    missing = int(thresholds["baseline_records"]) - progress.since_installed
    alarm, decision = progress.alarm, Decision(State.INSUFFICIENT_DATA)
    if missing <= 0:
        alarm, decision = decided(alarm, found, thresholds)
        worn = probability_above(values["case_flow_at_reference_lpm"], WORN_MARGIN * limit) > WORN_PROBABILITY
        if decision.state is State.HEALTHY and worn:
            decision = Decision(State.PUMP_DEGRADATION)
    since = observation.at
    if previous is not None and previous.state is decision.state and previous.since is not None:
        since = previous.since
    probabilities = UNINFORMED if decision.state is State.INSUFFICIENT_DATA else found.probabilities
    verdict = _verdict(decision, probabilities, values, smallest, quality, since, limit, max(missing, 0))
    return replace(progress, alarm=alarm, verdict=verdict), verdict


def _verdict(
    decision: Decision,
    probabilities: Mapping[State, float],
    values: Mapping[str, Estimate],
    smallest: Mapping[str, float],
    quality: Quality,
    since: datetime,
    limit: float,
    missing: int,
) -> Verdict:
    state = decision.state
    return Verdict(
        state=state,
        side=_side(decision),
        since=since,
        confidence=max(probabilities.values()),
        probabilities=probabilities,
        candidates=decision.candidates,
        secondary=None,
        sensor="case_pressure_bar" if state is State.SENSOR_FAULT else None,
        estimates=values,
        minimum_detectable=smallest,
        quality=quality,
        advice=wording.advice(state, decision.candidates, values, limit, missing),
        resolving_measurement=wording.resolving_measurement(decision.candidates),
    )


def _side(decision: Decision) -> Side:
    """Side of a state; for ``indeterminate`` the one its candidates share."""
    sides = {SIDE_OF[c] for c in decision.candidates}
    return sides.pop() if len(sides) == 1 else SIDE_OF[decision.state]


def _quality(progress: _Progress) -> Quality:
    used, flags = progress.used, []
    if progress.without_zero:
        flags.append(
            f"no pump-off zero in {progress.without_zero} of {used} records: "
            "the case sensor's offset is carried as unknown"
        )
    reservoir = "measured"
    if progress.without_reservoir:
        reservoir = "nominal" if progress.without_reservoir == used else "mixed"
        flags.append(
            f"reservoir pressure not measured in {progress.without_reservoir} of {used} records: "
            "leakage below about 0.6 L/min cannot be told from a change of reservoir pressure"
        )
    return Quality(used, progress.rejected, reservoir, tuple(flags))
