"""Three answers: inside what was validated, solved outside of it and by name, no steady state at all."""

import math
from dataclasses import replace

import numpy as np
import pytest

from twin.condition import INPUTS, OUTPUTS, Condition, Health, input_rows
from twin.operating_point import operating_point, operating_points, outside, problem, validated
from twin.operating_point.validity import suction_pressure
from twin.pumps import circuit_parameters, pump_type

H225, BENCH = pump_type("h225"), circuit_parameters("shared_return")
ATMOSPHERE = 1.01325


def beyond(condition: Condition, name: str = "h225", health: Health = Health()) -> set[str]:  # noqa: B008 - immutable
    kind = pump_type(name)
    points = operating_point(kind.pump, condition, BENCH, health)
    assert problem(points, 0) is None
    return set(outside(kind, points)[0])


def test_the_thesis_test_matrix_is_inside() -> None:
    """Annex A-1: 920 to 5500 rpm, 50 and 100 degC, tank open and at 2.5 bar, zero to full flow."""
    conditions = [
        Condition(speed, T, reservoir, share * 27.0 * speed / 4600.0)
        for speed in (920.0, 3450.0, 4600.0, 5500.0)
        for T in (50.0, 100.0)
        for reservoir in (0.0, 2.5)
        for share in (0.0, 0.8)
    ]
    points = operating_points(H225.pump, input_rows(conditions, [Health()] * len(conditions)), BENCH)
    assert [problem(points, i) for i in range(len(points))] == [None] * len(points)
    assert set(outside(H225, points)) == {()}


@pytest.mark.parametrize(
    ("condition", "health", "names"),
    [
        (Condition(5600, 50), Health(), {"speed_rpm"}),
        (Condition(900, 50), Health(), {"speed_rpm"}),
        (Condition(4600, -15), Health(), {"fluid_temperature_degc"}),
        (Condition(4600, 110), Health(), {"fluid_temperature_degc"}),
        (Condition(4600, 50, 4.0), Health(), {"reservoir_pressure_bar"}),
        (Condition(4600, 50, 0.5, 0.0, 0.4), Health(), {"reservoir_pressure_bar"}),
        (Condition(4600, 50), Health(pressure_setting_change_bar=60.0), {"discharge_pressure_bar"}),
        (Condition(4600, 50), Health(drain_resistance_scale=15.0), {"case_pressure_bar"}),
        (Condition(5500, 50, 0.0, 32.0), Health(), {"discharge_flow_lpm"}),
    ],
)
def test_what_lies_outside_is_named_and_nothing_else(condition: Condition, health: Health, names: set[str]) -> None:
    assert beyond(condition, health=health) == names


def test_a_starving_pump_is_no_healthy_one() -> None:
    """8000 rpm and 45 L/min from 0.11 bar absolute: no chamber could fill."""
    starving = Condition(8000, 50, 0.11 - ATMOSPHERE, 45.0)
    assert {"suction_pressure_bar", "speed_rpm", "reservoir_pressure_bar", "discharge_flow_lpm"} <= beyond(starving)


def test_suction_pressure_falls_by_bernoulli_with_the_pistons_speed() -> None:
    piston, port = H225.pump.piston, H225.pump.port_plate
    points = operating_point(H225.pump, Condition(4600, 50, 0.2, 20.0), BENCH)
    fastest = piston.R * math.tan(math.radians(points.value("swashplate_angle_deg")[0])) * 4600 * math.pi / 30
    velocity = fastest * math.pi / 4 * piston.d_p**2 / (port.C_q * port.A_port)
    # 819 kg/m3 at 50 degC
    assert suction_pressure(H225.pump, points)[0] == pytest.approx(1.21325 - 0.5 * 819 * velocity**2 / 1e5, abs=0.002)


def test_full_tilt_needs_more_pressure_than_none() -> None:
    low = Condition(4600, 50, -0.6, 28.0)
    assert "suction_pressure_bar" in beyond(low)
    assert "suction_pressure_bar" not in beyond(low._replace(discharge_flow_lpm=5.0))
    assert "suction_pressure_bar" not in beyond(low._replace(reservoir_pressure_bar=0.0))


def test_a_gap_that_the_operating_point_does_not_know_is_said() -> None:
    """It takes the constant gap of a set whose gaps follow from forces and that no metamodel was fitted to."""
    thesis, condition = pump_type("h225_thesis"), Condition(4600, 50, 0.0, 20.0)
    other = replace(thesis, pump=thesis.pump._replace(slipper=thesis.pump.slipper._replace(balance=1.03)))
    points = operating_point(other.pump, condition, BENCH)
    assert outside(other, points) == (("slipper.variable",),)
    constant = thesis.pump._replace(slipper=other.pump.slipper._replace(variable=0.0))
    assert points.value("case_flow_lpm") == operating_point(constant, condition, BENCH).value("case_flow_lpm")
    assert beyond(condition, "h225_thesis") == set()


def test_no_absolute_pressure_below_zero_is_ever_solved() -> None:
    rng = np.random.default_rng(3)
    n = 4000
    rows = np.array(input_rows([Condition(4600, 50)] * n, [Health()] * n))
    at = {name: i for i, name in enumerate(INPUTS)}
    ambient = rng.uniform(0.02, 1.2, n)
    rows[:, at["ambient_pressure_bar"]] = ambient
    rows[:, at["reservoir_pressure_bar"]] = rng.uniform(0.1, 1.0, n) - ambient
    rows[:, at["speed_rpm"]] = rng.uniform(200, 8000, n)
    rows[:, at["fluid_temperature_degc"]] = rng.uniform(-20, 140, n)
    rows[:, at["discharge_flow_lpm"]] = rng.choice([0.0, 15.0], n)
    # worn out altogether, and a drain as wide as the case: the chambers would drink from the case
    rows[:, at["pump_leakage_scale"]] = rng.uniform(50, 100, n)
    rows[:, at["slipper_leakage_scale"]] = rng.uniform(1, 10, n)
    rows[:, at["drain_resistance_scale"]] = 10 ** rng.uniform(-2, -0.5, n)
    points = operating_points(H225.pump, rows, BENCH, derivatives=True)
    solved = points.status == 0
    pressures = [i for i, name in enumerate(OUTPUTS) if name.endswith("_pressure_bar")]
    assert len(pressures) == 4
    assert (points.values[solved][:, pressures] + ambient[solved, None] >= 0.0).all()
    # what is no steady state has no numbers, and a sentence that says why
    refused = np.flatnonzero(~solved)
    assert refused.size > n // 10
    assert all(problem(points, int(i)) for i in refused)
    assert points.derivatives is not None
    assert np.isnan(points.values[refused]).all()
    assert np.isnan(points.derivatives[refused]).all()


def test_another_pump_has_ranges_of_its_own() -> None:
    slower = replace(H225, nominal_speed_rpm=3000.0)
    assert validated(slower)["speed_rpm"] == pytest.approx((600.0, 3600.0))
    # swept volume 6.36 cm3
    assert validated(slower)["discharge_flow_lpm"][1] == pytest.approx(19.07, abs=0.01)
