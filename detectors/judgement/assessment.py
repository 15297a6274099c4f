"""The pure fold: from a pump's history to its verdicts, one per observation in event order."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from detectors.bank.bank import FIRST_ONSETS, HEALTHY, SPAWN_EVERY, Bank
from detectors.bank.hypotheses import FAULT_KINDS
from detectors.bank.measurement import Measured, measured_windows
from detectors.bank.position import exonerate, settle
from detectors.bank.prediction import CASE
from detectors.bank.window import Measurement
from detectors.expectation.anchor import anchors, reference_condition
from detectors.expectation.stand_in import base_anchor
from detectors.expectation.type_correction import HealthyCurve
from detectors.judgement.coverage import Coverage
from detectors.judgement.estimates import NOTHING_FOUND, estimates
from detectors.judgement.events import MOVED, Latest, due, freed_by, has_moved, viscosity_of
from detectors.judgement.handover import (
    ALONE,
    FEWEST_RECORDS,
    LIKELY,
    NOTHING,
    FromOthers,
    Handover,
    Inherited,
    Left,
    freed_of_position,
    handed_over,
    left_at,
    survival_of,
    with_left,
)
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
    showing,
    suspect,
    without_fit,
)
from detectors.judgement.memory import EXCHANGED, ON_THIS_RECORD, Memory
from detectors.judgement.plausibility import (
    IMPLAUSIBLE_FLIGHTS,
    Doubt,
    Reference,
    case_pressure,
    doubt,
    is_saturated,
)
from detectors.judgement.readings import lower_bound, measured_trend, quality_of
from detectors.judgement.sight import Sight, alike_for, blurred
from detectors.judgement.verdicts import Context, implausible, said_with, verdict_of
from detectors.words.flights import Roles, outline_of, roles_of
from detectors.words.observation import History, Maintenance, Observation
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
    place_records: int = 0
    left: tuple[Left, ...] = ()
    inherited: Inherited | None = None
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
        self,
        observations: Sequence[Observation],
        roles: Roles,
        history: History,
        earlier: Sequence[Observation] = (),
        others: Mapping[str, FromOthers] = ALONE,
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
        others
            What records take over from other pumps, by record.
        """
        bursts: dict[str, list[Observation]] = {}
        for observation in observations:
            if observation.record_id in roles.adds_to:
                bursts.setdefault(roles.adds_to[observation.record_id], []).append(observation)
        judged = [*earlier, *(o for o in observations if o.record_id in roles.counted)]
        measured = measured_windows(judged, bursts, self.pump, self.circuit, self.healthy)
        supplements = {burst: m for found in measured.values() for burst, m in found.supplements.items()}
        for observation in observations:
            self._meet(observation, history, others.get(observation.record_id, NOTHING))
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
        reference = None if found is None else Reference.of(self.bank, found.measurements[-1])
        doubted = doubt(observation, found.residuals if found is not None else {}, self.pump, reference)
        if doubted is not None:
            again = self.doubtful is not None and self.doubtful.channel == doubted.channel
            self.doubts, self.doubtful = self.doubts + 1 if again else 1, doubted
        elif found is not None:
            self.doubts, self.doubtful = 0, None
            if is_saturated(observation, self.pump):
                found = lower_bound(found)
            self.learn(observation, found)
        elif observation.record_id in supplements and self.bank.learnt and not self.touched:
            # behind a reset its lines belong to what its flight's window did not see
            self.supplement(supplements[observation.record_id])
        if found is None:
            return {}
        # what a sensor that cannot be right has said raises no alarm, and ends the one that it raised
        self.case_pressure = None
        read = CASE in found.measurements[-1].seen.tolist()
        if reference is not None and read and (doubted is None or State.DRAIN_RESTRICTION in doubted.states):
            measured, limit = found.measurements[-1].values[CASE], self.thresholds["case_pressure_limit_bar"]
            self.case_pressure = case_pressure(float(measured), reference, limit, has_baseline=self._missing() <= 0)
        return measured_trend(observation, found.residuals)

    def _missing(self) -> int:
        """Records that a baseline still needs; none or less when it stands."""
        return int(self.thresholds["baseline_records"]) - self.used

    def _meet(self, observation: Observation, history: History, others: FromOthers) -> None:
        """What happened before a record, to this pump and with others."""
        if self.latest is not None:
            self.pass_over(self.latest, observation, history, others.handover)
        elif others.handover is not None and others.handover.records >= FEWEST_RECORDS:
            self._arrive(observation, history, others.handover)
            self._do(due(history.maintenance, others.handover.at, observation.at))
        if others.survival is not None and self.left:
            exonerate(self.bank, self.left[-1].records, others.survival)

    def pass_over(
        self, previous: Latest, observation: Observation, history: History, handover: Handover | None = None
    ) -> None:
        """What happened between two records: a move frees what stays behind, an entry what it names."""
        done = due(history.maintenance, previous.at, observation.at)
        moved = has_moved(previous, observation, history)
        if moved:
            behind = self.handover(done)
            self.left = with_left(self.left, Left(previous.aircraft, previous.position, behind, self.bank.records))
            self.bank.reset(MOVED, cures=False)
            self.memory = self.memory.moved()
        if moved or done:
            # a move resolves nothing; several entries between two records are one, and what ended with the first has ended
            self.bank.ended = self.bank.resolving = HEALTHY
        if moved:
            self._arrive(observation, history, handover)
        self._do(done)

    def handover(self, done: Sequence[Maintenance] = ()) -> Handover:
        """What has been learnt of the position up to the last record, and what was done since."""
        if self.latest is None:
            raise ValueError("nothing was learnt yet: no record has been taken")
        return handed_over(self.bank, self.thresholds, self.latest.at, self.place_records, done)

    def survival(self) -> float | None:
        """How far its records speak for what it took over being wrong with its position [nat]; None where it took over nothing."""
        return survival_of(self.bank, self.thresholds, self.inherited)

    def _arrive(self, observation: Observation, history: History, handover: Handover | None) -> None:
        """At a position: with what the pump before has learnt there, or this one itself when it left; else with nothing."""
        known = handover or left_at(self.left, observation.aircraft, observation.position)
        self.at_place, self.place_records, self.touched, self.inherited = 0, 0, True, None
        if known is None or known.records < FEWEST_RECORDS:
            self.alarm = self.alarm.moved(int(self.thresholds["baseline_records"]))
            return
        self.place_records = known.records
        settle(self.bank, known.position)
        if known.position.wrong > LIKELY:
            self.alarm = replace(self.alarm, raised=True)
        if handover is None:
            return
        self.inherited = Inherited(known.at, self.bank.records - 1, known.position.log_odds)
        exchanged = max((t for t in history.installed_at if known.at < t <= observation.at), default=observation.at)
        self.memory = self.memory.done(EXCHANGED, exchanged)
        self.bank.ended = known.position.blamed
        for event in known.done:
            self.memory = self.memory.done(event.action, event.at)
            self.bank.reset(freed_of_position(event))

    def _do(self, done: Sequence[Maintenance]) -> None:
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
        self.place_records += 1
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
        previous, counts, doubted = self.verdict, (self.used, self.rejected), (self.doubtful, self.doubts)
        quality = quality_of(self.pump, counts, self.coverage, doubted, self.outside_curve)
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
                resolved_by=self.memory.resolved_where(healthy=decision.state is State.HEALTHY),
                case_pressure=self.case_pressure,
                sensor=leading_sensor(self.bank, found) if suspects_a_sensor else None,
                sight=self.sight,
            ),
        )

    def _settling(self) -> int:
        """Records that the reference of a new position still needs; 0 where the pump has never moved."""
        return 0 if self.at_place is None else max(int(self.thresholds["baseline_records"]) - self.place_records, 0)

    def _fit(self, found: Evidence, observation: Observation) -> Fit:
        """How far the leading cause explains the last records."""
        records, explained, last = explained_by(self.bank, found)
        self.misfit_since = None if last else self.misfit_since or observation.at
        return Fit(records, explained, self.misfit_since)

    def _remember(self, decision: Decision, found: Evidence, observation: Observation) -> None:
        """Keep in mind what leads the alarm, and what ended."""
        # an entry has resolved nothing as long as something is still wrong
        new_here = self.at_place is not None and self.at_place < self.thresholds["alarm_records"]
        if self.bank.ended != HEALTHY and decision.state is State.HEALTHY and not new_here:
            self.memory = self.memory.ended(FAULT_KINDS[self.bank.ended].state)
            self.bank.ended = HEALTHY
        if self.used:
            leader = suspect(decision, found)
            shows = ON_THIS_RECORD if leader is None else showing(self.bank, found, leader)
            self.memory = self.memory.after(leader, observation.at, shows)
