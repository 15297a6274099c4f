"""Readings of a study beyond shares: swept thresholds, truth by floor, prior proportion, faults that go, pumps that move."""

import math
from dataclasses import replace

import numpy as np
import pytest

from detectors.bank.bank import Bank
from detectors.bank.hypotheses import FAULT_KINDS, log_priors
from detectors.bank.regulation import LOG_HAZARD
from detectors.bank.shapes import STATED
from detectors.bank.tables import ARRIVAL_KINDS
from detectors.evaluation.calibration import N_FINE, Reliability, calibration, calibration_error, equal_mass
from detectors.evaluation.delays import (
    ALARM,
    CHART,
    CHART_FALSE_ALARMS,
    INFORMED,
    LEAST_DELAY,
    delay_scores,
    excess,
    found_by,
    mean_delay,
)
from detectors.evaluation.lives import (
    asked_records,
    covered_at,
    ends_of_life,
    given_at,
    life_scores,
    near_at,
    near_where_given_at,
)
from detectors.evaluation.operating import (
    DELAY_AT_ONE,
    DETECTED_AT_ONE,
    THRESHOLD_AT_ONE,
    THRESHOLDS,
    alarmed_at,
    operating_curve,
)
from detectors.evaluation.prevalence import ARRIVAL_PRIOR, hazard_per_record, prior_weights
from detectors.evaluation.reality import REALITIES, Course, fleet
from detectors.evaluation.rows import (
    LEAKS,
    PLAIN_ROWS,
    SMALL_STEP,
    ComingAndGoing,
    Growing,
    Row,
    SideBySide,
    WearingOut,
)
from detectors.evaluation.scoring import seen
from detectors.evaluation.sensing import Sensing, histories
from detectors.evaluation.small_steps import chart_threshold, judged_in_class
from detectors.evaluation.study import Outcome
from detectors.evaluation.truth import is_worth_a_word
from detectors.words.thresholds import effective
from detectors.words.verdict import ESTIMATES, FAULTS, State
from service.studies.evaluation.forecasts import with_forecasts
from tests.detectors.test_evaluation import H, N, P, outcome, row
from twin.condition import INPUTS
from twin.pumps import circuit_parameters, pump_type


def test_a_swept_alarm_is_the_alarm_of_the_judge() -> None:
    odds = np.array([[np.nan, 6.0, 6.0, 4.0, 6.0, 6.0, 6.0, 6.0, 2.0, 0.5, 6.0, 6.0]])
    # the default: four in a row above 5, then down to 1
    assert alarmed_at(odds, [5.0], [1.0], 4).tolist() == [[[False] * 7 + [True, True] + [False] * 3]]
    assert alarmed_at(odds, [9.0, 5.0], [5.0, 1.0], 1)[1, 0].tolist() == [False, *[True] * 8, False, True, True]


def test_sweeping_trades_false_alarms_for_delay() -> None:
    def stated(log_odds: list[list[float]]) -> np.ndarray:
        healthy = 1.0 / (1.0 + np.exp(np.array(log_odds)))
        return np.stack([healthy, *[(1.0 - healthy) / 5] * 5], axis=-1)

    # ten healthy pumps of 40 records; two reach 3.5 nat for six records
    quiet = [[N, *[H] * 39]] * 10
    flat = [[-5.0] * 40 for _ in range(10)]
    for k in (0, 1):
        flat[k][20:26] = [3.5] * 6
    sound = seen(row(H), replace(outcome(quiet), probabilities=stated(flat)))
    # faulty ones climb by half a nat a record from the onset at flight 2; half of them stop at 9 nat
    climb = [[min(0.5 * max(j - 1, -10), 9.0 if i % 2 else 40.0) for j in range(40)] for i in range(10)]
    sick = seen(row(), replace(outcome([[N, *[P] * 39]] * 10), probabilities=stated(climb)))
    curve, found = operating_curve(sound, sick, effective({"alarm_on_log_odds": 5.0, "alarm_records": 4.0}), 1)
    at = dict(zip(THRESHOLDS, zip(curve.false_alarms, curve.detected, curve.delay, strict=True), strict=True))
    assert at[3.0][0].value == pytest.approx(1.0e4 * 2 / 390)
    assert at[4.0][0].value == 0.0
    assert at[4.0][0].low == 0.0
    assert at[4.0][0].high == pytest.approx(1.0e4 * 3.689 / 390, rel=1e-3)  # exact Poisson, none seen
    assert (at[8.0][1].value, at[10.0][1].value) == (1.0, 0.5)
    # above 4 nat from the ninth record after the onset on, four in a row: eleven flights
    assert at[4.0][2].value == 11.0
    assert [s.value for s in curve.delay] == sorted(s.value for s in curve.delay)
    assert (found[THRESHOLD_AT_ONE].value, found[DETECTED_AT_ONE].value, found[DELAY_AT_ONE].value) == (4.0, 1.0, 11.0)
    # resampled fleets without the two loud pumps could have done with less
    assert found[THRESHOLD_AT_ONE].low < 4.0


def test_a_fault_is_true_from_its_floor_on() -> None:
    size = np.array([[0.0, 0.02, 0.04, 0.06, 0.5]])

    def flights(kind: str, truth: State, sizes: np.ndarray = size, **more: object) -> list[bool]:
        study_row = Row("r", truth, sizes.shape[1], Growing((kind,), 1.0), **more)  # type: ignore[arg-type]
        return list(is_worth_a_word(study_row, (Course(kind, sizes),), 1, 0.06)[0])

    assert flights("slippers", P) == [False, False, False, True, True]  # 0.05 L/min
    assert flights("one slipper", P) == [False, True, True, True, True]  # 0.02 L/min
    assert flights("setting", State.COMPENSATOR_FAULT, -5.0 * size) == [False] * 4 + [True]  # 0.7 bar either way
    assert flights("drain", State.DRAIN_RESTRICTION) == [False] * 3 + [True] * 2  # 6 % of the drain's own resistance
    assert flights("erosion", State.COMPENSATOR_FAULT) == [False, True, True, True, True]
    assert not any(flights("reservoir", H))
    zero = Row("z", State.SENSOR_FAULT, 4, sensing=Sensing(case_zero_step=0.06, step_at=2))
    assert is_worth_a_word(zero, (), 1, 0.06).tolist() == [[False, False, True, True]]
    assert is_worth_a_word(replace(zero, worn=True, truth=P), (), 1, 0.06).all()
    two = SideBySide((Growing(("slippers",), 0.6), Growing(("system",), 1.0)))
    both = Row("t", P, 200, two)
    assert is_worth_a_word(both, two.courses(1, 200, 0), 1, 0.06).sum() < 160


def test_calibration_by_floor_asks_every_judged_record() -> None:
    # 0.4 L/min at flight 6; the floor of 0.3 is reached at flight 5, of which the judge is as sure as before
    found = calibration(seen(row(onset=2), outcome([[N, *[H] * 6]], healthy=1.0, onset=2, floor=0.3)))
    assert found.confidence.counted.sum() == 6
    assert calibration_error([found.confidence], 1).value == pytest.approx(2 / 6)
    # from the onset on it was wrong in every record
    assert calibration_error([found.confidence_from_onset], 1).value == pytest.approx(1.0)


def test_bins_of_equal_mass_find_what_wide_ones_hide() -> None:
    rng = np.random.default_rng(1)
    shares = np.zeros((3, N_FINE))
    shares[0] = rng.uniform(0.5, 1.5, N_FINE)
    shares[0] /= shares[0].sum()
    merged = equal_mass(shares)
    assert merged[0] == pytest.approx(np.full(10, 0.1), abs=0.01)
    # 1 % stated, never happened, beside 9 % stated, 10 % happened: one wide bin would see no error at all
    tables = [np.zeros((2, N_FINE)) for _ in range(3)]
    tables[0][:, [40, 100]] = 500.0
    tables[1][:, [40, 100]] = [5.0, 45.0]
    tables[2][:, [40, 100]] = [0.0, 50.0]
    found = calibration_error([Reliability(*tables)], 1, by_mass=True)
    assert found.value == pytest.approx(0.5 * 0.01 + 0.5 * 0.01)


def test_rows_are_pooled_as_the_judge_expects_them() -> None:
    healthy, leak = PLAIN_ROWS[0], PLAIN_ROWS[1]
    drain = next(r for r in PLAIN_ROWS if r.name.startswith("drain"))
    worn = next(r for r in PLAIN_ROWS if r.worn)
    weights = prior_weights([healthy, leak, replace(leak, name="again"), drain, worn])
    assert weights[1] == weights[2]
    hazards = dict(zip((k.name for k in FAULT_KINDS), np.exp(log_priors(-np.inf)[STATED]).sum(axis=0), strict=True))
    drains = [k.name for k in FAULT_KINDS if k.state is State.DRAIN_RESTRICTION]
    worn_kinds = [k.name for k in FAULT_KINDS if k.state is State.PUMP_DEGRADATION]  # both rows stand for all of them
    assert 2 * weights[1] / weights[3] == pytest.approx(
        sum(map(hazards.get, worn_kinds)) / sum(map(hazards.get, drains))
    )
    # uneven wear of its own row is as rare as the judge takes it for
    uneven = next(r for r in PLAIN_ROWS if r.name == "uneven wear")
    apart = prior_weights([drain, uneven])
    assert apart[1] / apart[0] == pytest.approx(hazards["uneven wear"] / sum(map(hazards.get, drains)))
    # all kinds with a fault of their own and changes of the regulation, in four records each; 200 records without any
    faults = [k.name for k in FAULT_KINDS if k.state in FAULTS]
    assert hazard_per_record() == pytest.approx((sum(map(hazards.get, faults)) + math.exp(LOG_HAZARD)) / 4)
    came_worn = len(ARRIVAL_KINDS) * ARRIVAL_PRIOR
    assert weights[0] * (1 + came_worn) == pytest.approx(math.exp(-200 * hazard_per_record()))
    start = Bank(pump_type("h225"))
    assert start.filters.log_evidence[1 : 1 + len(ARRIVAL_KINDS)] == pytest.approx(math.log(ARRIVAL_PRIOR))
    assert weights[4] == pytest.approx(came_worn / (1 + came_worn))
    error = calibration_error
    good = calibration(seen(row(H), outcome([[N, H, H, H]], healthy=1.0, onset=99))).confidence
    bad = calibration(seen(row(onset=1), outcome([[N, H, H, H]], healthy=1.0, onset=1, floor=0.0))).confidence
    assert error([good, bad], 1, weights=[0.9, 0.1], by_mass=True).value == pytest.approx(0.1)


def test_faults_come_and_go() -> None:
    (course,) = ComingAndGoing(("system",), 3.0, on=2, off=3, onset=4).courses(2, 12, 0)
    assert course.size[1].tolist() == [0, 0, 0, 0, 3, 3, 0, 0, 0, 3, 3, 0]
    study_row = next(r for r in PLAIN_ROWS if "comes and goes" in r.name)
    (long,) = study_row.course.courses(1, study_row.n_flights, 0)
    assert long.size[0, -1] == 3.0
    assert (np.diff(long.size[0]) != 0.0).sum() == 7  # four times there, three times gone


def test_an_exchanged_pump_keeps_itself_and_meets_another_aircraft() -> None:
    pump, circuit = pump_type("h225"), circuit_parameters("shared_return")
    leak = Growing(LEAKS, 0.6, flights=10, onset=12).courses(3, 20, 0)
    flights = fleet(REALITIES[2], pump, circuit, np.random.default_rng(1), 3, 20, leak, moved_at=8)
    inputs = {name: flights.rows[:, :, k] for k, name in enumerate(INPUTS)}
    for name in ("drain_resistance_scale", "drain_flow_weight_change", "system_leakage_lpm"):
        assert (np.ptp(inputs[name][:, :8], axis=1) == 0.0).all()
        assert (np.ptp(inputs[name][:, 8:], axis=1) == 0.0).all()
        assert (inputs[name][:, 7] != inputs[name][:, 8]).all()
    for name in ("droop_scale", "control_bleed_lpm"):
        assert (np.ptp(inputs[name], axis=1) == 0.0).all()
    seen_by = histories(flights, pump, Sensing(dropout=0.0), np.random.default_rng(2), 8)
    assert [o.aircraft for o in seen_by[0].observations] == ["A"] * 8 + ["B"] * 12
    moved = next(r for r in PLAIN_ROWS if r.name == "pump exchanged")
    assert moved.truth is H
    assert 0 < (moved.moved_at or 0) < moved.n_flights


def small(kind: str) -> Row:
    return next(r for r in PLAIN_ROWS if r.name == SMALL_STEP + kind)


@pytest.fixture(scope="module")
def steps() -> Outcome:
    """Small steps of slipper leakage on four pumps."""
    study_row = replace(small("leakage, slippers"), n_flights=130)
    pump, circuit = pump_type("h225"), circuit_parameters("shared_return")
    return judged_in_class(study_row, REALITIES[0], pump, circuit, effective({}), 1, 0, 4)


def test_small_steps_give_away_what_was_asked(steps: Outcome) -> None:
    for information, size, flight in zip(steps.information, steps.size, steps.flight, strict=True):
        n = int((flight >= 0).sum())
        onset = int(np.argmax(flight >= 60))
        assert not size[:onset].any()
        assert not information[:onset].any()
        assert np.ptp(size[onset:n]) == 0.0
        assert size[n - 1] > 0.0  # a leak does not heal
        # 0.2 nat a record until log 10,000 = 9.21 is reached: in 47 records
        assert np.cumsum(information[onset:n])[46] == pytest.approx(math.log(1.0e4))
        # what wanders takes the step for its own: the first ten records say more than the last ten
        assert information[onset : onset + 10].mean() > information[n - 10 : n].mean()


def test_the_chart_keeps_the_wanted_rate_by_its_bound() -> None:
    # sum over onsets of the likelihood ratios times the hazard that any kind of fault sets in
    assert chart_threshold(1.0e4) == pytest.approx(math.log(1.0e4 * hazard_per_record()))


def test_the_informed_detector_reaches_the_bound_where_information_lasts() -> None:
    n = 200
    held = outcome([[N, *[H] * (n - 1)]] * 6, healthy=0.99, onset=60, growth=1.0)
    gain = np.where(np.arange(n) >= 60, 0.25, 0.0)
    lasting = replace(held, information=np.tile(gain, (6, 1)), probabilities=held.probabilities.copy())
    # the judge finds it at the 41st record of the step
    lasting.probabilities[:, 100:, 0] = 1.0e-6
    found = delay_scores(seen(replace(small("setting"), n_flights=n), lasting), 1)
    assert found[LEAST_DELAY].value == 37.0  # 9.21 / 0.25
    assert found[found_by(INFORMED)].value > 0.98
    # Lorden's bound holds to the first order, and Page's chart attains it
    assert found[mean_delay(INFORMED)].value == pytest.approx(37.0, rel=0.15)
    assert found[mean_delay(CHART)].value == 41.0
    assert found[excess(CHART)].value == pytest.approx(36.0 / 37.0)
    assert found[found_by(ALARM)].value == 0.0
    assert found[mean_delay(ALARM)].value == 140.0
    assert found[CHART_FALSE_ALARMS].value == 0.0


def test_forecasts_are_held_against_the_first_flight_at_the_limit() -> None:
    n = 101
    lived = outcome([[N, *[P] * (n - 1)]] * 4, onset=0, growth=0.01)  # case flow 1 + 0.01 a flight
    asked = asked_records(lived, 1.8)
    assert asked.tolist() == [[40, 56, 72]] * 4
    assert np.isnan(ends_of_life(lived, 3.0)).all()
    assert np.isnan(ends_of_life(lived, 0.5)).all()
    # 40 flights of two hours are left at half the life
    lived.forecast[0, 40] = (90.0, 50.0, 120.0)
    lived.forecast[1, 40] = (100.0, 50.0, 120.0)
    lived.forecast[2, 40] = (70.0, 60.0, 75.0)
    found = life_scores(seen(replace(row(), limit=1.8), lived), 1.8, 1)
    assert found[given_at(0.5)].value == 0.75
    assert found[covered_at(0.5)].value == pytest.approx(2 / 3)
    assert found[near_at(0.5)].value == 0.5  # 90 and 70 lie within 16 h of 80; none is a miss
    assert found[near_where_given_at(0.5)].value == pytest.approx(2 / 3)
    assert covered_at(0.7) not in found
    assert life_scores(seen(row(), lived), 3.0, 1) == {}


def test_the_service_forecasts_from_what_was_known_then() -> None:
    n = 121
    known = outcome([[N, *[P] * (n - 1)]], onset=0, growth=0.01)
    known.estimates[0, :, list(ESTIMATES).index("case_flow_at_reference_lpm")] = np.column_stack(
        [known.case_flow[0], known.case_flow[0] - 0.0165, known.case_flow[0] + 0.0165]
    )
    given = with_forecasts(known, 2.0)
    at = asked_records(known, 2.0)[0]
    for record in at:
        mean, low, high = given.forecast[0, record]
        left = 2.0 * (100 - record)
        assert low <= left <= high
        assert mean == pytest.approx(left, rel=0.25)
    later = replace(known, estimates=known.estimates.copy())
    later.estimates[0, at[0] + 1 :] += 1.0
    assert with_forecasts(later, 2.0).forecast[0, at[0]] == pytest.approx(given.forecast[0, at[0]])


def test_lives_wear_linearly_and_faster_and_faster() -> None:
    course = WearingOut(("slippers", "port plate"), 0.8, flights=100, onset=10)
    courses = [course.courses(1, 120, k)[0] for k in range(4)]
    assert [c.kind for c in courses] == ["slippers", "port plate"] * 2
    assert courses[0].size[0, 59] == pytest.approx(0.4)
    assert courses[2].size[0, 59] == pytest.approx(0.8 * (math.e - 1) / (math.e**2 - 1))
    assert all(c.size[0, -1] == 0.8 for c in courses)
