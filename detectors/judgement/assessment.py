"""The pure fold: from a pump's history to its verdicts, one per observation in event order."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from detectors.bank.bank import FIRST_ONSETS, SPAWN_EVERY, Bank, Measurement
from detectors.bank.hypotheses import FAULT_KINDS
from detectors.bank.measurement import Measured, measured_windows
from detectors.expectation.anchor import anchors, reference_condition
from detectors.expectation.type_correction import HealthyCurve
from detectors.judgement import wording
from detectors.judgement.estimates import estimates
from detectors.judgement.isolation import Alarm, Decision, Evidence, decided, evidence, secondary
from detectors.judgement.plausibility import IMPLAUSIBLE_FLIGHTS, Doubt, doubt
from detectors.words.flights import Roles, outline_of, roles_of
from detectors.words.numbers import Z_90
from detectors.words.observation import History, Maintenance, Observation, Residual
from detectors.words.verdict import CAUSES, SIDE_OF, UNINFORMED, Assessment, Estimate, Quality, Side, State, Verdict
from twin.parameters import Circuit, PumpType

Array = NDArray[np.float64]

MAINTENANCE_RESETS: Mapping[str, tuple[str, ...]] = {
    "fluid_changed": ("ln_viscosity",),
    "filter_changed": ("ln_drain", "drain_flow"),
    "setting_adjusted": ("setting",),
    "sensor_replaced": ("case_offset",),
}
"""Components of the state that each action makes unknown again."""


_RESIDUE = 0.05
"""Probability of all that the record's implausibility does not point to (our estimate: one such run in twenty has another
cause)."""


def assess(
    history: History,
    pump: PumpType,
    circuit: Circuit,
    thresholds: Mapping[str, float],
    healthy: HealthyCurve | None = None,
) -> tuple[Assessment, ...]:
    """Assess a pump's history.

    Parameters
    ----------
    history
        Observations in any order; they are taken by event time, then by record.
    pump, circuit
        What the twin is told; see ``twin.pumps``.
    thresholds
        Effective thresholds (``detectors.words.thresholds.effective``).
    healthy
        Healthy curve of the pump type measured on a bench: it stands in for the nominal twin where it reaches.

    Returns
    -------
    tuple of Assessment
        One per observation in event order; the same history in any order gives the same answer. A flight counts
        once: its main record where that has a zero-flow window, else its first segment that has one.
    """
    observations = sorted(history.observations, key=lambda o: (o.at, o.record_id))
    roles = roles_of([outline_of(o) for o in observations])
    return tuple(Fold(pump, circuit, thresholds, healthy).continued(observations, roles, history))


@dataclass(frozen=True, slots=True)
class Latest:
    """Where the observation that was taken last stands."""

    at: datetime
    aircraft: str
    position: str


@dataclass(slots=True)
class Fold:
    """What is carried from one observation to the next; changed in place, never shared.

    ``detectors.judgement.snapshot`` packs it between two observations, so that a later fold can begin there.
    """

    pump: PumpType
    circuit: Circuit
    thresholds: Mapping[str, float]
    healthy: HealthyCurve | None = None
    bank: Bank = field(init=False)
    reference: Array = field(init=False)
    alarm: Alarm = field(default_factory=Alarm)
    verdict: Verdict | None = None
    used: int = 0
    since_installed: int = 0
    rejected: int = 0
    without_zero: int = 0
    without_reservoir: int = 0
    outside_curve: dict[str, int] = field(default_factory=dict)
    supplemented: bool = False
    touched: bool = False
    doubts: int = 0
    doubtful: Doubt | None = None
    latest: Latest | None = None

    def __post_init__(self) -> None:
        """Start with an unknown pump of the type."""
        self.bank = Bank(self.pump)
        self.reference = anchors([reference_condition(self.pump)], self.pump, self.circuit)[0][0]

    def continued(
        self, observations: Sequence[Observation], roles: Roles, history: History, earlier: Sequence[Observation] = ()
    ) -> Iterator[Assessment]:
        """Take what follows, one assessment per observation.

        Parameters
        ----------
        observations
            Those after the ones that were taken already, in event order.
        roles
            Roles of these records and of those before, together.
        history
            Maintenance and installations count; its observations are not looked at.
        earlier
            Of the observations that were taken already those that later bursts add to.
        """
        bursts: dict[str, list[Observation]] = {}
        for observation in observations:
            if observation.record_id in roles.adds_to:
                bursts.setdefault(roles.adds_to[observation.record_id], []).append(observation)
        judged = [*earlier, *(o for o in observations if o.record_id in roles.counted)]
        measured = measured_windows(judged, bursts, self.pump, self.circuit, self.healthy)
        supplements = {burst: m for found in measured.values() for burst, m in found.supplements.items()}
        for observation in observations:
            if self.latest is not None:
                self.pass_over(self.latest, observation, history)
            self.latest = Latest(observation.at, observation.aircraft, observation.position)
            self.rejected += sum(not w.accepted for w in observation.reduction.windows)
            found = measured.get(observation.record_id)
            trend: dict[str, Estimate] = {}
            doubted = doubt(observation, found.residuals if found is not None else {}, self.pump)
            if doubted is not None:
                again = self.doubtful is not None and self.doubtful.channel == doubted.channel
                self.doubts, self.doubtful = self.doubts + 1 if again else 1, doubted
                trend = {} if found is None else _measured_trend(observation, found.residuals)
            elif found is not None:
                self.doubts, self.doubtful = 0, None
                self.learn(observation, found)
                trend = _measured_trend(observation, found.residuals)
            elif observation.record_id in supplements and self.bank.learnt and not self.touched:
                # behind a reset its lines belong to what its flight's window did not see
                self.supplement(supplements[observation.record_id])
            verdict = self.conclude(observation)
            if trend:
                known = {*verdict.minimum_detectable, "case_flow_at_reference_lpm"}
                trend |= {name: value for name, value in verdict.estimates.items() if name in known}
            yield Assessment(observation.record_id, observation.at, trend, verdict)

    def pass_over(self, previous: Latest, observation: Observation, history: History) -> None:
        """What happened between two records: an installation starts anew, maintenance resets what it touches."""
        moved = (previous.aircraft, previous.position) != (observation.aircraft, observation.position)
        if moved or any(previous.at < t <= observation.at for t in history.installed_at):
            self.bank, self.alarm, self.since_installed = Bank(self.pump), Alarm(), 0
            return
        for event in _due(history.maintenance, previous.at, observation.at):
            self.bank.reset(MAINTENANCE_RESETS.get(event.action, ()))
            self.touched = True

    def learn(self, observation: Observation, found: Measured) -> None:
        """Take one record's windows into the bank."""
        self.bank.learn(found.measurements)
        self.touched = False
        self.used += 1
        self.since_installed += 1
        if self.since_installed in FIRST_ONSETS or self.since_installed % SPAWN_EVERY == 0:
            self.bank.spawn()
        self.without_zero += not observation.reduction.zero.measured
        self.without_reservoir += not found.measurements[-1].reservoir_measured
        if found.outside_curve:
            why = ", ".join(found.outside_curve)
            self.outside_curve[why] = self.outside_curve.get(why, 0) + 1

    def supplement(self, measurement: Measurement) -> None:
        """Take a burst of the flight that was learnt last."""
        self.bank.supplement(measurement)
        self.supplemented = True

    def conclude(self, observation: Observation) -> Verdict:
        """The verdict after this observation; a record that taught nothing repeats the last one."""
        previous = self.verdict
        quality = self._quality()
        unchanged = previous is not None and previous.quality.records_used == self.used and not self.supplemented
        self.supplemented = False
        if self.doubtful is not None and self.doubts >= IMPLAUSIBLE_FLIGHTS and previous is not None:
            self.verdict = _implausible(self.doubtful, self.doubts, previous, quality, observation.at)
            return self.verdict
        if previous is not None and unchanged and self.since_installed > 0:
            self.verdict = replace(previous, quality=quality)
            return self.verdict
        found = evidence(self.bank, self.thresholds)
        values, smallest = estimates(self.bank, found, self.reference)
        limit = self.thresholds["case_flow_limit_lpm"]
        missing = int(self.thresholds["baseline_records"]) - self.since_installed
        decision = Decision(State.INSUFFICIENT_DATA)
        if missing <= 0:
            self.alarm, decision = decided(self.alarm, found, self.thresholds)
        since = observation.at
        if previous is not None and previous.state is decision.state and previous.since is not None:
            since = previous.since
        self.verdict = _verdict(decision, found, self.bank, values, smallest, quality, since, limit, max(missing, 0))
        return self.verdict

    def _quality(self) -> Quality:
        used, flags = self.used, []
        if self.without_zero:
            flags.append(
                f"no pump-off zero in {self.without_zero} of {used} records: "
                "the case sensor's offset is carried as unknown"
            )
        reservoir = "measured"
        if self.without_reservoir:
            reservoir = "nominal" if self.without_reservoir == used else "mixed"
            flags.append(
                f"reservoir pressure not measured in {self.without_reservoir} of {used} records: "
                "leakage below about 0.6 L/min cannot be told from a change of reservoir pressure"
            )
        if self.doubtful is not None:
            flags.append(
                f"{self.doubtful.channel} {self.doubtful.why}: the last {self.doubts} record(s) are no evidence for pump or circuit"
            )
        flags += [
            f"{n} of {used} records outside the measured healthy curve ({why}): judged against the twin"
            for why, n in sorted(self.outside_curve.items())
        ]
        return Quality(used, self.rejected, reservoir, tuple(flags))


def _due(maintenance: tuple[Maintenance, ...], after: datetime, until: datetime) -> list[Maintenance]:
    return sorted((m for m in maintenance if after < m.at <= until), key=lambda m: (m.at, m.action))


def _measured_trend(observation: Observation, residuals: Mapping[str, Residual]) -> dict[str, Estimate]:
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


def _verdict(
    decision: Decision,
    found: Evidence,
    bank: Bank,
    values: Mapping[str, Estimate],
    smallest: Mapping[str, float],
    quality: Quality,
    since: datetime,
    limit: float,
    missing: int,
) -> Verdict:
    state = decision.state
    probabilities = UNINFORMED if state is State.INSUFFICIENT_DATA else found.probabilities
    sensor = _sensor(bank, found) if state is State.SENSOR_FAULT else None
    return Verdict(
        state=state,
        side=_side(decision),
        since=since,
        confidence=max(probabilities.values()),
        probabilities=probabilities,
        candidates=decision.candidates,
        secondary=secondary(found, state),
        sensor=sensor,
        estimates=values,
        minimum_detectable=smallest,
        quality=quality,
        advice=wording.advice(state, decision.candidates, values, limit, missing, sensor),
        resolving_measurement=wording.resolving_measurement(decision.candidates),
    )


def _implausible(found: Doubt, records: int, previous: Verdict, quality: Quality, at: datetime) -> Verdict:
    """The verdict where the last records cannot be true: what was known of pump and circuit before stays an estimate."""
    decision = (
        Decision(State.SENSOR_FAULT) if len(found.states) == 1 else Decision(State.INDETERMINATE, tuple(found.states))
    )
    probabilities = _spread(found.states)
    return replace(
        previous,
        state=decision.state,
        side=_side(decision),
        since=previous.since if previous.state is decision.state else at,
        confidence=max(probabilities.values()),
        probabilities=probabilities,
        candidates=decision.candidates,
        secondary=None,
        sensor=found.channel if decision.state is State.SENSOR_FAULT else None,
        quality=quality,
        advice=wording.implausible(found.channel, found.why, records),
        resolving_measurement=wording.gauge(found.channel),
    )


def _spread(states: tuple[State, ...]) -> dict[State, float]:
    """Probabilities where only a few states are left: equal among them, a residue for the others."""
    others = [s for s in CAUSES if s not in states]
    return {s: _RESIDUE / len(others) for s in others} | {s: (1.0 - _RESIDUE) / len(states) for s in states}


def _side(decision: Decision) -> Side:
    """Side of a state; for ``indeterminate`` the one its candidates share."""
    sides = {SIDE_OF[c] for c in decision.candidates}
    return sides.pop() if len(sides) == 1 else SIDE_OF[decision.state]


def _sensor(bank: Bank, found: Evidence) -> str | None:
    """Channel of the sensor fault with the greatest share."""
    share: dict[str, float] = {}
    for kind, weight in zip(bank.filters.kind[: bank.n], found.weights, strict=True):
        sensor = FAULT_KINDS[kind].sensor if kind >= 0 else None
        if sensor is not None:
            share[sensor] = share.get(sensor, 0.0) + float(weight)
    return max(share, key=lambda name: share[name]) if share else None
