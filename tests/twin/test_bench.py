"""Bench and test programme of chapter 3: known resistances come back, each test stands where annex A-1 puts it."""

import numpy as np
import pytest

from twin.identification.bench import (
    BenchPoint,
    Drain,
    at_once,
    case_flows,
    drain_and_lines,
    in_three_steps,
    return_line,
)
from twin.pumps import circuit_parameters, pump_type
from twin.simulation.programme import BLOCKS, OPEN_VALVE, dynamic_tests, steady_tests
from twin.units import STANDARD_ATMOSPHERE_BAR

KIND, BENCH = pump_type("h225"), circuit_parameters("shared_return")
K_C, K_INF, K, LOAD = 0.29, 0.00206, 22.8, 0.2


def bench_points(drain: Drain, viscosity: float, gamma: float = 1.0, seed: int | None = None) -> list[BenchPoint]:
    """Points of equations 3-2 to 3-4 written out, with noise of 5 mbar where a seed is given."""
    rng = np.random.default_rng(seed)
    points = []
    for Q_d in (0.0, 5.0, 12.0, 21.0, 29.0):
        for Q_c in (0.5, 1.2):
            P_i = 0.1 + float(return_line(np.array([Q_d + Q_c]), K_INF, K, gamma)[0])
            noise = 0.0 if seed is None else float(rng.normal(0.0, 0.005))
            P_c = P_i + drain.drop(Q_c, viscosity) + noise
            points.append(BenchPoint(P_i + LOAD * Q_d**2, P_c, 0.1, Q_d, Q_c, viscosity))
    return points


@pytest.mark.parametrize("gamma", [1.0, 0.75])
def test_both_ways_find_the_resistances_that_made_the_points(gamma: float) -> None:
    points = bench_points(Drain(0.0, 0.0, K_C), 10.0, gamma)
    for found in (in_three_steps(points, free_gamma=gamma != 1.0), at_once(points, free_gamma=gamma != 1.0)):
        if gamma != 1.0:
            # of the three steps k_cr + k_inf K is the limit of gamma = 1 only: K bends a little
            assert found.gamma == pytest.approx(gamma, abs=0.08)
            continue
        # Q / tanh(Q) is not yet Q at 0.5 and 1.2 L/min: k_cr is as good as that
        assert found.k_c == pytest.approx(K_C, rel=2e-3)
        assert found.k_cr == pytest.approx(K_C + K_INF * K, rel=2e-3)
        assert found.k_inf * found.K == pytest.approx(K_INF * K, rel=0.01)
        assert [k for k in found.k_d if k] == pytest.approx([LOAD] * 8, rel=1e-3)
        assert found.k_d[:2] == (0.0, 0.0)
        assert case_flows(points, found) == pytest.approx([p.case_flow_lpm for p in points], abs=2e-3)


def test_all_at_once_weighs_noise_better_than_three_steps() -> None:
    """Zero-flow points alone decide k_cr in three steps; at once every point has a say."""
    misses = {"three": [], "once": []}  # type: ignore[var-annotated]
    for seed in range(20):
        points = bench_points(Drain(0.0, 0.0, K_C), 10.0, seed=seed)
        misses["three"].append(in_three_steps(points).k_c - K_C)
        misses["once"].append(at_once(points).k_c - K_C)
    assert np.std(misses["once"]) < np.std(misses["three"])
    assert abs(np.mean(misses["once"])) < 3.0 * np.std(misses["once"]) / np.sqrt(20) + 1e-3


def test_a_laminar_turbulent_drain_serves_both_temperatures_and_a_laminar_one_does_not() -> None:
    drain = Drain(0.012, 0.21, 0.0)
    warm, hot = bench_points(drain, 10.3, seed=1), bench_points(drain, 3.45, seed=2)
    found, lines = drain_and_lines([warm, hot])
    # 5 mbar of noise on some 0.1 bar of hoses
    assert found.a == pytest.approx(drain.a, rel=0.1)
    assert found.b == pytest.approx(drain.b, rel=0.05)
    measured = np.array([p.case_flow_lpm for p in hot])
    both = np.abs(case_flows(hot, lines[1], found) - measured).mean()
    carried = np.abs(case_flows(hot, at_once(hot), Drain(0.0, 0.0, at_once(warm).k_c)) - measured).mean()
    assert both < 0.25 * carried
    assert found.flow(found.drop(-0.7, 5.0), 5.0) == pytest.approx(-0.7)


def test_too_few_points_are_said() -> None:
    points = bench_points(Drain(0.0, 0.0, K_C), 10.0)
    with pytest.raises(ValueError, match="zero flow"):
        in_three_steps(points[4:])
    with pytest.raises(ValueError, match="as many points"):
        at_once(points[:2])
    with pytest.raises(ValueError, match="four points"):
        drain_and_lines([points, points[:3]])


@pytest.mark.parametrize(("name", "temperature"), [("A2", 50.0), ("A3", 100.0)])
def test_steady_tests_stand_where_the_annex_puts_them(name: str, temperature: float) -> None:
    tests = steady_tests(name, KIND, BENCH)
    assert [t.number for t in tests] == list(range(1, 26))
    assert all(t.problem is None for t in tests)
    for block, (speed, inlet) in enumerate(BLOCKS):
        zero, high, most, low, full = tests[5 * block : 5 * block + 5]
        for t in (zero, high, most, low, full):
            assert t.condition[:2] == (speed, temperature)
            assert t.condition.reservoir_pressure_bar == pytest.approx(inlet - STANDARD_ATMOSPHERE_BAR)
        pressure = {
            t.point: float(t.state.value("discharge_pressure_bar")[0]) for t in tests[5 * block : 5 * block + 5]
        }
        flow = {t.point: float(t.state.value("discharge_flow_lpm")[0]) for t in tests[5 * block : 5 * block + 5]}
        assert flow["zero flow"] == 0.0
        assert pressure["167 bar"] == pytest.approx(167.0 - STANDARD_ATMOSPHERE_BAR, abs=1e-3)
        assert pressure["50 bar"] == pytest.approx(50.0 - STANDARD_ATMOSPHERE_BAR, abs=1e-3)
        power = {point: pressure[point] * flow[point] for point in pressure}
        assert max(power, key=lambda point: power[point]) == "most power"
        assert (full.load, max(flow, key=lambda point: flow[point])) == (OPEN_VALVE, "full flow")


def test_dynamic_tests_change_the_flow_that_the_annex_asks_for() -> None:
    tests = dynamic_tests("B2", KIND, BENCH)
    assert len(tests) == 8
    scenarios = [t.scenario for t in tests]
    schedules = [s.changes["load_conductance_lpm_per_sqrt_bar"] for s in scenarios]
    takes = [s.at[1] - s.at[0] for s in schedules]  # type: ignore[union-attr]
    # 27 (L/min)/s over 27 and over 60 % of it
    assert takes == pytest.approx([0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.6, 0.6])
    assert all(s.at[0] == 2.0 for s in schedules)  # type: ignore[union-attr]
    assert all(s.duration_s == pytest.approx(5.0 + t) for s, t in zip(scenarios, takes, strict=True))
    ends = [s.values for s in schedules]  # type: ignore[union-attr]
    assert ends[0] == ends[1][::-1] == ends[2] == ends[3][::-1]
    assert ends[4] == ends[5][::-1] == ends[6] == ends[7][::-1]
    assert ends[0][0] == 0.0 < ends[4][0] < ends[4][1] < ends[0][1]


def test_a_name_that_the_annex_has_not() -> None:
    with pytest.raises(ValueError, match="known: A2, A3"):
        steady_tests("B2", KIND, BENCH)
    with pytest.raises(ValueError, match="known: B2, B3"):
        dynamic_tests("A2", KIND, BENCH)
