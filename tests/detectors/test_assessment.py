"""The fold against simulated realities that differ from the judge's model; noise everywhere."""

import random
from collections import Counter
from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest
from scipy.stats import norm

from detectors.bank.bank import Bank
from detectors.bank.hypotheses import FAULT_KINDS
from detectors.bank.measurement import measured_windows
from detectors.expectation.anchor import anchors, reference_condition
from detectors.judgement.assessment import assess
from detectors.judgement.estimates import WIDENING, estimates
from detectors.judgement.isolation import QUANTITIES, evidence
from detectors.words.observation import History, Maintenance
from detectors.words.thresholds import effective
from detectors.words.verdict import ESTIMATES, FAULTS, Assessment, Side, State
from tests.detectors.fleet import CIRCUIT, PUMP, Fault, history
from tests.detectors.fleet import FAULTS as SIMULATED
from twin.condition import Health, input_rows
from twin.operating_point import operating_points

THRESHOLDS = effective({})
QUIET = (State.HEALTHY, State.INSUFFICIENT_DATA)


def assessed(found: History) -> tuple[Assessment, ...]:
    return assess(found, PUMP, CIRCUIT, THRESHOLDS)


def ever_accused(seed: int) -> bool:
    return any(a.verdict.state not in QUIET for a in assessed(history(1000 + seed, 60)))


@pytest.mark.study
def test_no_healthy_pump_is_accused() -> None:
    """60 pumps of 60 flights: at most one pump may ever be accused (none was in 200 on the day of writing)."""
    assert sum(map(ever_accused, range(60))) <= 1


def test_no_healthy_pump_of_a_few_is_accused() -> None:
    """The first ten of the study's pumps."""
    assert not any(map(ever_accused, range(10)))


@pytest.mark.parametrize(
    ("fault", "right"),
    [
        ("worn", State.PUMP_DEGRADATION),
        ("leaking", State.SYSTEM_LEAKAGE),
        ("setting", State.COMPENSATOR_FAULT),
        ("drain", State.DRAIN_RESTRICTION),
    ],
)
def test_each_fault_ends_on_its_side_or_undecided_with_it(fault: str, right: State) -> None:
    finals = [assessed(history(seed, 40, SIMULATED[fault]))[-1].verdict for seed in range(12)]
    good = [v.state is right or (v.state is State.INDETERMINATE and right in v.candidates) for v in finals]
    assert sum(good) >= 11
    wrong_side = Side.SYSTEM if right in (State.PUMP_DEGRADATION, State.COMPENSATOR_FAULT) else Side.PUMP
    assert sum(v.side is wrong_side for v in finals) <= 1
    for verdict in finals:
        if verdict.state is State.INDETERMINATE and len(verdict.candidates) > 1:
            assert verdict.resolving_measurement


def test_a_moved_case_sensor_is_named_and_the_pump_is_not_blamed() -> None:
    for seed in range(8):
        verdict = assessed(history(seed, 40, zero_step_bar=0.2))[-1].verdict
        assert (verdict.state, verdict.side, verdict.sensor) == (State.SENSOR_FAULT, Side.SENSOR, "case_pressure_bar")


def test_case_flow_at_the_reference_lies_in_its_interval() -> None:
    """The truth is the operating point of each pump's own health: nine intervals in ten hold it.

    Between the judge and the simulated pumps stand another drain law and sensors that wander: errors reach 0.34 L/min.
    """
    at = reference_condition(PUMP)
    errors, halves = [], []
    for seed in range(12):
        healths: list[Health] = []
        found = history(seed, 40, noted(SIMULATED["worn"], healths))
        flow = assessed(found)[-1].verdict.estimates["case_flow_at_reference_lpm"]
        truth = operating_points(PUMP.pump, input_rows([at], [healths[-1]]), CIRCUIT).value("case_flow_lpm")[0]
        errors.append(abs(flow.mean - truth))
        halves.append(0.5 * (flow.high - flow.low))
    inside = np.array(errors) <= np.array(halves)
    assert inside.sum() >= 10


def noted(fault: Fault, into: list[Health]) -> Fault:
    """The same fault, with the health of every flight written down."""

    def noting(i: int, own: Health) -> Health:
        into.append(fault(i, own))
        return into[-1]

    return noting


def test_intervals_are_those_of_nine_in_ten() -> None:
    """90 % of a normal distribution lie within 1.645 sigmas; an eighth wider, as the study of foreign realities asked."""
    reference = anchors([reference_condition(PUMP)], PUMP, CIRCUIT)[0][0]
    bank = Bank(PUMP)
    unknown = replace(evidence(bank, THRESHOLDS), moments=np.zeros((len(QUANTITIES), 4)))
    values = estimates(bank, unknown, reference, 1.5).values
    size = {k.name: k.scale for k in FAULT_KINDS}
    for quantity, fault in (
        ("pump_leakage_change_lpm", "leakage, slippers"),
        ("system_leakage_change_lpm", "system leakage"),
        ("pressure_setting_change_bar", "setting"),
    ):
        # what nothing is known of is as wide as the fault's own prior
        half = WIDENING * norm.ppf(0.95) * size[fault]
        found = values[quantity]
        assert (found.mean, found.low, found.high) == pytest.approx((0.0, -half, half), rel=1e-3)
    # a filter that is certain of a leak of 0.3 L/min to within 0.1
    known = replace(unknown, moments=np.tile((1.0, 0.3, 0.3**2 + 0.1**2, 0.1), (len(QUANTITIES), 1)))
    found = estimates(bank, known, reference, 1.5).values["pump_leakage_change_lpm"]
    half = WIDENING * norm.ppf(0.95) * 0.1
    assert (found.mean, found.low, found.high) == pytest.approx((0.3, 0.3 - half, 0.3 + half), rel=1e-3)


def test_what_lies_beyond_the_limit_is_a_normal_tail() -> None:
    """The healthy pump alone, before any record: its case flow at the reference is normal, an eighth wider than it believes."""
    reference = anchors([reference_condition(PUMP)], PUMP, CIRCUIT)[0][0]
    bank = Bank(PUMP)
    bank._keep(np.zeros(1, dtype=np.int64))
    alone = evidence(bank, THRESHOLDS)
    for limit in (0.8, 1.5, 3.0):
        found = estimates(bank, alone, reference, limit)
        flow = found.values["case_flow_at_reference_lpm"]
        spread = (flow.high - flow.mean) / norm.ppf(0.95)
        assert found.beyond == pytest.approx(norm.sf((limit - flow.mean) / spread), rel=1e-3)
        assert not found.smallest  # nothing has been seen that could have been found


def test_intervals_of_a_record_are_those_of_nine_in_ten() -> None:
    (found,) = history(13, 1).observations
    (assessment,) = assessed(History((found,)))
    assert found.reduction.zero_flow is not None
    for metric in ("fluid_temperature_degc", "reservoir_pressure_bar"):
        mean, shown = found.reduction.zero_flow.means[metric], assessment.trend[metric]
        assert shown.mean == mean.mean
        assert shown.high - shown.mean == pytest.approx(norm.ppf(0.95) * mean.standard_error, rel=1e-3)
        assert shown.mean - shown.low == pytest.approx(norm.ppf(0.95) * mean.standard_error, rel=1e-3)
    (judged,) = measured_windows([found], {}, PUMP, CIRCUIT).values()
    for metric, channel in (
        ("discharge_residual_bar", "discharge_pressure_bar"),
        ("case_residual_bar", "case_pressure_bar"),
    ):
        residual, shown = judged.residuals[channel], assessment.trend[metric]
        assert 0.5 * (shown.high - shown.low) == pytest.approx(norm.ppf(0.95) * residual.standard_deviation, rel=1e-3)


def test_order_of_observations_does_not_matter() -> None:
    found = history(3, 30, SIMULATED["worn"])
    expected = assessed(found)
    for seed in range(3):
        observations = list(found.observations)
        random.Random(seed).shuffle(observations)
        assert assessed(replace(found, observations=tuple(observations))) == expected


def test_records_of_one_instant_are_taken_by_their_names() -> None:
    """Two records begin in the same second: which of them the list holds first must not count."""
    found = list(history(3, 14, SIMULATED["worn"]).observations)
    found[12] = replace(found[12], at=found[11].at)
    expected = assessed(History(tuple(found)))
    assert [a.record_id for a in expected[11:13]] == ["r0011", "r0012"]
    found[11], found[12] = found[12], found[11]
    assert assessed(History(tuple(found))) == expected


def test_the_past_does_not_depend_on_the_future() -> None:
    found = history(4, 30, SIMULATED["leaking"])
    assert assessed(replace(found, observations=found.observations[:20])) == assessed(found)[:20]


def test_a_flight_counts_once() -> None:
    found = history(5, 20)
    burst = replace(found.observations[4], record_id="burst", segment="burst-1")
    twice = assessed(replace(found, observations=(*found.observations, burst)))
    assert twice[-1].verdict.quality.records_used == 20
    assert twice[-1].verdict.estimates == assessed(found)[-1].verdict.estimates


def test_probabilities_and_sides_are_consistent() -> None:
    for assessment in assessed(history(6, 40, SIMULATED["drain"])):
        verdict = assessment.verdict
        assert sum(verdict.probabilities.values()) == pytest.approx(1.0)
        assert set(verdict.probabilities) == {State.HEALTHY, *FAULTS, State.OTHER}
        assert verdict.confidence == max(verdict.probabilities.values())
        assert set(verdict.estimates) == set(ESTIMATES)
        if verdict.state is State.INSUFFICIENT_DATA:
            assert len(set(verdict.probabilities.values())) == 1
        assert bool(verdict.candidates) == (verdict.state is State.INDETERMINATE)
        if verdict.state is State.HEALTHY:
            assert verdict.side is Side.NONE


def test_since_is_the_start_of_the_unbroken_run() -> None:
    found = assessed(history(7, 40, SIMULATED["setting"]))
    run_start = found[0].at
    for previous, current in zip((None, *found), found, strict=False):
        if previous is None or previous.verdict.state is not current.verdict.state:
            run_start = current.at
        assert current.verdict.since == run_start


def test_outliers_do_not_accuse() -> None:
    for seed in range(6):
        states = Counter(a.verdict.state for a in assessed(history(seed, 40, spikes=True)))
        assert set(states) <= set(QUIET)


def test_an_adjusted_setting_is_not_a_fault() -> None:
    adjusted = history(
        10,
        40,
        lambda i, own: own._replace(pressure_setting_change_bar=own.pressure_setting_change_bar + 2.5 * (i >= 20)),
    )
    at = adjusted.observations[20].at - timedelta(hours=1)
    assert assessed(adjusted)[-1].verdict.state is State.COMPENSATOR_FAULT
    told = replace(adjusted, maintenance=(Maintenance(at, "setting_adjusted"),))
    assert assessed(told)[-1].verdict.state is State.HEALTHY


def test_an_entry_that_left_the_setting_alone_excuses_no_moved_setting() -> None:
    """The sensor was replaced, the setting moved by 2.5 bar on the same day: the compensator is at fault."""
    moved = history(
        10,
        40,
        lambda i, own: own._replace(pressure_setting_change_bar=own.pressure_setting_change_bar + 2.5 * (i >= 20)),
    )
    at = moved.observations[20].at - timedelta(hours=1)
    told = replace(moved, maintenance=(Maintenance(at, "sensor_replaced"),))
    assert assessed(told)[-1].verdict.state is State.COMPENSATOR_FAULT


def test_missing_zero_and_reservoir_cost_sensitivity_and_are_said() -> None:
    full = assessed(history(11, 40))[-1].verdict
    blind = assessed(history(11, 40, with_zero=False))[-1].verdict
    assert blind.state is State.HEALTHY
    assert any("no pump-off zero in 40 of 40 records" in f for f in blind.quality.flags)
    assert blind.minimum_detectable["pump_leakage_change_lpm"] > full.minimum_detectable["pump_leakage_change_lpm"]
    deaf = assessed(history(11, 40, with_reservoir=False))[-1].verdict
    assert deaf.quality.reservoir_pressure == "nominal"
    assert any("reservoir pressure not measured" in f for f in deaf.quality.flags)


@pytest.mark.parametrize("with_zero", [True, False])
def test_without_the_reservoir_sensor_healthy_pumps_stay_healthy(with_zero: bool) -> None:
    for seed in range(5):
        found = assessed(history(seed, 40, with_zero=with_zero, with_reservoir=False))
        assert all(a.verdict.state in QUIET for a in found)


def test_a_pump_far_above_its_limit_is_seen_on_arrival() -> None:
    arrived = history(12, 20, lambda _i, own: own._replace(pump_leakage_scale=4.5))
    verdict = assessed(arrived)[-1].verdict
    assert verdict.state is State.PUMP_DEGRADATION
    assert verdict.estimates["case_flow_at_reference_lpm"].mean > 2.2


def test_no_records_no_assessments() -> None:
    assert assessed(History(())) == ()
