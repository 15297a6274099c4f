"""What a change of the kernels must not move: means and order n of twenty runs at random conditions and healths.

``python -m benchmarks.same_means --keep`` writes ``benchmarks/results/same_means.json`` with the kernels of today;
without it the same runs are made anew and held against what is kept there: means within 0.1 % (near zero: of the
nominal value), order n of both pressures within 2 % (of the largest among the runs, where it is small). Exit 1 where one
has moved further.
"""

import argparse
import json
import sys

import numpy as np

from benchmarks import RESULTS, keep
from twin.condition import Condition, Health
from twin.pumps import circuit_parameters, pump_type
from twin.simulation.run import steady_run
from twin.simulation.scenario import Value

MEANS: dict[str, float] = {
    "discharge_pressure_bar": 175.0,
    "case_pressure_bar": 0.8,
    "case_flow_lpm": 1.4,
    "discharge_flow_lpm": 25.0,
    "shaft_torque_nm": 16.0,
}
"""Means that are held, each with its nominal value: below a tenth of it an error counts over that tenth."""
ORDERS = ("discharge_pressure_bar", "case_pressure_bar")
_N_RUNS, _SETTLE, _REVOLUTIONS = 20, 10, 4
_NEAR_ZERO, _SMALL_ORDER = 0.1, 0.1
_MEANS_WITHIN, _ORDER_WITHIN = 1.0e-3, 0.02


def runs() -> dict[str, list[float]]:
    """Means and order amplitudes, one number per run: every second with free air, every fourth with resolved gaps."""
    kind, bench = pump_type("h225"), circuit_parameters("shared_return")
    rng = np.random.default_rng(20)
    found: dict[str, list[float]] = {name: [] for name in (*MEANS, *(f"order n of {name}" for name in ORDERS))}
    for i in range(_N_RUNS):
        pump = kind.pump._replace(fluid=kind.pump.fluid._replace(air=0.005 if i % 2 else 0.0))
        lifted = i % 4 == 2
        if lifted:
            pump = pump._replace(slipper=pump.slipper._replace(variable=1.0))
        speed, T, reservoir, flow = rng.uniform([2000, 0, 0, 0], [5500, 100, 1.0, 18.0])
        condition = Condition(speed, T, reservoir, flow * speed / 5500.0)
        health = Health(
            pump_leakage_scale=rng.uniform(0.8, 2.0),
            slipper_leakage_scale=rng.uniform(0.8, 2.0),
            pressure_setting_change_bar=rng.uniform(-8.0, 8.0),
            drain_resistance_scale=rng.uniform(0.8, 2.0),
            control_bleed_lpm=max(rng.uniform(-0.5, 0.5), 0.0),
        )
        settle = 2 if lifted else _SETTLE
        # a third of the loads are openings, whose flow follows from the pressures
        opening: dict[str, Value] = {"load_conductance_lpm_per_sqrt_bar": flow / 175.0**0.5} if i % 3 == 0 else {}
        if opening:
            condition = condition._replace(discharge_flow_lpm=0.0)
        run = steady_run(
            pump, condition, bench, health, changes=opening, settle_revolutions=settle, mean_revolutions=_REVOLUTIONS
        )  # fmt: skip
        for name in MEANS:
            found[name].append(run.mean(name, _REVOLUTIONS))
        for name in ORDERS:
            found[f"order n of {name}"].append(
                _order(run.recording[name], run.recording["time_s"], speed, pump.piston.n)
            )
    return found


def _order(signal: np.ndarray, time: np.ndarray, speed_rpm: float, n: float) -> float:
    period = 60.0 / speed_rpm
    last = time > time[-1] - _REVOLUTIONS * period + 1.0e-9
    turns = time[last] / period
    return float(2.0 * abs(np.mean(signal[last] * np.exp(-2j * np.pi * n * turns))))


def errors(found: dict[str, list[float]], kept: dict[str, list[float]]) -> dict[str, float]:
    """Largest relative error of every row."""
    worst = {}
    for name, row in kept.items():
        known, new = np.array(row), np.array(found[name])
        floor = _NEAR_ZERO * MEANS[name] if name in MEANS else _SMALL_ORDER * np.abs(known).max()
        worst[name] = float((np.abs(new - known) / np.maximum(np.abs(known), floor)).max())
    return worst


def main() -> None:
    """Keep, or compare and say."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--keep", action="store_true", help="keep the means of today's kernels as what is to be met")
    if parser.parse_args().keep:
        keep("same_means", {"found": runs()})
        return
    kept = json.loads((RESULTS / "same_means.json").read_text())["found"]
    worst = errors(runs(), kept)
    for name, error in worst.items():
        print(f"{name}: {error:.2e}")
    sys.exit(any(error > (_MEANS_WITHIN if name in MEANS else _ORDER_WITHIN) for name, error in worst.items()))


if __name__ == "__main__":
    main()
