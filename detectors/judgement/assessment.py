"""The pure fold: from a pump's history to its verdicts, one per observation in event order."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from detectors.bank.bank import FIRST_ONSETS, HEALTHY, SPAWN_EVERY, Bank
from detectors.bank.hypotheses import FAULT_KINDS
from detectors.bank.measurement import Measured, measured_windows
from detectors.bank.prediction import CASE
from detectors.bank.window import Measurement
from detectors.expectation.anchor import anchors, reference_condition
from detectors.expectation.stand_in import base_anchor
from detectors.expectation.type_correction import HealthyCurve
from detectors.judgement.coverage import Coverage
from detectors.judgement.estimates import NOTHING_FOUND, estimates
from detectors.judgement.events import MOVED, due, freed_by, viscosity_of
from detectors.judgement.isolation import (
    Alarm,
    Decision,
    Evidence,
    cautious,
    coming_and_going,
    decided,
    evidence,
    explained_by,
    fitting,
    leading_sensor,
    suspect,
    without_fit,
)
from detectors.judgement.memory import Memory
from detectors.judgement.plausibility import (
    IMPLAUSIBLE_FLIGHTS,
    SATURATED_BAR,
    Doubt,
    Reference,
    case_pressure,
    doubt,
    is_saturated,
)
from detectors.judgement.sight import Sight, alike_for, blurred
from detectors.judgement.verdicts import Context, implausible, said_with, verdict_of
from detectors.words.flights import Roles, outline_of, roles_of
from detectors.words.numbers import Z_90
from detectors.words.observation import History, Observation, Residual
from detectors.words.verdict import Assessment, CasePressure, Estimate, Fit, Quality, State, Verdict
from twin.parameters import Circuit, PumpType

Array = NDArray[np.float64]


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
    at_place: int | None = None
    rejected: int = 0
    outside_curve: dict[str, int] = field(default_factory=dict)
    unjudged: int = 0
    supplemented: bool = False
    touched: bool = False
    doubts: int = 0
    doubtful: Doubt | None = None
    coverage: Coverage = field(default_factory=Coverage)
    memory: Memory = field(default_factory=Memory)
    case_pressure: CasePressure | None = None
    misfit_since: datetime | None = None
    latest: Latest | None = None

    @property
    def sight(self) -> Sight:
        """What the type's records lack from the start."""
        return Sight(self.pump.lacks, self.pump.own_twin, self.pump.reservoir_is_known)

    def __post_init__(self) -> None:
        """Start with an unknown pump of the type."""
        self.bank = Bank(self.pump)
        self.reference = base_anchor(self.circuit)
        if self.pump.own_twin:
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
            trend = self._taken(observation, found, supplements)
            verdict = self.conclude(observation)
            if trend:
                known = {*verdict.minimum_detectable, "case_flow_at_reference_lpm"}
                trend |= {name: value for name, value in verdict.estimates.items() if name in known}
            yield Assessment(observation.record_id, observation.at, trend, verdict)

    def _taken(
        self, observation: Observation, found: Measured | None, supplements: Mapping[str, Measurement]
    ) -> dict[str, Estimate]:
        """Take one record at its word, or doubt it; what it measured, as points of the trend."""
        if found is not None and not found.measurements:
            self._outside(found)
            self.unjudged += 1
            found = None
        reference = self._reference(found)
        doubted = doubt(observation, found.residuals if found is not None else {}, self.pump, reference)
        if doubted is not None:
            again = self.doubtful is not None and self.doubtful.channel == doubted.channel
            self.doubts, self.doubtful = self.doubts + 1 if again else 1, doubted
        elif found is not None:
            self.doubts, self.doubtful = 0, None
            if is_saturated(observation, self.pump):
                found = _lower_bound(found)
            self.learn(observation, found)
        elif observation.record_id in supplements and self.bank.learnt and not self.touched:
            # behind a reset its lines belong to what its flight's window did not see
            self.supplement(supplements[observation.record_id])
        if found is None:
            return {}
        # what a sensor that cannot be right has said raises no alarm, and ends the one that it raised
        self.case_pressure = None
        read = CASE in found.measurements[-1].seen
        if reference is not None and read and (doubted is None or State.DRAIN_RESTRICTION in doubted.states):
            measured, limit = found.measurements[-1].values[CASE], self.thresholds["case_pressure_limit_bar"]
            self.case_pressure = case_pressure(float(measured), reference, limit, has_baseline=self._missing() <= 0)
        return _measured_trend(observation, found.residuals)

    def _reference(self, found: Measured | None) -> Reference | None:
        """What the healthy pump is expected to show in the window that the flight is judged by."""
        if found is None:
            return None
        healthy, leading = self.bank.expected(found.measurements[-1])
        return Reference(*healthy, leading[1])

    def _missing(self) -> int:
        """Records that a baseline still needs; none or less when it stands."""
        return int(self.thresholds["baseline_records"]) - self.used

    def pass_over(self, previous: Latest, observation: Observation, history: History) -> None:
        """What happened between two records: a move frees what stays behind, an entry what it names."""
        moved = (previous.aircraft, previous.position) != (observation.aircraft, observation.position)
        moved = moved or any(previous.at < t <= observation.at for t in history.installed_at)
        done = due(history.maintenance, previous.at, observation.at)
        if moved:
            self.bank.reset(MOVED, cures=False)
            self.memory, self.at_place = self.memory.moved(), 0
            self.alarm = self.alarm.moved(int(self.thresholds["baseline_records"]))
            self.touched = True
        if moved or done:
            # a move resolves nothing; several entries between two records are one, and what ended with the first has ended
            self.bank.ended = self.bank.resolving = HEALTHY
        for event in done:
            self.memory = self.memory.done(event.action, event.at)
            self.bank.reset(freed_by(event))
            filled = viscosity_of(event, self.pump)
            if filled is not None:
                self.bank.fill(*filled)
            self.touched = True

    def learn(self, observation: Observation, found: Measured) -> None:
        """Take one record's windows into the bank."""
        self.bank.learn(found.measurements)
        self.touched, self.unjudged = False, 0
        self.coverage = self.coverage.grown(observation)
        self.used += 1
        if self.at_place is not None:
            self.at_place += 1
        if self.used in FIRST_ONSETS or self.used % SPAWN_EVERY == 0:
            self.bank.spawn()
        self._outside(found)

    def _outside(self, found: Measured) -> None:
        """Count what took a record outside the measured curve."""
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
        if previous is None or not unchanged:
            self.verdict = self._judged(observation, previous, quality)
        else:
            self.verdict = replace(previous, quality=quality, case_pressure=self.case_pressure)
        if self.doubtful is not None and self.doubts >= IMPLAUSIBLE_FLIGHTS:
            self.verdict = implausible(self.doubtful, self.doubts, self.verdict, observation.at)
        return said_with(self.verdict, self.unjudged)

    def _judged(self, observation: Observation, previous: Verdict | None, quality: Quality) -> Verdict:
        """The verdict by the evidence."""
        found = evidence(self.bank, self.thresholds)
        limit = self.thresholds["case_flow_limit_lpm"]
        alike = alike_for(self.pump)
        if alike:
            found, sizes = blurred(found, alike), NOTHING_FOUND
        else:
            sizes = estimates(self.bank, found, self.reference, limit)
        fit = self._fit(found, observation)
        missing, decision = self._missing(), Decision(State.INSUFFICIENT_DATA)
        if missing > 0:
            sizes = sizes._replace(smallest={})
        if missing <= 0:
            self.alarm, decision = decided(self.alarm, found, self.thresholds)
            fitted = fitting(decision, fit, found)
            if fitted is not decision:
                decision, found = fitted, without_fit(fit, found)
            elif decision.state is State.INDETERMINATE:
                found = cautious(found)
            self._remember(decision, found, observation)
        since = observation.at
        if previous is not None and previous.state is decision.state and previous.since is not None:
            since = previous.since
        suspects_a_sensor = State.SENSOR_FAULT in (decision.state, *decision.candidates)
        shown = coming_and_going(self.bank, found, decision.state, self.memory.since)
        # what stands now neither went nor came back: it is what the state says
        vanished = self.memory.came_and_went if decision.state is State.HEALTHY else None
        return verdict_of(
            decision,
            found,
            sizes,
            Context(
                quality=quality,
                since=since,
                limit_lpm=limit,
                missing=max(missing, 0),
                coverage=self.coverage,
                settling=self._settling(),
                fit=fit,
                intermittent=shown or vanished,
                resolved_by=self.memory.resolved,
                case_pressure=self.case_pressure,
                sensor=self._sensor(found) if suspects_a_sensor else None,
                sight=self.sight,
            ),
        )

    def _sensor(self, found: Evidence) -> str | None:
        """The sensor that is suspected; the only one where there is one."""
        fitted = [c for c in ("case_pressure_bar", "discharge_pressure_bar") if c not in self.pump.lacks]
        return fitted[0] if len(fitted) == 1 else leading_sensor(self.bank, found)

    def _settling(self) -> int:
        """Records that the reference of a new position still needs; 0 where the pump has never moved."""
        return 0 if self.at_place is None else max(int(self.thresholds["baseline_records"]) - self.at_place, 0)

    def _fit(self, found: Evidence, observation: Observation) -> Fit:
        """How far the leading cause explains the last records."""
        records, explained, last = explained_by(self.bank, found)
        self.misfit_since = None if last else self.misfit_since or observation.at
        return Fit(records, explained, self.misfit_since)

    def _remember(self, decision: Decision, found: Evidence, observation: Observation) -> None:
        """Keep in mind what leads the alarm, and what ended."""
        # an entry has resolved nothing as long as something is still wrong
        if self.bank.ended != HEALTHY and decision.state is State.HEALTHY:
            self.memory = self.memory.ended(FAULT_KINDS[self.bank.ended].state)
            self.bank.ended = HEALTHY
        if self.used:
            self.memory = self.memory.after(suspect(decision, found), observation.at)

    def _quality(self) -> Quality:
        used, flags = self.used, []
        without_zero, without_reservoir = used - self.coverage.zeros, used - self.coverage.reservoirs
        if without_zero and "case_pressure_bar" not in self.pump.lacks:
            flags.append(
                f"no pump-off zero in {without_zero} of {used} records: the case sensor's offset is carried as unknown"
            )
        reservoir = "measured"
        if without_reservoir:
            reservoir = "nominal" if without_reservoir == used else "mixed"
        if without_reservoir and not self.pump.reservoir_is_known:
            flags.append(
                f"reservoir pressure not measured in {without_reservoir} of {used} records: "
                "leakage below about 0.6 L/min cannot be told from a change of reservoir pressure"
            )
        if self.doubtful is not None:
            flags.append(
                f"{self.doubtful.channel} {self.doubtful.why}: the last {self.doubts} record(s) are no evidence for pump or circuit"
            )
        instead = "judged against the twin" if self.pump.own_twin else "not judged"
        used += 0 if self.pump.own_twin else sum(self.outside_curve.values())
        flags += [
            f"{n} of {used} records outside the measured healthy curve ({why}): {instead}"
            for why, n in sorted(self.outside_curve.items())
        ]
        return Quality(self.used, self.rejected, reservoir, tuple(flags))


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


def _lower_bound(found: Measured) -> Measured:
    """What a sensor at its full scale shows: at least that, give or take what a blocked drain may add."""
    *rest, last = found.measurements
    values, noise = last.values.copy(), last.noise.copy()
    above, sd = SATURATED_BAR
    values[CASE] += above
    noise[CASE, CASE] += sd**2
    return replace(found, measurements=(*rest, replace(last, values=values, noise=noise)))
