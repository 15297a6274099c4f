"""Order surfaces: against the transient pump at conditions that were not fitted, their symmetries and their refusals."""

import numpy as np
import pytest

from benchmarks.burst_surrogate import lines, uneven
from twin.condition import INPUTS, Condition, Health, input_rows
from twin.orders.surfaces import SURFACES, order_amplitudes, order_derivatives, order_surfaces
from twin.pumps import pump_type

PUMP = pump_type("h225").pump
N = int(PUMP.piston.n)
ROW = input_rows([Condition(4600, 50, 0.5)], [Health()])


def test_transient_pump_shows_what_the_surfaces_say() -> None:
    """Held-out errors: 1.2 % (95 %) at orders n and 2 n, 2 % at order 1 of a worn slipper; 3 mbar and 3 % are asked."""
    for condition, health, gaps in (
        (Condition(4550, 67, 0.8), Health(slipper_leakage_scale=1.4, system_leakage_lpm=1.0), [1.5] + [1.0] * 8),
        (
            Condition(4700, 35, 0.2),
            Health(pump_leakage_scale=0.8, drain_resistance_scale=1.3),
            [1.0, 1.0, 1.9] + [1.0] * 6,
        ),
        (Condition(4600, 90, 1.5), Health(control_bleed_lpm=0.1, droop_scale=0.5), [1.4, 1.4, 1.2] + [1.0] * 6),
    ):
        true = np.abs(lines(condition, health, uneven(gaps, [1.0] * N))[0])
        told = order_amplitudes(order_surfaces(), PUMP, input_rows([condition], [health]), np.array(gaps))[0]
        for j in (0, 2, 4):
            assert told[0, j] == pytest.approx(true[0, j], rel=0.03, abs=0.0005)
        assert told[1] == pytest.approx(true[1], rel=0.03, abs=0.003)


def test_an_even_pump_draws_no_line_of_the_shaft() -> None:
    told = order_amplitudes(order_surfaces(), PUMP, ROW, np.full(N, 1.3), np.full(N, 2.0))[0]
    assert np.all(told[:, [0, 1, 3]] < 1e-9)


def test_unevenness_adds_as_vectors() -> None:
    """Three of nine worn alike, 120 degrees apart, cancel; which one of nine it is cannot be told from an amplitude."""
    spread, first, fifth = np.ones(N), np.ones(N), np.ones(N)
    spread[[0, 3, 6]], first[0], fifth[4] = 1.6, 1.6, 1.6
    told = order_amplitudes(order_surfaces(), PUMP, np.repeat(ROW, 3, axis=0), np.array([spread, first, fifth]))
    assert told[0, 0, 0] < 1e-9
    assert told[1] == pytest.approx(told[2])
    assert told[1, 0, 0] > 0.1


def test_only_leakage_moves_order_n_not_the_drain() -> None:
    """Feasibility table: drain +30 % 0.0 mbar, slipper leakage and system leakage some millibars."""
    healths = [
        Health(), Health(drain_resistance_scale=1.3), Health(slipper_leakage_scale=1.83), Health(system_leakage_lpm=3.0),
    ]  # fmt: skip
    told = 1e3 * order_amplitudes(order_surfaces(), PUMP, input_rows([Condition(4600, 50, 0.5)] * 4, healths))[:, 0, 2]
    change = told - told[0]
    assert abs(change[1]) < 0.15
    assert change[2] > 2.5
    assert change[3] > 1.5


def test_derivatives_foretell_a_small_change() -> None:
    gaps = np.ones(N)
    gaps[2] = 1.5
    slopes = order_derivatives(order_surfaces(), PUMP, ROW, gaps)[0]
    base = order_amplitudes(order_surfaces(), PUMP, ROW, gaps)[0]
    for name, change in (("fluid_temperature_degc", 1.0), ("pump_leakage_scale", 0.03), ("system_leakage_lpm", 0.1)):
        moved = ROW.copy()
        moved[0, INPUTS.index(name)] += change
        difference = order_amplitudes(order_surfaces(), PUMP, moved, gaps)[0] - base
        assert difference == pytest.approx(slopes[..., INPUTS.index(name)] * change, rel=0.1, abs=2e-6)


def test_outside_the_fitted_range_the_edge_is_held() -> None:
    at = [Condition(4600, t, 0.5) for t in (130.0, 140.0)]
    told = order_amplitudes(order_surfaces(), PUMP, input_rows(at, [Health(slipper_leakage_scale=50.0)] * 2))
    assert np.isfinite(told).all()
    assert np.all(told < 1.0)


def test_refuses_all_faults_in_one_message() -> None:
    flowing = input_rows([Condition(4600, 50, 0.5, 10.0)], [Health()])
    with pytest.raises(ValueError, match=r"zero flow only.*slipper_gaps must be positive.*piston_clearances must have"):
        order_amplitudes(order_surfaces(), PUMP, flowing, np.zeros(N), np.ones(4))
    with pytest.raises(ValueError, match="rows must have shape"):
        order_amplitudes(order_surfaces(), PUMP, np.ones((2, 3)))
    with pytest.raises(ValueError, match="no order surfaces were fitted"):
        order_surfaces("h225", "separate_drain")


def test_data_have_one_row_per_surface() -> None:
    assert order_surfaces().coefficients.shape[0] == len(SURFACES)
