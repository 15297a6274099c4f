"""The pump by other hands: it shares no line with the first, moves as the first does, and agrees in its means."""

import ast
from pathlib import Path

import numpy as np
import pytest

from benchmarks.referee import problem
from benchmarks.second_model import NOMINAL, compared, conditions
from twin.condition import Condition, Health
from twin.parts.drive import viscous_torque
from twin.pumps import circuit_parameters, pump_type
from twin.simulation.layout import ALPHA, ALPHA_DOT, N_SHARED, P_D, THETA, V_SPOOL, X
from twin.simulation.run import steady_run
from twin.validation import second_model
from twin.validation.second_model import SecondPump, Where

PUMP, BENCH = pump_type("h225").pump, circuit_parameters("shared_return")


def test_it_imports_nothing_of_this_project() -> None:
    tree = ast.parse(Path(second_model.__file__).read_text(encoding="utf-8"))
    names = {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    names |= {alias.name for n in ast.walk(tree) if isinstance(n, ast.Import) for alias in n.names}
    assert {str(name).split(".")[0] for name in names} == {"collections", "dataclasses", "numpy", "scipy"}


@pytest.mark.parametrize(
    ("condition", "health"),
    [
        (Condition(4600.0, 50.0), Health()),
        (
            Condition(3300.0, 75.0, 1.2, 11.0),
            Health(
                pump_leakage_scale=1.5,
                system_leakage_lpm=1.0,
                drain_resistance_scale=1.2,
                pressure_setting_change_bar=2.0,
            ),
        ),
    ],
)
def test_it_moves_as_the_first_does_from_the_same_states(condition: Condition, health: Health) -> None:
    """dy/dt of both at forty states of a revolution: 0.1 % of each state's liveliest rate."""
    run = steady_run(PUMP, condition, BENCH, health, settle_revolutions=20, mean_revolutions=1, keep_states=True)
    n = int(PUMP.piston.n)
    p = problem(PUMP, BENCH, condition, health)
    numbers = {part: getattr(PUMP, part)._asdict() for part in PUMP._fields} | {"circuit": BENCH._asdict()}
    where = Where(
        *condition, health.pump_leakage_scale, health.slipper_leakage_scale, health.system_leakage_lpm,
        health.pressure_setting_change_bar, health.drain_resistance_scale,
    )  # fmt: skip
    second = SecondPump(numbers, where)
    firsts, seconds = [], []
    for state in run.states[-200::5]:
        dy = np.empty_like(state)
        p.rates(0.0, state / p.scale, dy)
        dy *= p.scale
        chambers = slice(N_SHARED, N_SHARED + n)
        own = [*dy[P_D : P_D + 4] / 1e5, dy[X] * 1e3, dy[V_SPOOL], dy[ALPHA], dy[ALPHA_DOT], *dy[chambers] / 1e5]
        y = [*state[P_D : P_D + 4] / 1e5, state[X] * 1e3, state[V_SPOOL], state[ALPHA], state[ALPHA_DOT],
             *state[chambers] / 1e5]  # fmt: skip
        firsts.append(own)
        seconds.append(second.rates(np.array(y), state[THETA] / second.omega))
    first, other = np.array(firsts), np.array(seconds)
    liveliest = np.abs(first).max(axis=0)
    assert (np.abs(other - first).max(axis=0) < 1e-3 * liveliest).all()


def test_its_jacobian_is_that_of_its_rates() -> None:
    numbers = {part: getattr(PUMP, part)._asdict() for part in PUMP._fields} | {"circuit": BENCH._asdict()}
    pump = SecondPump(numbers, Where(4600.0, 50.0, 0.0, 5.0))
    y = pump.start({"discharge_pressure_bar": 173.0, "case_pressure_bar": 0.5, "return_pressure_bar": 0.3,
                    "control_pressure_bar": 60.0, "swashplate_angle_deg": 3.0})  # fmt: skip
    move = 1e-5 * np.random.default_rng(2).normal(size=len(y)) * np.maximum(np.abs(y), 1e-2)
    difference = pump.rates(y + move, 1e-3) - pump.rates(y - move, 1e-3)
    slopes = pump.slopes(y, 1e-3)
    size = np.abs(slopes) @ np.abs(2.0 * move) + 1e-9
    assert (np.abs(slopes @ (2.0 * move) - difference) < 0.02 * size).all()


@pytest.mark.parametrize("speed_rpm", [1500.0, 4600.0])
@pytest.mark.parametrize("fluid_temperature_degc", [-20.0, 50.0, 95.0])
def test_its_films_drag_as_the_firsts_do(speed_rpm: float, fluid_temperature_degc: float) -> None:
    numbers = {part: getattr(PUMP, part)._asdict() for part in PUMP._fields} | {"circuit": BENCH._asdict()}
    second = SecondPump(numbers, Where(speed_rpm, fluid_temperature_degc, 0.0, 5.0))
    first = viscous_torque(PUMP.drive, PUMP.fluid, fluid_temperature_degc + 273.15, second.omega)
    assert second.viscous_torque() == pytest.approx(first, rel=1e-6)


@pytest.mark.study
def test_means_agree_within_a_thousandth_at_random_conditions() -> None:
    for condition, health in conditions(3):
        found = compared(condition, health)
        assert set(found) == set(NOMINAL)
        assert max(abs(v) for v in found.values()) < 1e-3
