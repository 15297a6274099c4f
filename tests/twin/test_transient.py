"""The transient pump: against CVODE on the same right-hand side, its own convergence, mass, energy, operating point."""

import math

import numpy as np
import pytest
from sksundae.cvode import CVODE
from twin.simulation.network import ALPHA, drain_conductance, return_conductance, scene_of

from twin.condition import Condition, Health, input_rows
from twin.laws.bench import drain_pressure_drop, return_pressure_drop
from twin.laws.fluid import P_ATMOSPHERE, relative_density
from twin.operating_point import operating_point
from twin.parts.piston import chamber_volume, volume_by_tilt, volume_rate_by_rotation
from twin.parts.port_plate import opening
from twin.pumps import circuit_parameters, pump_type
from twin.simulation.run import MEANS, RUN_OK, SteadyRun, initial_state, run_loop, steady_run
from twin.simulation.step import N_SHARED, rates
from twin.units import M3_PER_S_PER_LPM as LPM
from twin.units import PA_PER_BAR as BAR

PUMP = pump_type("h225").pump
BENCH = circuit_parameters("shared_return")
SEPARATE = circuit_parameters("separate_drain")
N = int(PUMP.piston.n)


def cvode_means(condition: Condition, health: Health, run: SteadyRun, revolutions: int = 2) -> dict[str, float]:
    """Continue from the last state of a run with CVODE (rtol 1e-9) and average over whole revolutions."""
    scene = scene_of(PUMP, BENCH, input_rows([condition], [health])[0], 0.0)
    scales, chambers = np.ones((N, 2)), np.empty((N, 12))
    # scaled states, so that one tolerance fits pressures and spool positions alike
    scale = np.concatenate((np.full(N + 4, 1e5), [1e-4, 1e-2, 1e-2, 1.0]))

    def f(t: float, y: np.ndarray, dy: np.ndarray) -> None:
        rates(PUMP, BENCH, scene, y * scale, N, scene.omega * t, scales, chambers, dy)
        dy /= scale

    period = 2 * math.pi / scene.omega
    instants = np.linspace(0, revolutions * period, 2000 * revolutions + 1)
    solver = CVODE(f, method="BDF", rtol=1e-9, atol=1e-9, max_num_steps=10_000_000)
    solution = solver.solve(instants, run.states[-1] / scale)
    assert solution.success
    y = solution.y[1:] * scale
    case_flow = [drain_conductance(s[N + 1] - s[N + 2], scene.k_c, scene.k_cQ) * (s[N + 1] - s[N + 2]) / LPM for s in y]
    return {
        "discharge_pressure_bar": float(y[:, N].mean()) / BAR - condition.ambient_pressure_bar,
        "case_pressure_bar": float(y[:, N + 1].mean()) / BAR - condition.ambient_pressure_bar,
        "case_flow_lpm": float(np.mean(case_flow)),
        "order_9_bar": order(y[:, N], 9 * revolutions) / BAR,
    }


def order(samples: np.ndarray, bin_: int) -> float:
    """Amplitude of one bin of the discrete spectrum."""
    return float(2 * np.abs(np.fft.rfft(samples)[bin_]) / len(samples))


@pytest.mark.parametrize(
    ("condition", "health"),
    [
        (Condition(4600, 50), Health()),
        (Condition(4600, 80, 0.5, 20.0), Health(pump_leakage_scale=2.0)),
        (Condition(920, 30, 0.0, 2.0), Health()),
    ],
    ids=["zero flow", "hot, worn, 20 L/min", "slow"],
)
def test_cycle_means_and_ripple_meet_cvode(condition: Condition, health: Health) -> None:
    # 150 revolutions settle what the operating point starts from; CVODE goes on from there
    run = steady_run(PUMP, condition, BENCH, health, settle_revolutions=150, mean_revolutions=2)
    # start CVODE at a whole revolution: the state before the first step of the average's last turn
    per = round(2 * math.pi / (condition.speed_rpm * math.pi / 30) / (run.time_s[1] - run.time_s[0]))
    begun = SteadyRun(run.time_s, run.states[: len(run.states) - per + 1], run.means, run.status)
    reference = cvode_means(condition, health, begun)
    for name in ("discharge_pressure_bar", "case_pressure_bar", "case_flow_lpm"):
        assert run.means[name] == pytest.approx(reference[name], rel=0.002), name
    ripple = order(run.states[-2 * per :, N], 18) / BAR
    assert ripple == pytest.approx(reference["order_9_bar"], rel=0.03)


def test_error_falls_with_the_step_at_first_and_second_order() -> None:
    """One revolution from one state: the pressure error against 1 us; extrapolation raises the order."""
    condition = Condition(4600, 50, 0.5, 10.0)
    row = input_rows([condition], [Health()])[0]
    scene = scene_of(PUMP, BENCH, row, 0.0)
    period = 2 * math.pi / scene.omega

    def final(dt: float, extrapolate: bool) -> np.ndarray:
        y = initial_state(PUMP, BENCH, row, 0.0)
        n_steps = round(period / dt)
        out, means = np.empty((1, len(y))), np.empty(len(MEANS))
        done = run_loop(
            PUMP, BENCH, scene, y, N, period / n_steps, n_steps, 1, n_steps, extrapolate, np.ones((N, 2)), out, means
        )
        assert done == n_steps
        return y[N : N + 2]

    truth = final(0.5e-6, True)
    plain = [float(np.abs(final(dt, False) - truth).max()) for dt in (40e-6, 20e-6, 10e-6, 5e-6)]
    better = [float(np.abs(final(dt, True) - truth).max()) for dt in (40e-6, 20e-6, 10e-6, 5e-6)]
    assert np.log2(plain[0] / plain[-1]) / 3 == pytest.approx(1.0, abs=0.4)
    assert better[0] < plain[0] / 3
    assert np.log2(better[0] / better[-1]) / 3 > 1.2


@pytest.mark.parametrize("circuit", [BENCH, SEPARATE], ids=["shared return", "separate drain"])
def test_mass_is_conserved(circuit) -> None:  # type: ignore[no-untyped-def]
    """What enters leaves or is stored, over a run with plain steps: 1e-6 of throughput."""
    condition = Condition(4600, 60, 0.3, 12.0)
    row = input_rows([condition], [Health(system_leakage_lpm=0.5)])[0]
    scene = scene_of(PUMP, circuit, row, 0.0)
    y = initial_state(PUMP, circuit, row, 0.0)
    before = stored(y, 0.0, scene)
    n_steps, dt = 2000, 20e-6
    out, means = np.empty((1, len(y))), np.empty(len(MEANS))
    run_loop(PUMP, circuit, scene, y, N, dt, n_steps, n_steps, n_steps, False, np.ones((N, 2)), out, means)
    after = stored(y, scene.omega * dt * n_steps, scene)
    drain, returned, drawn = means[6], means[7], means[8]
    leaving = returned + (0.0 if circuit is BENCH else drain)
    balance = drawn - leaving - (after - before) / (n_steps * dt)
    # the moving tilt stores fluid in control volume and case by equal and opposite amounts
    assert abs(balance) / drawn < 1e-6


def stored(y: np.ndarray, theta: float, scene) -> float:  # type: ignore[no-untyped-def]
    """Fluid in all volumes, counted at ambient density [m3]."""

    def w(P: float) -> float:
        return relative_density(P - P_ATMOSPHERE, scene.B_0, scene.B_gain)

    t, t_max = math.tan(y[N + ALPHA]), math.tan(PUMP.swashplate.alpha_max)
    chambers = sum(
        w(y[k]) * chamber_volume(PUMP.piston, t_max, t, math.cos(theta + 2 * math.pi * k / N)) for k in range(N)
    )
    volumes = PUMP.volumes
    fixed = (volumes.discharge, volumes.case, volumes.return_line, volumes.control)
    return chambers + sum(w(P) * V for P, V in zip(y[N : N + 4], fixed, strict=True))


def test_operating_point_meets_the_transient_mean() -> None:
    """The fast twin against the slow one, over conditions and health.

    Measured over 60 conditions on the day of writing: at most 0.27 bar of discharge pressure (0.09 bar in the mean),
    0.014 bar of case pressure, 1.9 % of case flow.
    """
    rng = np.random.default_rng(21)
    for _ in range(12):
        condition = Condition(rng.uniform(2500, 5500), rng.uniform(25, 85), rng.uniform(0, 1.5), rng.uniform(0, 12))
        health = Health(
            pump_leakage_scale=rng.uniform(0.6, 2.0),
            system_leakage_lpm=rng.uniform(0, 1.0),
            drain_resistance_scale=rng.uniform(0.8, 1.4),
            pressure_setting_change_bar=rng.uniform(-3, 3),
        )
        run = steady_run(PUMP, condition, BENCH, health, settle_revolutions=120)
        point = operating_point(PUMP, condition, BENCH, health)
        assert run.status == RUN_OK
        for name, tolerance in (("discharge_pressure_bar", 0.35), ("case_pressure_bar", 0.02)):
            assert float(point.value(name)[0]) == pytest.approx(run.means[name], abs=tolerance), (condition, health)
        assert float(point.value("case_flow_lpm")[0]) == pytest.approx(run.means["case_flow_lpm"], rel=0.025)


def test_hydraulic_power_is_flow_times_pressure_plus_leakage() -> None:
    condition = Condition(4600, 50, 0.0, 15.0)
    run = steady_run(PUMP, condition, BENCH, settle_revolutions=120)
    means = run.means
    shaft = means["shaft_torque_nm"] * condition.speed_rpm * math.pi / 30
    delivered = means["discharge_pressure_bar"] * BAR * 15.0 * LPM
    leaked = means["case_flow_lpm"] * LPM * means["discharge_pressure_bar"] * BAR
    # every leak throttles from discharge to case; commutation throttles a little more
    assert shaft == pytest.approx(delivered + leaked, rel=0.03)
    assert shaft > delivered + 0.9 * leaked


def test_uneven_wear_draws_a_line_at_once_per_revolution() -> None:
    condition = Condition(4600, 50)
    uneven = np.ones(N)
    uneven[0] = 5.0
    lines = []
    for scales in (np.ones(N), uneven, np.full(N, 1.0 + 4.0 / N)):
        run = steady_run(PUMP, condition, BENCH, settle_revolutions=60, mean_revolutions=4, slipper_scales=scales)
        per = round(2 * math.pi / (4600 * math.pi / 30) / (run.time_s[1] - run.time_s[0]))
        lines.append(order(run.states[-4 * per :, N], 4) / BAR)
    healthy, one_worn, all_worn = lines
    assert one_worn > 0.02
    assert max(healthy, all_worn) < 0.1 * one_worn


class TestParts:
    def test_ports_open_in_turn_and_never_both(self) -> None:
        angles = np.linspace(-1, 8, 4000)
        discharge = np.array([opening(PUMP.port_plate, a) for a in angles])
        suction = np.array([opening(PUMP.port_plate, a - math.pi) for a in angles])
        assert (discharge * suction == 0.0).all()
        assert discharge.max() == pytest.approx(PUMP.port_plate.A_port)
        assert np.abs(np.diff(discharge)).max() < 0.02 * PUMP.port_plate.A_port
        assert opening(PUMP.port_plate, 1.0) == pytest.approx(opening(PUMP.port_plate, 1.0 + 4 * math.pi))

    @pytest.mark.parametrize("phi", [0.3, 2.0, 4.4])
    def test_volume_rates_are_slopes_of_the_volume(self, phi: float) -> None:
        alpha, omega, h = 0.1, 480.0, 1e-6
        t_max = math.tan(0.264)

        def volume(phi: float, alpha: float) -> float:
            return chamber_volume(PUMP.piston, t_max, math.tan(alpha), math.cos(phi))

        by_phi = (volume(phi + h, alpha) - volume(phi - h, alpha)) / (2 * h)
        by_alpha = (volume(phi, alpha + h) - volume(phi, alpha - h)) / (2 * h)
        t = math.tan(alpha)
        assert volume_rate_by_rotation(PUMP.piston, t, math.sin(phi), omega) == pytest.approx(by_phi * omega, rel=1e-5)
        assert volume_by_tilt(PUMP.piston, t, math.cos(phi)) == pytest.approx(by_alpha, rel=1e-5)

    @pytest.mark.parametrize("Q", [1e-9, 1e-5, 5e-4])
    def test_line_conductances_invert_their_laws(self, Q: float) -> None:
        k_inf, K = 0.00206 * BAR / LPM**2, 22.8 * LPM
        dP = return_pressure_drop(Q, k_inf, K, 1.0)
        assert return_conductance(dP, k_inf, K, 1.0) * dP == pytest.approx(Q, rel=1e-9)
        k_c = 0.29 * BAR / LPM
        dP = drain_pressure_drop(Q, k_c, 0.2, 0.5, 1.3, LPM)
        assert drain_conductance(dP, k_c * (0.2 * 1.3 + 0.3), k_c * 0.5 / LPM) * dP == pytest.approx(Q, rel=1e-9)

    def test_any_number_of_pistons(self) -> None:
        for n in (5, 8, 11, 13):
            pump = PUMP._replace(piston=PUMP.piston._replace(n=float(n)))
            run = steady_run(pump, Condition(4600, 50, 0.5, 5.0), BENCH, settle_revolutions=40)
            assert run.status == RUN_OK
            assert run.states.shape[1] == n + N_SHARED
            assert run.means["discharge_pressure_bar"] == pytest.approx(173.5, abs=3.0)

    def test_wrong_scales_and_impossible_demands_are_said(self) -> None:
        with pytest.raises(ValueError, match=r"shape \(9,\)"):
            steady_run(PUMP, Condition(4600, 50), BENCH, slipper_scales=np.ones(3))
        with pytest.raises(ValueError, match="ask for less flow"):
            steady_run(PUMP, Condition(4600, 50, 0.0, 60.0), BENCH)
