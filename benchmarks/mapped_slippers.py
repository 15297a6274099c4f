"""Slippers by their metamodel beside resolved ones in the transient: means of both, and the price of each.

``python -m benchmarks.mapped_slippers`` writes ``benchmarks/results/mapped_slippers.json``. Conditions are random, within what
the metamodel was fitted to; speeds are taken in turns in one process, constant gaps beside them.
"""

import argparse
import time

import numpy as np

from benchmarks import keep
from twin.condition import Condition, Health
from twin.pumps import circuit_parameters, pump_type
from twin.simulation.run import Run, steady_run
from twin.slipper_maps import stored_map

NAMES = (
    "discharge_pressure_bar",
    "case_pressure_bar",
    "case_flow_lpm",
    "discharge_flow_lpm",
    "control_pressure_bar",
    "swashplate_angle_deg",
    "shaft_torque_nm",
)
_SETTLE, _KEPT, _LONG = 20, 4, 60


def drawn(rng: np.random.Generator) -> tuple[Condition, Health]:
    """A random condition with slippers up to twice as leaky."""
    speed = float(rng.uniform(1500, 5500))
    condition = Condition(
        speed, float(rng.uniform(25, 95)), float(rng.uniform(0, 2)), float(rng.uniform(0, 0.0055)) * speed
    )
    return condition, Health(slipper_leakage_scale=float(np.exp(rng.uniform(0, 0.7))))


def _timed(gaps: str | None, condition: Condition, health: Health) -> tuple[Run, float]:
    """A run and how many times faster than real time it went; None for the constant gaps of the other set."""
    pump, bench = pump_type("h225_thesis" if gaps else "h225").pump, circuit_parameters("shared_return")
    settle = _SETTLE if gaps == "resolved" else _LONG
    begun = time.perf_counter()
    run = steady_run(
        pump,
        condition,
        bench,
        health,
        settle_revolutions=settle,
        mean_revolutions=_KEPT,
        slipper_gaps=gaps or "resolved",
    )
    return run, run.status.time_s / (time.perf_counter() - begun)


def main() -> None:
    """Compare and keep."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=20)
    asked = parser.parse_args()
    stored = stored_map(pump_type("h225_thesis").pump)
    assert stored is not None
    rng = np.random.default_rng(5)
    differences: dict[str, list[float]] = {name: [] for name in NAMES}
    speeds: dict[str, list[float]] = {"constant": [], "metamodel": [], "resolved": []}
    outside = 0
    for gaps in (None, "metamodel", "resolved"):
        _timed(gaps, Condition(4600, 50), Health())
    for _ in range(asked.count):
        condition, health = drawn(rng)
        mapped, pace = _timed("metamodel", condition, health)
        speeds["metamodel"].append(pace)
        resolved, pace = _timed("resolved", condition, health)
        speeds["resolved"].append(pace)
        speeds["constant"].append(_timed(None, condition, health)[1])
        outside += bool(mapped.status.outside)
        for name in NAMES:
            differences[name].append(mapped.mean(name, _KEPT) - resolved.mean(name, _KEPT))
    keep(
        "mapped_slippers",
        {
            "conditions": asked.count,
            "outside": outside,
            "stated_case_leakage_lpm": dict(stored.errors["case_leakage_lpm"]),
            "metamodel_less_resolved": {
                name: {"rms": float(np.sqrt(np.mean(np.square(d)))), "largest": float(np.abs(d).max())}
                for name, d in differences.items()
            },
            "times_real_time_median": {name: float(np.median(paces)) for name, paces in speeds.items()},
        },
    )


if __name__ == "__main__":
    main()
