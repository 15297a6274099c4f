"""The metamodel of the slipper gap: one answer from one parameter set, within what is stated, and a word beyond it."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from tests.twin.test_validity import BENCH
from twin.condition import Condition, Health, input_rows
from twin.metamodel import held_run, places
from twin.metamodel.fit import LEAKAGE, features, predict
from twin.operating_point import operating_point, operating_points, outside
from twin.parameters import Pump
from twin.parts.slipper_map import (
    ANSWERS,
    AXES,
    FROM_DISCHARGE,
    FROM_SUCTION,
    MEAN_GAP,
    OVER_SUCTION,
    throttle_capacity,
)
from twin.pumps import circuit_parameters, pump_type
from twin.simulation.run import simulate, steady_run
from twin.simulation.scenario import Scenario, Schedule
from twin.slipper_maps import document_of, gap_numbers_hash, map_from, register, stored_map

THESIS = pump_type("h225_thesis")


def changed(pump: Pump, block: str, **numbers: float) -> Pump:
    return pump._replace(**{block: getattr(pump, block)._replace(**numbers)})


@pytest.mark.parametrize("flow", [20.0, 0.0])
def test_both_speeds_of_the_twin_give_the_same_pump(flow: float) -> None:
    """4600 rpm, 50 degC: the constant gap of table 3-9 leaked 2.706 L/min at 20 L/min, the transient 0.042."""
    stored = stored_map(THESIS.pump)
    assert stored is not None
    condition = Condition(4600, 50, 0.0, flow)
    run = steady_run(THESIS.pump, condition, BENCH, settle_revolutions=20, mean_revolutions=4)
    point = operating_point(THESIS.pump, condition, BENCH)
    allowed = stored.errors[LEAKAGE]["largest"]
    mapped = steady_run(THESIS.pump, condition, BENCH, slipper_gaps="metamodel")
    assert mapped.status.ok
    assert mapped.status.outside == ()
    for name, least in (("case_flow_lpm", allowed), ("case_pressure_bar", 0.4 * allowed), ("discharge_flow_lpm", 1e-6)):
        assert mapped.mean(name, 4) == pytest.approx(run.mean(name, 4), abs=least), name
    assert mapped.mean("discharge_pressure_bar", 4) == pytest.approx(run.mean("discharge_pressure_bar", 4), abs=0.3)
    assert mapped.mean("shaft_torque_nm", 4) == pytest.approx(run.mean("shaft_torque_nm", 4), abs=0.2)
    # the same metamodel in both speeds: nearer to each other than either is to the resolved gaps
    for name, least in (("case_flow_lpm", 0.005), ("case_pressure_bar", 0.002), ("swashplate_angle_deg", 0.005)):
        assert mapped.mean(name, 4) == pytest.approx(point.value(name)[0], abs=least), name
    assert point.value("case_flow_lpm")[0] == pytest.approx(run.mean("case_flow_lpm", 4), abs=allowed)
    assert point.value("case_pressure_bar")[0] == pytest.approx(run.mean("case_pressure_bar", 4), abs=0.4 * allowed)
    assert point.value("discharge_pressure_bar")[0] == pytest.approx(run.mean("discharge_pressure_bar", 4), abs=0.3)
    assert point.value("swashplate_angle_deg")[0] == pytest.approx(run.mean("swashplate_angle_deg", 4), abs=0.1)
    assert point.value("shaft_torque_nm")[0] == pytest.approx(run.mean("shaft_torque_nm", 4), abs=0.2)


def test_runs_that_nobody_has_fitted_lie_within_the_stated_error() -> None:
    """Nine in ten of fresh places; the stated largest error is one of 200 runs, so a tenth more is allowed."""
    stored = stored_map(THESIS.pump)
    assert stored is not None
    axes = places(THESIS, 12, 7)
    assert axes.shape == (12, len(AXES))
    truth = np.array([held_run(THESIS.pump, circuit_parameters("separate_drain"), a) for a in axes])
    found = predict(THESIS.pump, stored.model, axes)
    off = np.abs((found - truth)[:, [FROM_DISCHARGE, FROM_SUCTION]].sum(axis=1))
    assert off.max() < 1.1 * stored.errors[LEAKAGE]["largest"]
    assert np.median(off) < stored.errors[LEAKAGE]["p95"]
    gaps = np.abs(found - truth)[:, MEAN_GAP]
    assert np.quantile(gaps, 0.9) < 1.5 * stored.errors["mean_gap_um"]["p95"]


def test_the_kernel_is_a_gaussian_process() -> None:
    """Matern's function of order 5/2 in plain numpy; the flow from the case is a share of the throttles' capacity."""
    stored = stored_map(THESIS.pump)
    assert stored is not None
    model = stored.model
    axes = places(THESIS, 5, 9)
    x = (features(THESIS.pump, axes) - model.centre) * model.per_length
    r = math.sqrt(5.0) * np.linalg.norm(x[:, None, :] - model.nodes[None, :, :], axis=2)
    expected = model.mean + ((1.0 + r + r**2 / 3.0) * np.exp(-r)) @ model.weights
    expected[:, FROM_SUCTION] *= [throttle_capacity(THESIS.pump, a[OVER_SUCTION]) for a in axes]
    assert predict(THESIS.pump, model, axes) == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_derivatives_follow_the_metamodel() -> None:
    condition, d = Condition(4400, 60, 0.3, 6.0), 1.0e-3
    point = operating_point(THESIS.pump, condition, BENCH, derivatives=True)
    for name, step in (("fluid_temperature_degc", 1.0), ("slipper_leakage_scale", 1.0), ("speed_rpm", 100.0)):
        health = Health()
        if name in Condition._fields:
            conditions = [condition._replace(**{name: getattr(condition, name) + s * d * step}) for s in (-1, 1)]
            healths = [health, health]
        else:
            conditions = [condition, condition]
            healths = [health._replace(**{name: 1.0 + s * d * step}) for s in (-1, 1)]
        both = operating_points(THESIS.pump, input_rows(conditions, healths), BENCH).value("case_flow_lpm")
        assert point.derivative("case_flow_lpm", name)[0] == pytest.approx(
            (both[1] - both[0]) / (2 * d * step), rel=1e-3
        )


def test_a_metamodel_belongs_to_the_numbers_that_it_was_fitted_to() -> None:
    """Rings and seals leak beside the slippers; whatever lifts a slipper is another gap."""
    known = gap_numbers_hash(THESIS.pump)
    for block, number in (("piston", "b"), ("slipper", "h"), ("port_plate", "h"), ("compensator", "d_bleed")):
        assert gap_numbers_hash(changed(THESIS.pump, block, **{number: 7.0e-6})) == known, number
    for block, number in (("slipper", "balance"), ("slipper", "d_throttle"), ("piston", "m"), ("fluid", "astm_b")):
        other = changed(THESIS.pump, block, **{number: 1.01 * getattr(getattr(THESIS.pump, block), number)})
        assert gap_numbers_hash(other) != known, number
        assert stored_map(other) is None
    assert stored_map(pump_type("h225").pump) is None


def test_beyond_the_runs_that_were_fitted_is_said() -> None:
    conditions = [Condition(4600, 50, 0.0, 20.0), Condition(4600, 50)]
    worn = [Health(), Health(slipper_leakage_scale=20.0)]
    points = operating_points(THESIS.pump, input_rows(conditions, worn), BENCH)
    assert [("slipper.metamodel" in words) for words in outside(THESIS, points)] == [False, True]


def test_a_registered_document_is_read_again() -> None:
    stored = stored_map(THESIS.pump)
    assert stored is not None
    other = replace(THESIS, pump=changed(THESIS.pump, "slipper", balance=1.0301))
    read = map_from(json.loads(json.dumps(document_of(stored))))
    assert np.allclose(read.model.weights, stored.model.weights, rtol=1e-8)
    register(replace(read, fitted_to=gap_numbers_hash(other.pump)))
    found = stored_map(other.pump)
    assert found is not None
    assert found.errors == stored.errors
    with pytest.raises(ValueError, match="nodes is missing") as error:
        map_from({"fitted_to": "x"})
    assert "weights is missing" in str(error.value)
    with pytest.raises(ValueError, match="mean must have shape"):
        map_from({**document_of(stored), "mean": [1.0] * (len(ANSWERS) + 1)})


def test_a_load_step_by_the_metamodel_keeps_its_fluid_and_says_where_it_was_outside() -> None:
    """What is drawn in leaves by load, drain and leak; twenty times the slippers' leakage is beyond every run."""
    opened = Schedule((0.0, 0.02, 0.021, 0.06), (4.0, 4.0, 18.0, 18.0))
    condition = Condition(4600, 50)
    worn = Scenario(0.3, condition, Health(slipper_leakage_scale=1.5), {"discharge_flow_lpm": opened})
    run = simulate(THESIS.pump, BENCH, worn, slipper_gaps="metamodel", sample_rate_hz=2000.0)
    assert run.status.ok
    # the pressures' swing after the step is beyond the runs, what it settles to is among them
    assert 0.0 < run.status.outside_s < 0.1
    assert run.status.outside_from_s > 0.02
    leaves = run.mean("discharge_flow_lpm", 4) + run.mean("case_flow_lpm", 4)
    # over four revolutions that are no whole number of steps: 0.06 L/min
    assert run.mean("suction_flow_lpm", 4) == pytest.approx(leaves, rel=5e-3)
    far = Scenario(0.05, condition, Health(slipper_leakage_scale=20.0))
    run = simulate(THESIS.pump, BENCH, far, slipper_gaps="metamodel")
    assert run.status.outside == ("slipper.metamodel",)
    assert run.status.outside_s == pytest.approx(0.05, abs=0.003)
    assert run.status.outside_from_s == 0.0
    assert "beyond its runs" in run.status.advice


def test_a_set_without_a_metamodel_is_not_run_by_one() -> None:
    scenario = Scenario(0.01, Condition(4600, 50))
    with pytest.raises(ValueError, match="the gaps of this set are constant"):
        simulate(pump_type("h225").pump, BENCH, scenario, slipper_gaps="metamodel")
    with pytest.raises(ValueError, match="none was fitted"):
        simulate(changed(THESIS.pump, "slipper", balance=1.04), BENCH, scenario, slipper_gaps="metamodel")
    with pytest.raises(ValueError, match=r"slipper_gaps = 'guessed' \(known: resolved, metamodel\)"):
        simulate(THESIS.pump, BENCH, scenario, slipper_gaps="guessed")
