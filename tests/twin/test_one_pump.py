"""Operating point and transient are one pump: torque, spool stops, heat; and drag that warms its own films."""

import pytest

from twin.condition import Condition, Health
from twin.laws.fluid import P_ATMOSPHERE, dynamic_viscosity
from twin.operating_point import operating_point
from twin.parts.drive import OMEGA_REF, T_REF, case_temperature, viscous_torque
from twin.pumps import circuit_parameters, pump_type
from twin.simulation.run import steady_run

PUMP, BENCH = pump_type("h225").pump, circuit_parameters("shared_return")
DRIVE, FLUID = PUMP.drive, PUMP.fluid


def test_a_spool_on_its_stop_regulates_no_more_in_both() -> None:
    """A bleed of 8 L/min asks for more than the open valve gives: pressure rises until it does."""
    condition, worn = Condition(4600, 50, 0.1), Health(control_bleed_lpm=8.0)
    run = steady_run(PUMP, condition, BENCH, worn, settle_revolutions=30, mean_revolutions=4)
    point = operating_point(PUMP, condition, BENCH, worn)
    spool = run.recording["spool_position_mm"][-1]
    assert spool > PUMP.compensator.x_high * 1.0e3
    assert point.value("discharge_pressure_bar")[0] > 250.0
    for name, allowed in (("discharge_pressure_bar", 0.2), ("case_flow_lpm", 0.02), ("control_pressure_bar", 0.2)):
        assert point.value(name)[0] == pytest.approx(run.mean(name, 4), abs=allowed), name


@pytest.mark.parametrize(
    "condition",
    [
        Condition(4600, 63, 0.1),
        Condition(4600, 50, 0.0, 28.0),
        Condition(920, 40),
        Condition(2000, 80, 0.0, 3.0),
        Condition(5500, 25, 0.0, 5.0),
    ],
)
def test_the_shafts_torque_means_one_thing(condition: Condition) -> None:
    """Friction, the work that dead volumes lose and what ports throttle stand in both: a thousandth of 16 N m is left."""
    run = steady_run(PUMP, condition, BENCH)
    torque = operating_point(PUMP, condition, BENCH).value("shaft_torque_nm")[0]
    assert run.mean("shaft_torque_nm", 4) == pytest.approx(torque, abs=0.016)


@pytest.mark.parametrize("celsius", [-45.0, -20.0, 20.0, 50.0, 100.0])
@pytest.mark.parametrize("speed", [0.05, 0.5, 1.0, 1.7])
def test_films_are_as_warm_as_their_own_friction_makes_them(celsius: float, speed: float) -> None:
    T, omega = celsius + 273.15, speed * OMEGA_REF
    torque = viscous_torque(DRIVE, FLUID, T, omega)
    warmed = torque * omega / DRIVE.film_conductance
    bench = dynamic_viscosity(
        FLUID, T_REF + DRIVE.torque_viscous_ref * OMEGA_REF / DRIVE.film_conductance, P_ATMOSPHERE
    )
    ratio = dynamic_viscosity(FLUID, T + warmed, P_ATMOSPHERE) / bench
    assert torque == pytest.approx(DRIVE.torque_viscous_ref * ratio * speed, rel=1e-6)


def test_a_cold_start_asks_some_newton_metres() -> None:
    """At -20 degC the viscosity is 36 times that of 50 degC; nothing turns a pump of 16 N m with 35 N m of drag."""
    assert viscous_torque(DRIVE, FLUID, T_REF, OMEGA_REF) == pytest.approx(DRIVE.torque_viscous_ref, rel=1e-9)
    assert 2.0 < viscous_torque(DRIVE, FLUID, 253.15, OMEGA_REF) < 6.0
    assert viscous_torque(DRIVE, FLUID, 253.15, 0.0) == 0.0


def test_the_cases_heat_is_balanced() -> None:
    """What friction puts in leaves with the case flow and through the housing; nothing without friction."""
    condition = Condition(4600, 50, 0.1)
    point = operating_point(PUMP, condition, BENCH)
    dP = (point.value("discharge_pressure_bar") - point.value("case_pressure_bar"))[0] * 1.0e5
    Q_c = point.value("case_flow_lpm")[0] / 60.0e3
    friction = (DRIVE.torque_viscous_ref + DRIVE.torque_pressure * dP) * OMEGA_REF
    rho = FLUID.rho_ref + FLUID.rho_slope * (T_REF - FLUID.T_ref)
    cold = case_temperature(DRIVE, FLUID, T_REF, dP, Q_c, 0.0)
    assert cold - T_REF == pytest.approx(dP / (rho * FLUID.c_p), rel=1e-9)
    warm = point.value("case_temperature_degc")[0] + 273.15
    carried = (warm - cold) * (rho * FLUID.c_p * Q_c + DRIVE.case_conductance)
    assert carried == pytest.approx(DRIVE.heat_share * friction, rel=1e-6)
    assert 5.0 < warm - cold < 28.0
    # a drain that flows backwards carries nothing off, and the case does not boil
    assert case_temperature(DRIVE, FLUID, T_REF, dP, -Q_c, friction) < T_REF + 60.0
