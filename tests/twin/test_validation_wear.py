"""Worn pistons against table 4-3, as operating point and as transient means."""

import numpy as np
import pytest

from twin.condition import Condition, Health
from twin.operating_point import evenly_worn, operating_point
from twin.pumps import circuit_parameters
from twin.simulation.flight import quasi_steady
from twin.simulation.scenario import Scenario, Schedule
from twin.validation.wear import steady_point, transient_means, wear, wear_pump


def test_table_4_3_is_met_by_operating_point_and_transient_means() -> None:
    rows = [row for row in wear().rows if row.within is not None]
    assert len(rows) == 24
    assert sum(row.fitted for row in rows) == 12
    assert all(row.within and not row.known_miss for row in rows)


def test_uneven_wear_enters_the_operating_point_by_the_mean_of_cubes() -> None:
    healthy, worn = steady_point(0.0), steady_point(1.0)
    # three of nine at eight times: (3 * 8 + 6) / 9, less what the lower pressure takes back
    ratio = worn["piston_leakage_lpm"] / healthy["piston_leakage_lpm"]
    assert ratio == pytest.approx(30 / 9, rel=0.005)
    assert healthy["discharge_pressure_bar"] == pytest.approx(136.5, abs=0.5)


def test_a_wider_gap_lifts_the_return_pressure_by_its_drag() -> None:
    healthy, worn = transient_means(0.0), transient_means(0.5)
    # table 4-3: 0.0022 - 0.0016 bar, which leakage alone would not give
    lifted = worn["return_pressure_bar"] - healthy["return_pressure_bar"]
    assert lifted == pytest.approx(0.0006, abs=0.0002)
    steady = steady_point(0.5)["return_pressure_bar"] - steady_point(0.0)["return_pressure_bar"]
    assert steady == pytest.approx(lifted, rel=0.02)


def test_equal_pistons_leak_and_drag_what_uneven_ones_do() -> None:
    pump = wear_pump()
    clearances = np.array([0.5, 1.0, 1.0, 2.5, 1.0, 1.0, 1.0, 4.0, 1.0])
    even, scale = evenly_worn(pump, clearances)
    assert scale * even.piston.b**3 == pytest.approx(pump.piston.b**3 * (clearances**3).mean(), rel=1e-12)
    assert even.piston.b == pytest.approx(pump.piston.b * clearances.mean(), rel=1e-12)
    assert evenly_worn(pump, np.ones(9)) == (pump, 1.0)


def test_clearances_that_wear_in_a_flight_are_operating_points_of_their_instants() -> None:
    wearing = Schedule((0.0, 3.0), (1.0, 2.5))
    scenario = Scenario(
        4.0, Condition(4600.0, 50.0), changes={f"piston_clearance_scale[{k}]": wearing for k in (1, 2, 3)},
        quasi_steady=True,
    )  # fmt: skip
    (run,) = quasi_steady(wear_pump(), circuit_parameters("shared_return"), scenario, 1.0)
    for i, x in enumerate((0.5, 1.0, 1.5, 1.5)):
        even, scale = evenly_worn(wear_pump(), np.array([1.0 + x] * 3 + [1.0] * 6))
        point = operating_point(
            even, Condition(4600.0, 50.0), circuit_parameters("shared_return"), Health(piston_leakage_scale=scale)
        )
        for name in ("case_flow_lpm", "discharge_pressure_bar"):
            assert run.recording[name][i] == pytest.approx(float(point.value(name)[0]), rel=1e-9)
