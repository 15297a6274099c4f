"""Forms that the kernels take for speed equal what they stand for: powers, small angles, air, derivatives in common."""

import math

import numpy as np
import pytest

from twin.condition import Condition, Health
from twin.laws.compressibility import (
    P_FLOOR,
    Medium,
    density_and_slope,
    medium_of,
    power,
    pressure_of,
    relative_compressibility,
    relative_density,
)
from twin.laws.fluid import P_ATMOSPHERE, bulk_modulus
from twin.operating_point import operating_point
from twin.parts.port_plate import opened_share
from twin.pumps import circuit_parameters, pump_type
from twin.simulation.turning import past_dead_centre, small_turn, tangent_after

KIND, BENCH = pump_type("h225"), circuit_parameters("shared_return")
AIRY = KIND.pump.fluid._replace(air=0.01)


def test_a_power_is_the_library_s_within_a_billionth() -> None:
    rng = np.random.default_rng(1)
    for x, exponent in zip(np.exp(rng.uniform(-9, 9, 300)), rng.uniform(0.5, 1.0, 300), strict=True):
        assert power(float(x), float(exponent)) == pytest.approx(x**exponent, rel=2e-9)


def written(m: Medium, P: float) -> float:
    """Density over ambient with the air's volume by the library's power."""
    B = m.B_0 + m.gain * (P - P_ATMOSPHERE)
    liquid = 1.0 + (P - P_ATMOSPHERE) / B
    return float((1.0 + m.air) / (1.0 / liquid + m.air * (P_ATMOSPHERE / P) ** m.inverse_exponent))


def test_air_is_polytropic_and_mass_gives_its_pressure_back() -> None:
    """Density as written by hand, its slope by differences, and the pressure back from any guess to 1e-12."""
    m = medium_of(AIRY, 320.0)
    assert bulk_modulus(AIRY, 320.0, P_ATMOSPHERE) == m.B_0
    for P in np.geomspace(1.2 * P_FLOOR, 4e7, 60).tolist():
        density, slope = density_and_slope(m, P)
        assert density == pytest.approx(written(m, P), rel=1e-10)
        assert slope == pytest.approx((written(m, 1.0001 * P) - written(m, 0.9999 * P)) / (0.0002 * P), rel=1e-5)
        assert (density, slope) == (relative_density(m, P), relative_compressibility(m, P))
        for guess in (0.0, 0.1 * P, 0.99 * P, 3.0 * P, 4e7):
            assert pressure_of(m, 2.0 * density, 2.0, guess) == pytest.approx(P, rel=1e-9)


def test_a_cavity_s_missing_mass_is_counted_below_the_floor() -> None:
    m = medium_of(AIRY, 320.0)
    for P in (0.5 * P_FLOOR, -3e5, -5e6):
        assert pressure_of(m, relative_density(m, P) * 1e-6, 1e-6, P_FLOOR) == pytest.approx(P, rel=1e-6)


@pytest.mark.parametrize("x", [-0.7, -0.09, -3e-4, 0.0, 1e-3, 0.0099, 0.05, 0.3])
def test_angles_move_as_the_library_says(x: float) -> None:
    c, s = small_turn(x)
    assert (c, s) == pytest.approx((math.cos(x), math.sin(x)), abs=2e-16)
    assert tangent_after(math.tan(0.3), x) == pytest.approx(math.tan(0.3 + x), rel=1e-15)
    for turns in (-3, 0, 2):
        assert past_dead_centre(x + 2.0 * math.pi * turns, 0.1) == pytest.approx((x - 0.1) % (2.0 * math.pi), abs=1e-12)


def test_a_port_opens_and_closes_alike() -> None:
    """Shut on both seals, open between, symmetric about the middle of its kidney."""
    for angle in np.linspace(0.0, math.pi, 50).tolist():
        share = opened_share(angle, 0.1, 1.0 / 0.2)
        assert share == pytest.approx(opened_share(math.pi - angle, 0.1, 1.0 / 0.2), abs=1e-12)
        inside = min(angle, math.pi - angle)
        assert share == 0.0 if inside <= 0.1 else (share == 1.0 if inside >= 0.3 + 1e-9 else 0.0 < share <= 1.0)


@pytest.mark.parametrize("by", ["pump_leakage_scale", "ambient_pressure_bar"])
def test_derivatives_taken_from_other_columns_are_those_of_differences(by: str) -> None:
    condition = Condition(4000.0, 60.0, 0.5, 8.0)
    health = Health(pump_leakage_scale=1.3, slipper_leakage_scale=1.2, piston_leakage_scale=0.8)
    found = operating_point(KIND.pump, condition, BENCH, health, derivatives=True)
    assert found.derivatives is not None
    step, values = 1e-3, []
    for sign in (1.0, -1.0):
        if by in Condition._fields:
            moved, well = condition._replace(**{by: getattr(condition, by) + sign * step}), health
        else:
            moved, well = condition, health._replace(**{by: getattr(health, by) + sign * step})
        values.append(operating_point(KIND.pump, moved, BENCH, well).values[0])
    slope = (values[0] - values[1]) / (2.0 * step)
    column = next(i for i, name in enumerate((*Condition._fields, *Health._fields)) if name == by)
    assert found.derivatives[0, :, column] == pytest.approx(slope, rel=2e-4, abs=1e-5)
