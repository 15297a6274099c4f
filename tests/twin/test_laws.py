"""Laws against the thesis' tables (Mkadara 2020), published fluid data and continuity."""

import math

import numpy as np
import pytest

from twin.laws.fluid import (
    P_ATMOSPHERE,
    bulk_modulus,
    density,
    dynamic_viscosity,
    kinematic_viscosity,
    throttling_heating,
    viscosity_factor,
)
from twin.laws.gap import annular_gap_flow, land_conductance, land_flow, port_plate_gap_flow, throttled_land_flow
from twin.laws.lines import drain_pressure_drop, load_flow, return_pressure_drop, return_pressure_drop_with_slope
from twin.laws.orifice import orifice_flow, tanh_coefficient, viersma_coefficient
from twin.pumps.fluids import FLUIDS
from twin.units import M3_PER_S_PER_LPM as LPM
from twin.units import PA_PER_BAR as BAR

FLUID = FLUIDS["MIL-PRF-83282"]
K_0 = 273.15


class TestTable210:
    """One slipper at 160 bar, one at suction, nine in the mean: table 2-10, gap 17 um, case 3 bar."""

    @staticmethod
    def leakages(mu: float) -> tuple[float, float, float]:
        discharge = land_flow(160 * BAR, 3 * BAR, mu, 17e-6, 1.45) / LPM
        suction = land_flow(1.8 * BAR, 3 * BAR, mu, 17e-6, 1.45) / LPM
        return discharge, suction, 4.5 * (discharge + suction)

    def test_three_leakages_within_one_percent(self) -> None:
        discharge, suction, nine = self.leakages(0.0148)
        assert discharge == pytest.approx(0.4417, rel=0.01)
        assert suction == pytest.approx(-0.0034, abs=0.00005)  # half of its last printed digit
        assert nine == pytest.approx(1.960, rel=0.01)

    def test_printed_viscosity_does_not_reproduce_the_row(self) -> None:
        assert self.leakages(0.02)[0] == pytest.approx(0.326, abs=0.001)


@pytest.mark.parametrize(
    ("T", "nu_cst", "tolerance"),
    [
        (40, 14.0, 0.01),
        (100, 3.45, 0.01),
        (50, 10.3, 0.05),
        (60, 7.9, 0.05),
        (80, 5.0, 0.05),
        (20, 29.7, 0.1),
        (0, 82, 0.2),
    ],
)
def test_viscosity_meets_published_curves(T: float, nu_cst: float, tolerance: float) -> None:
    assert kinematic_viscosity(FLUID, T + K_0) * 1e6 == pytest.approx(nu_cst, rel=tolerance)


@pytest.mark.parametrize(("T", "rho"), [(20, 838), (40, 825), (50, 819), (60, 813), (100, 788)])
def test_density_meets_published_values(T: float, rho: float) -> None:
    assert density(FLUID, T + K_0, P_ATMOSPHERE) == pytest.approx(rho, rel=0.002)


@pytest.mark.parametrize(("T", "B"), [(20, 17200), (40, 15020), (50, 14100), (60, 13290), (100, 10700)])
def test_bulk_modulus_meets_published_values(T: float, B: float) -> None:
    assert bulk_modulus(FLUID, T + K_0, P_ATMOSPHERE) / BAR == pytest.approx(B, rel=0.05)


def test_bulk_modulus_rises_with_pressure() -> None:
    """In proportion, by the data sheet's gain of the tangent modulus; density is the secant of it (equation 2-1)."""
    at_rest = bulk_modulus(FLUID, 323.15, P_ATMOSPHERE)
    pressed = bulk_modulus(FLUID, 323.15, P_ATMOSPHERE + 200 * BAR)
    assert pressed - at_rest == pytest.approx(FLUID.B_pressure_gain * 200 * BAR)
    gained = density(FLUID, 323.15, P_ATMOSPHERE + 200 * BAR) / density(FLUID, 323.15, P_ATMOSPHERE) - 1.0
    assert gained == pytest.approx(200 * BAR / pressed)


@pytest.mark.parametrize("x", [-1.0, -0.4, 0.0, 0.2, 1.0])
def test_the_film_s_factor_is_the_exponential(x: float) -> None:
    """The series of an eighth of x errs by (x / 8)^8 / 8!, eight times as much in its eighth power: 1.2e-11 at 1."""
    assert viscosity_factor(x) == pytest.approx(math.exp(x), rel=2e-11)


def test_viscosity_at_175_bar_is_a_quarter_higher() -> None:
    ratio = dynamic_viscosity(FLUID, 323.15, 175 * BAR + P_ATMOSPHERE) / dynamic_viscosity(FLUID, 323.15, P_ATMOSPHERE)
    assert ratio == pytest.approx(1.24, abs=0.01)


def test_throttling_from_175_bar_heats_by_11_kelvin() -> None:
    assert throttling_heating(FLUID, 323.15, 175 * BAR, 0.0) == pytest.approx(11.0, abs=0.5)


class TestBenchTable34:
    """Bench of table 3-4: its own identities, k_c + k_inf K = k_cr, at both temperatures."""

    ROWS = ((0.290, 0.00206, 22.8, 0.337), (0.300, 0.00158, 32.8, 0.352))

    @pytest.mark.parametrize(("k_c", "k_inf", "K", "k_cr"), ROWS)
    def test_zero_flow_resistance(self, k_c: float, k_inf: float, K: float, k_cr: float) -> None:
        Q = 1.0e-3 * LPM
        drop = drain_pressure_drop(Q, k_c * BAR / LPM, 0.0, 0.0, 1.0, LPM) + return_pressure_drop(
            Q, k_inf * BAR / LPM**2, K * LPM, 1.0
        )
        assert drop / BAR / 1.0e-3 == pytest.approx(k_cr, abs=0.0005)  # three printed digits

    def test_return_line_at_28_63_lpm_gives_the_thesis_intermediate_pressure(self) -> None:
        # section 4.2: P_i = 1.987 bar at the total return flow of static point 2
        drop = return_pressure_drop(28.63 * LPM, 0.00206 * BAR / LPM**2, 22.8 * LPM, 1.0) / BAR
        assert drop == pytest.approx(1.987, abs=0.01)

    @pytest.mark.parametrize("gamma", [0.25, 0.75, 1.0])
    def test_return_line_is_odd_and_smooth_at_zero(self, gamma: float) -> None:
        k, K = 1.0e9, (20 * LPM) ** gamma
        Q = np.array([-1e-9, -1e-12, 1e-12, 1e-9])
        drops = np.array([return_pressure_drop(q, k, K, gamma) for q in Q])
        assert drops == pytest.approx(-drops[::-1])
        assert drops / Q == pytest.approx(k * K, rel=1e-3)

    @pytest.mark.parametrize("gamma", [0.75, 1.0])
    def test_return_line_slope_is_that_of_the_drop(self, gamma: float) -> None:
        """Against central differences, from nearly zero flow to beyond the rated one, in either direction."""
        k, K = 0.00206 * BAR / LPM ** (1.0 + gamma), (22.8 * LPM) ** gamma
        for q in (-28.0, -0.5, 0.3, 2.0, 11.0, 40.0):
            Q, h = q * LPM, 1.0e-4 * LPM
            drop, slope = return_pressure_drop_with_slope(Q, k, K, gamma)
            assert drop == return_pressure_drop(Q, k, K, gamma)
            difference = (return_pressure_drop(Q + h, k, K, gamma) - return_pressure_drop(Q - h, k, K, gamma)) / (2 * h)
            assert slope == pytest.approx(difference, rel=1e-5)
        assert return_pressure_drop_with_slope(0.0, k, K, gamma) == (0.0, pytest.approx(k * K))

    def test_load_inverts_its_own_law(self) -> None:
        k_d = 0.1866 * BAR / LPM**2
        assert load_flow(136.5 * BAR, 1.987 * BAR, k_d) / LPM == pytest.approx(26.85, abs=0.05)  # physics of table 4-3
        assert load_flow(1.0, 2.0, k_d) == -load_flow(2.0, 1.0, k_d)


def test_drain_weights_sum_to_the_fitting_law() -> None:
    k, Q_ref = 3.0e9, 1.0 * LPM
    for Q, ratio in ((0.5 * LPM, 0.6), (2.0 * LPM, 1.7)):
        law = 0.4 * k * ratio * Q + 0.6 * k / Q_ref * Q * Q
        assert drain_pressure_drop(Q, k, 0.4, 0.6, ratio, Q_ref) == pytest.approx(law, rel=1e-12)


def test_annular_gap_reproduces_three_pistons_of_table_4_3() -> None:
    # three healthy pistons leak 0.0023 L/min in the mean at P_d 136.5 bar, 50 degC: the fit behind b = 5.6 um
    mu = dynamic_viscosity(FLUID, 323.15, 0.5 * 136.5 * BAR)
    mean = 1.5 * annular_gap_flow(136.5 * BAR, 2.5 * BAR, mu, 9.75e-3, 5.6e-6, 20e-3, 0.0, 0.0) / LPM
    assert mean == pytest.approx(0.0023, rel=0.35)


def test_annular_gap_drag_carries_half_the_wall_speed() -> None:
    assert annular_gap_flow(0.0, 0.0, 0.01, 0.01, 5e-6, 0.02, 0.0, 2.0) == pytest.approx(5e-6 * math.pi * 0.01)


def test_full_eccentricity_passes_two_and_a_half_times_the_flow() -> None:
    centred = annular_gap_flow(1e7, 0.0, 0.01, 0.01, 5e-6, 0.02, 0.0, 0.0)
    assert annular_gap_flow(1e7, 0.0, 0.01, 0.01, 5e-6, 0.02, 5e-6, 0.0) == pytest.approx(2.5 * centred)


def test_plane_gap_is_the_thin_limit_of_the_annular_gap() -> None:
    shape = math.pi * 0.01 / 0.02
    annular = annular_gap_flow(1e7, 0.0, 0.01, 0.01, 5e-6, 0.02, 0.0, 0.0)
    assert port_plate_gap_flow(1e7, 0.0, 0.01, 5e-6, shape) == pytest.approx(annular)


@pytest.mark.parametrize("h", [2e-6, 10e-6, 40e-6, 100e-6])
def test_throttle_and_land_agree_on_the_pocket_pressure(h: float) -> None:
    G, C_A, rho, P_0, P_1 = land_conductance(0.008, h, 1.45), 0.7 * 3.5e-7, 819.0, 175e5, 1e5
    Q = throttled_land_flow(P_0, P_1, G, C_A, rho)
    P_pocket = P_1 + Q / G
    assert P_1 < P_pocket < P_0
    assert pytest.approx(C_A * math.sqrt(2 / rho * (P_0 - P_pocket)), rel=1e-9) == Q


def test_orifice_is_odd_laminar_at_small_and_turbulent_at_large_difference() -> None:
    def flow(dP: float) -> float:
        return orifice_flow(1e5 + dP, 1e5, 1e-6, 1e-3, 819.0, 1e-5, 0.7, 1000.0)

    assert orifice_flow(1e5, 1e5 + 3.0, 1e-6, 1e-3, 819.0, 1e-5, 0.7, 1000.0) == -orifice_flow(
        1e5 + 3.0, 1e5, 1e-6, 1e-3, 819.0, 1e-5, 0.7, 1000.0
    )
    assert flow(2.0) / flow(1.0) == pytest.approx(2.0, rel=1e-3)
    assert flow(4e6) / flow(1e6) == pytest.approx(2.0, rel=1e-3)
    # equation 2-6 with C_q = 0.7 on 1 mm2: Bernoulli's speed of 40 bar
    assert flow(4e6) == pytest.approx(0.7 * 1e-6 * math.sqrt(2.0 * 4e6 / 819.0), rel=1e-3)
    # and in the laminar limit C_q = 2 C_q_inf / lambda_crit times the flow number d_h / nu sqrt(2 dP / rho)
    assert flow(1.0) == pytest.approx(0.7 * 2.0 / 1000.0 * 1e-3 / 1e-5 * 1e-6 * 2.0 / 819.0, rel=1e-3)


def test_flow_coefficient_has_no_jump_at_the_critical_flow_number() -> None:
    # as printed, equation 2-7 jumps by 3.6 % here
    below, above = tanh_coefficient(999.999, 1000.0, 0.7), tanh_coefficient(1000.001, 1000.0, 0.7)
    assert above == pytest.approx(below, rel=1e-5)
    assert 0.7 / below == pytest.approx(1.0373, abs=0.001)


def test_viersma_coefficient_is_continuous_at_its_transition() -> None:
    Re_t = (0.611 / 0.17) ** 2
    assert viersma_coefficient(Re_t * 0.999999, 0.17, 0.611) == pytest.approx(0.611, rel=1e-5)
    assert viersma_coefficient(Re_t * 9.0, 0.17, 0.611) == 0.611  # turbulent: no more by Re
