"""No absolute pressure below zero is ever solved: cavities open, volumes that run dry end a run by name."""

import numpy as np
import pytest

from twin.condition import Condition, Health
from twin.laws.compressibility import P_FLOOR
from twin.operating_point import operating_point, problem
from twin.pumps import circuit_parameters, pump_type
from twin.simulation.layout import ALPHA_DOT, P_C, P_CTRL, P_D, P_I, SPOOL_SPEED, TILT_RATE
from twin.simulation.run import simulate, steady_run
from twin.simulation.scenario import Scenario, Schedule
from twin.simulation.scene import Scene, scene_of
from twin.simulation.shared import bleed_ahead
from twin.simulation.start import starting_state
from twin.units import M3_PER_S_PER_LPM, PA_PER_BAR

PUMP, LIFTED = pump_type("h225").pump, pump_type("h225_thesis").pump
BENCH = circuit_parameters("shared_return")
PRESSURES = ("discharge_pressure_bar", "case_pressure_bar", "return_pressure_bar", "control_pressure_bar")
VOLUMES = ("discharge pressure", "case pressure", "return pressure")


def drawn(rng: np.random.Generator) -> Scenario:
    """Anything that the ranges allow: starving reservoirs, bleeds of many times the valve, loads that come and go."""
    condition = Condition(
        rng.uniform(500.0, 7500.0), rng.uniform(-20.0, 110.0), rng.uniform(-0.9, 2.5), ambient_pressure_bar=1.01325
    )
    health = Health(
        pump_leakage_scale=float(np.exp(rng.uniform(-1.0, 2.5))),
        control_bleed_lpm=rng.choice([0.0, 2.0, 20.0]) * rng.random(),
        system_leakage_lpm=rng.choice([0.0, 10.0]) * rng.random(),
        droop_scale=float(np.exp(rng.uniform(-1.0, 1.0))),
    )
    # full delivery is 0.0063 L/min per rpm
    high = rng.uniform(0.0, 0.013) * condition.speed_rpm
    load = Schedule((0.0, 0.008, 0.009, 0.02), (0.0, 0.0, high, high))
    return Scenario(0.03, condition, health, {"discharge_flow_lpm": load})


@pytest.mark.parametrize("seed", range(40))
def test_whatever_is_asked_ends_above_vacuum_or_by_name(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scenario = drawn(rng)
    try:
        y, _ = starting_state(PUMP, BENCH, scenario.table(9)[1][0])
        # a plate that was hit pulls and pushes on its control volume
        y[ALPHA_DOT] = rng.uniform(-80.0, 80.0)
        run = simulate(PUMP, BENCH, scenario, initial_state=y)
    except ValueError as fault:
        assert "no operating point to start from" in str(fault)  # noqa: PT017 - a start that is none is an answer too
        return
    for name in PRESSURES:
        values = run.recording[name]
        assert np.isfinite(values).all(), name
        assert values.min() >= -scenario.condition.ambient_pressure_bar - 1e-9, name
    if not run.status.ok:
        assert run.status.worst_state in VOLUMES
        assert "ran dry" in run.status.advice


@pytest.mark.parametrize("bleed", [10.0, 12.0])
def test_a_large_bleed_is_one_answer_in_both_speeds(bleed: float) -> None:
    """The valve is open to its stop and the pressure rises until it feeds the bleed."""
    condition, worn = Condition(4600, 50), Health(control_bleed_lpm=bleed)
    run = steady_run(PUMP, condition, BENCH, worn, settle_revolutions=60)
    point = operating_point(PUMP, condition, BENCH, worn)
    assert problem(point, 0) is None
    assert run.recording["spool_position_mm"].min() > PUMP.compensator.x_high * 1.0e3
    assert point.value("discharge_pressure_bar")[0] == pytest.approx(run.mean("discharge_pressure_bar", 4), rel=3e-3)
    assert point.value("case_flow_lpm")[0] == pytest.approx(run.mean("case_flow_lpm", 4), rel=3e-3)
    assert point.value("control_pressure_bar")[0] == pytest.approx(run.mean("control_pressure_bar", 4), abs=0.4)


def test_a_bleed_stops_where_the_case_begins() -> None:
    """15 L/min took the control volume to -13 bar absolute; nothing flows out of it against the case's pressure."""
    worn = Health(control_bleed_lpm=15.0)
    run = steady_run(PUMP, Condition(4600, 50), BENCH, worn, settle_revolutions=30)
    assert run.status.ok
    assert (run.recording["control_pressure_bar"] - run.recording["case_pressure_bar"]).min() > 0.0


def test_a_plate_that_pulls_on_its_control_volume_opens_a_cavity() -> None:
    """The volume shows the floor while fluid is missing, is filled again, and all is as if nothing had been."""
    scenario = Scenario(0.25, Condition(4600, 50, 0.0, 15.0))
    _, table = scenario.table(9)
    y, _ = starting_state(PUMP, BENCH, table[0])
    y[ALPHA_DOT] = -60.0
    run = simulate(PUMP, BENCH, scenario, initial_state=y)
    control = (run.recording["control_pressure_bar"] + 1.01325) * PA_PER_BAR
    assert run.status.ok
    assert control.min() == pytest.approx(P_FLOOR)
    assert (control <= P_FLOOR * 1.001).sum() > 3
    calm = simulate(PUMP, BENCH, scenario)
    for name in ("control_pressure_bar", "swashplate_angle_deg", "discharge_pressure_bar"):
        assert run.mean(name, 4) == pytest.approx(calm.mean(name, 4), rel=2e-3), name


def test_the_bleed_of_a_step_is_that_of_its_end() -> None:
    """With everything else standing the step solves C (P' - P) = -Q tanh((P' - P_c) / faded) to rounding."""
    row = np.zeros(60)
    scenario = Scenario(0.01, Condition(4600, 50), Health(control_bleed_lpm=15.0))
    row = scenario.table(9)[1][0]
    scene: Scene = scene_of(PUMP, BENCH, row)
    faded = 0.05 * PUMP.servo.F_rate / PUMP.servo.A_stroke
    for start, C in ((8.0, 1e-12), (40.0, 5e-11), (6.1, 1e-13), (2.0, 5e-11), (300.0, 1e-13)):
        y = np.zeros(20)
        y[[P_D, P_C, P_I, P_CTRL]] = np.array([170.0, 6.0, 2.0, start]) * PA_PER_BAR
        A, b = np.eye(6), np.zeros(6)
        A[P_CTRL, P_CTRL], b[P_CTRL] = C, C * y[P_CTRL]
        A[P_CTRL, [SPOOL_SPEED, TILT_RATE]] = 0.0
        k, g = bleed_ahead(PUMP, scene, y, A, b)
        end = (b[P_CTRL] - A[P_CTRL, P_C] * y[P_C]) / A[P_CTRL, P_CTRL]
        flow = 15.0 * M3_PER_S_PER_LPM * np.tanh((end - y[P_C]) / faded)
        assert k + g * (end - y[P_C]) == pytest.approx(flow, rel=1e-6, abs=1e-12)
        assert C * (y[P_CTRL] - end) == pytest.approx(flow, rel=1e-6, abs=1e-12)
        assert b[P_C] == k


def test_slippers_that_lift_pull_no_fluid_either() -> None:
    """Pockets stood at -5 bar absolute at 5500 rpm: a cavity holds less, so that the case is asked for less."""
    run = steady_run(LIFTED, Condition(5500, 30, -0.5, 25.0), BENCH, settle_revolutions=3, mean_revolutions=2)
    assert run.status.ok
    for name in PRESSURES:
        assert run.recording[name].min() >= -1.01325, name
