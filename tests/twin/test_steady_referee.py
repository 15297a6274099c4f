"""The compiled residuals of the operating point against the same pump in plain Python (``steady_referee``)."""

import numpy as np
import pytest
from scipy.optimize import root

from tests.twin.commutation_referee import Commutation
from tests.twin.steady_referee import Answer, Change, steady
from twin.condition import OUTPUTS, Condition, Health, input_rows
from twin.laws.metering_edge import MARE, SMOOTH
from twin.operating_point import operating_point
from twin.operating_point.equations import N_UNKNOWNS, commute, evaluate, warmth_of
from twin.operating_point.solver import WORK_ROWS, solve_cold
from twin.parameters import Circuit, Pump
from twin.parts.slipper_map import NO_MAP
from twin.pumps import circuit_parameters, pump_type

SCALES = {"delivery": 1.0e-4, "drain": 1.0e5, "balance": 100.0, "control": 1.0e-5, "demand": 1.0e-4}
"""What a residual is small against: flows of some L/min, bars, newtons."""
UNKNOWNS = np.array([1.0e7, 1.0e5, 0.1, 1.0e-3, 1.0e-4])
"""Sizes of the unknowns."""
RESISTANCE = 4.0e14
"""A load of some 12 L/min at 170 bar [Pa/(m3/s)^2]."""


def cases(n: int, seed: int) -> list[tuple[Pump, Circuit, Condition, Health, float]]:
    """Random pumps of two edge laws in all circuits, conditions, healths; every third with a load that is a resistance."""
    rng = np.random.default_rng(seed)
    found = []
    for i in range(n):
        pump = pump_type(("h225", "h225_thesis")[i % 2]).pump
        # a variable gap has a metamodel, and that a referee of its own
        pump = pump._replace(slipper=pump.slipper._replace(variable=0.0))
        pump = pump._replace(compensator=pump.compensator._replace(edge_law=float((SMOOTH, MARE)[i // 2 % 2])))
        if i % 5 == 0:
            pump = pump._replace(fluid=pump.fluid._replace(air=0.005))
        circuit = circuit_parameters(("shared_return", "separate_drain", "acceptance_stand")[i % 3])
        condition = Condition(
            *(
                rng.uniform(2500, 5500),
                rng.uniform(20, 100),
                rng.uniform(0, 2.5),
                rng.uniform(0, 12),
                rng.uniform(0.6, 1.05),
            )
        )
        health = Health(
            pump_leakage_scale=rng.uniform(0.6, 2.0),
            slipper_leakage_scale=rng.uniform(0.8, 1.6),
            piston_leakage_scale=10.0 ** rng.uniform(-0.3, 0.8),
            port_plate_leakage_scale=rng.uniform(0.5, 2.0),
            control_bleed_lpm=rng.uniform(0.0, 0.1),
            system_leakage_lpm=rng.uniform(0.0, 3.0),
            pressure_setting_change_bar=rng.uniform(-3.0, 3.0),
            drain_resistance_scale=rng.uniform(0.8, 1.4),
            drain_viscosity_weight_change=rng.uniform(-0.2, 0.2),
            drain_flow_weight_change=rng.uniform(-0.2, 0.2),
            droop_scale=10.0 ** rng.uniform(-0.5, 0.5),
            throttled_leakage_lpm=rng.uniform(0.0, 1.0),
            edge_rounding_um=rng.uniform(0.0, 40.0),
        )
        found.append((pump, circuit, condition, health, RESISTANCE if i % 3 == 2 else 0.0))
    return found


def solved(pump: Pump, circuit: Circuit, row: np.ndarray, k_d: float) -> np.ndarray:
    """Unknowns of the compiled solution."""
    u, Y, work = np.empty(N_UNKNOWNS), np.empty(len(OUTPUTS)), np.empty((WORK_ROWS, N_UNKNOWNS))
    assert solve_cold(pump, NO_MAP, circuit, row, k_d, u, Y, work)
    return u


def both(
    case: tuple[Pump, Circuit, Condition, Health, float], row: np.ndarray, u: np.ndarray
) -> tuple[np.ndarray, np.ndarray, Answer]:
    """Compiled residuals and outputs at ``u``, and the referee's with the same commutations."""
    pump, circuit, condition, health, k_d = case
    warmth = warmth_of(pump, row)
    passing = commute(pump, NO_MAP, warmth, row, u)
    F, Y = np.empty(N_UNKNOWNS), np.empty(len(OUTPUTS))
    evaluate(pump, circuit, warmth, passing, row, k_d, u, F, Y)
    return F, Y, steady(pump, circuit, condition, health, k_d, tuple(u.tolist()), Change(*passing.changes))


@pytest.mark.parametrize("index", range(40))
def test_residuals_and_outputs_are_those_of_the_equations(index: int) -> None:
    """At the solution, near it and beyond the tilt stop: to what the compiled exponential of viscosity leaves, 1e-9."""
    case = cases(40, 11)[index]
    pump, circuit, condition, health, k_d = case
    row = input_rows([condition], [health])[0]
    u = solved(pump, circuit, row, k_d)
    rng = np.random.default_rng(index)
    places = [u, u + UNKNOWNS * rng.uniform(-0.02, 0.02, N_UNKNOWNS), u.copy()]
    places[2][2] = pump.swashplate.alpha_max + 0.02
    for place in places:
        F, Y, answer = both(case, row, place)
        for residual, (name, scale) in zip(F, SCALES.items(), strict=True):
            size = 1.0e7 if name == "demand" and k_d > 0.0 else scale
            assert residual == pytest.approx(answer.residuals[name], rel=1e-8, abs=1e-8 * size), name
        assert list(answer.outputs) == list(OUTPUTS)
        assert pytest.approx(list(answer.outputs.values()), rel=1e-8, abs=1e-9) == Y


@pytest.mark.parametrize("index", range(12))
def test_another_solver_finds_the_same_pump_in_the_plain_equations(index: int) -> None:
    """MINPACK's hybrid method on the referee, from a start that is off by some per cent."""
    case = cases(12, 5)[index]
    pump, circuit, condition, health, k_d = case
    row = input_rows([condition], [health])[0]
    u = solved(pump, circuit, row, k_d)
    warmth = warmth_of(pump, row)
    sizes = np.array(list(SCALES.values()))
    if k_d > 0.0:
        sizes[-1] = 1.0e7

    def residuals(z: np.ndarray) -> np.ndarray:
        place = z * UNKNOWNS
        change = Change(*commute(pump, NO_MAP, warmth, row, place).changes)
        answer = steady(pump, circuit, condition, health, k_d, tuple(place.tolist()), change)
        return np.array(list(answer.residuals.values())) / sizes

    found = root(residuals, u / UNKNOWNS * 1.01, method="hybr", options={"xtol": 1e-12})
    assert np.abs(residuals(found.x)).max() < 1e-8
    assert found.x == pytest.approx(u / UNKNOWNS, rel=1e-7, abs=1e-8)
    point = operating_point(pump, condition, circuit, health, load_coefficient=k_d)
    place = found.x * UNKNOWNS
    said = steady(
        pump,
        circuit,
        condition,
        health,
        k_d,
        tuple(place.tolist()),
        Change(*commute(pump, NO_MAP, warmth, row, place).changes),
    )
    assert point.values[0] == pytest.approx(list(said.outputs.values()), rel=1e-7, abs=1e-7)


def test_commutations_are_those_of_fine_steps_and_many_rounds() -> None:
    """Angles within 0.12 degrees and their sum within 0.06 (rms), ripple within 4 %, fluid drawn within 5 %."""
    sums = []
    for pump, circuit, condition, health, k_d in cases(12, 3):
        row = input_rows([condition], [health])[0]
        u = solved(pump, circuit, row, k_d)
        found = commute(pump, NO_MAP, warmth_of(pump, row), row, u).changes
        fine = Commutation(pump, condition, health, tuple(u.tolist())).solve()
        assert (found.rising, found.falling) == pytest.approx((fine.rising, fine.falling), abs=2.0e-3)
        assert found.ripple == pytest.approx(fine.ripple, rel=0.04)
        assert found.drawn == pytest.approx(fine.drawn, rel=0.05)
        sums.append(found.rising + found.falling - fine.rising - fine.falling)
    assert np.sqrt(np.mean(np.square(sums))) < 1.0e-3
