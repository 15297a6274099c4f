"""Static points of chapter 3: what the printed errors leave as measured, and a joint fit that finds known numbers."""

import math

import numpy as np
import pytest

from twin.condition import Condition, Health
from twin.identification.static_points import Box, StaticPoint, changed, joint_fit, predicted
from twin.pumps import circuit_parameters, pump_type
from twin.validation.inferred_points import (
    K_C,
    PRINTED_ERROR_PERCENT,
    VARIABLES,
    inferred_points,
    least_worst_error,
    return_drop,
    single_fit_error,
    tank_offset,
)
from twin.validation.static_points import ACCURACY, FOUR, averages, chapter_3, model_of, static_points

PUMP, BENCH = pump_type("h225").pump, circuit_parameters("shared_return")
POINTS = inferred_points()


def test_inferred_points_reproduce_the_printed_errors() -> None:
    """One value of the thesis' model lies behind both readings: each is missed by what is printed."""
    for tank, five in POINTS.items():
        assert [p.number for p in five] == [1, 2, 3, 4, 5]
        for p in five:
            for name in VARIABLES:
                reading, error = p.readings[name], PRINTED_ERROR_PERCENT[tank][name][p.number - 1] / 100.0
                if math.isnan(reading.other):
                    continue
                # I = taken (1 -+ e) = other (1 +- e)
                ratio = reading.taken / reading.other
                expected = (1.0 + error) / (1.0 - error)
                assert ratio == pytest.approx(expected, rel=1e-9) or ratio == pytest.approx(1.0 / expected, rel=1e-9)


def test_inferred_points_agree_with_what_the_thesis_says_of_them() -> None:
    zero, second, *_ = POINTS[0.0]
    # table 4-3 and table 3-10: 1.766 L/min, missed by 188.74 %
    assert second.value("case_flow_lpm") == pytest.approx(1.766 / 2.8874, rel=0.01)
    # section 4.2.2 in words: 160 bar, 29 L/min
    assert second.value("discharge_pressure_bar") == pytest.approx(160.0, rel=0.02)
    assert second.value("discharge_flow_lpm") == pytest.approx(29.0, rel=0.03)
    # section 3.3.1: at most 1.5 L/min; the bench misses 0.3 L/min of case flow on average, that is 0.1 bar
    for five in POINTS.values():
        assert all(0.1 < p.value("case_flow_lpm") < 1.5 for p in five)
        law = [p.reservoir_pressure_bar + return_drop(p.value("discharge_flow_lpm") + p.value("case_flow_lpm"))
               + K_C * p.value("case_flow_lpm") for p in five]  # fmt: skip
        missed = np.array(law) - [p.value("case_pressure_bar") for p in five]
        assert np.abs(missed).mean() < 0.15
    # at zero flow table 3-8's two errors are those of one resistance of 0.337 bar/(L/min)
    assert single_fit_error("case_pressure_bar", 0) / single_fit_error("case_flow_lpm", 0) == pytest.approx(
        0.337, rel=0.005
    )
    assert 0.0 < tank_offset() < 0.2
    assert zero.value("case_pressure_bar") == pytest.approx(
        tank_offset() + 0.337 * zero.value("case_flow_lpm"), abs=0.02
    )


def test_least_worst_error_bounds_every_rising_law() -> None:
    flows = [0.6, 0.8, 0.4, 0.7]
    bound = least_worst_error(flows)
    rng = np.random.default_rng(4)
    laws = np.sort(rng.uniform(0.1, 1.2, (4000, 4)), axis=1)[:, ::-1]
    worst = np.abs(laws / flows - 1.0).max(axis=1)
    assert worst.min() >= bound
    assert worst.min() < bound + 0.05
    assert least_worst_error([1.0, 0.8, 0.8]) == 0.0


def test_a_joint_fit_finds_the_numbers_that_made_the_points() -> None:
    boxes = (*FOUR[:2], FOUR[3])
    truth = (0.2605, 10.2, 500.0)
    made = changed(PUMP, boxes, truth)
    blank = [StaticPoint(Condition(4600.0, 50.0), load, {}) for load in (0.0, 0.2, 0.117, 0.057, 0.0214)]
    values = predicted(made, blank, BENCH, VARIABLES, Health())
    points = [p._replace(measured={n: float(values[n][i]) for n in VARIABLES}) for i, p in enumerate(blank)]
    found = joint_fit(PUMP, points, BENCH, boxes, ACCURACY)
    assert found.objective < 1e-4
    for f, value in zip(found.found, truth, strict=True):
        assert f.value == pytest.approx(value, rel=0.02)
        assert f.low <= f.value <= f.high


def test_evolution_looks_past_the_minimum_where_sqp_stops_and_says_what_is_not_told() -> None:
    five = static_points(POINTS[0.0])
    alone = joint_fit(PUMP, five, BENCH, FOUR, ACCURACY)
    found = joint_fit(PUMP, five, BENCH, FOUR, ACCURACY, "evolution", 20)
    assert found.objective < 0.97 * alone.objective
    of = {f.path: f for f in found.found}
    assert of["port_plate.h"].open
    assert not of["swashplate.alpha_max"].open
    # both minima are in the interval
    assert of["slipper.h"].low < 6.0 < of["slipper.h"].high
    assert found.found[0].value == pytest.approx(0.264, abs=0.0035)
    means = averages(model_of("four", found.pump, POINTS), POINTS)
    assert all(ours < thesis for thesis, ours in means.values())


def test_what_cannot_be_fitted_is_said_at_once() -> None:
    points = [StaticPoint(Condition(4600.0, 50.0), 0.2, {})]
    box = Box("slipper.h", "um", 20.0, 30.0, 1.0e-6)
    with pytest.raises(ValueError, match=r"case_flow_lpm was not measured.*starts outside of 20 to 30"):
        joint_fit(PUMP, points, BENCH, (box,), ACCURACY)


@pytest.mark.study
def test_chapter_3_is_better_than_the_thesis_for_each_variable_at_both_tank_pressures() -> None:
    evidence = chapter_3()
    means = [row for row in evidence.rows if "mean error" in row.quantity]
    assert len(means) == 8
    assert all(row.within for row in means)
    assert {row.evidence_class for row in means} == {"fitted", "independent"}
    assert all(row.known_miss and row.note for row in evidence.rows if row.within is False)
    assert [t.title[:10] for t in evidence.tables[1:3]] == ["Table 3-10", "Table 3-11"]
