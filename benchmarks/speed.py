"""The speed table in one command, and its history over commits.

``python -m benchmarks.speed`` measures every row in processor time, so that other work on the machine hardly counts, writes
``benchmarks/results/speed.json`` and adds a line to ``benchmarks/results/speed_history.jsonl`` under the commit. ``--first-use``
also compiles all kernels into an empty cache (a minute and a half).
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from benchmarks import RESULTS, keep
from benchmarks.transient import batch, seconds
from service.identity import commit
from twin.condition import Condition, Health, input_rows
from twin.operating_point import operating_points
from twin.parameters import Pump
from twin.pumps import circuit_parameters, pump_type
from twin.simulation.run import simulate
from twin.simulation.scenario import Scenario

HISTORY = RESULTS / "speed_history.jsonl"
GOALS: dict[str, float] = {
    "transient, constant gaps [times real time]": 33.0,
    "transient, 0.5 % air [times real time]": 25.0,
    "transient, variable gaps resolved [times real time]": 2.0,
    "runs of 0.15 s, two cores [per s]": 440.0,
    "operating points along a trace [per s]": 200_000.0,
    "operating points at random [per s]": 100_000.0,
    "operating points at random with derivatives [per s]": 50_000.0,
}
"""What is to be reached, of one core where nothing else is said."""
FIRST_USE = "first use, all kernels compiled [s]"
_POINTS = 20_000


def transient() -> dict[str, float]:
    """Times real time of one run on one core."""
    pump = pump_type("h225").pump
    bench = circuit_parameters("shared_return")
    kinds: dict[str, tuple[Pump, float]] = {
        "constant gaps": (_with_air(pump, 0.0), 1.0),
        "0.5 % air": (_with_air(pump, 0.005), 0.5),
        "variable gaps resolved": (
            _with_air(pump, 0.0)._replace(slipper=pump.slipper._replace(variable=1.0)), 0.1),
    }  # fmt: skip
    found = {}
    for name, (kind, length) in kinds.items():
        scenario = Scenario(length, Condition(4600.0, 50.0, 0.5, 10.0))
        simulate(kind, bench, scenario)
        spent = seconds(lambda k=kind, s=scenario: simulate(k, bench, s))  # type: ignore[misc]
        found[f"transient, {name} [times real time]"] = length / spent
    return found


def points() -> dict[str, float]:
    """Operating points per second of one core: neighbours along a trace, and at random."""
    pump, bench = pump_type("h225").pump, circuit_parameters("shared_return")
    rng, share = np.random.default_rng(3), np.linspace(0.0, 1.0, _POINTS)
    wave = 0.5 + 0.5 * np.sin(12.0 * share)
    drawn = rng.random((_POINTS, 3))
    trace = np.column_stack([4600.0 + 50.0 * wave, 45.0 + 40.0 * share, 12.0 * wave])
    random = np.array([2500.0, 25.0, 0.0]) + drawn * [3000.0, 70.0, 12.0]

    def rows(table: NDArray[np.float64]) -> NDArray[np.float64]:
        return input_rows([Condition(n, T, 0.5, q) for n, T, q in table.tolist()], [Health()] * len(table))

    found = {}
    for name, given, derivatives in (
        ("along a trace", rows(trace), False),
        ("at random", rows(random), False),
        ("at random with derivatives", rows(random), True),
    ):
        operating_points(pump, given[:10], bench, derivatives=derivatives)
        spent = seconds(lambda r=given, d=derivatives: operating_points(pump, r, bench, derivatives=d))  # type: ignore[misc]
        found[f"operating points {name} [per s]"] = _POINTS / spent
    return found


def first_use() -> float:
    """Processor time of the first use after an install from source [s]: every kernel into an empty cache."""
    with tempfile.TemporaryDirectory() as cache:
        begun = os.times()
        environment = {**os.environ, "CASEDRAIN_COMPILE_CACHE": cache}
        subprocess.run([sys.executable, "-m", "detectors.warm_up"], env=environment, check=True)
        ended = os.times()
    return ended.children_user + ended.children_system - begun.children_user - begun.children_system


def _with_air(pump: Pump, share: float) -> Pump:
    return pump._replace(fluid=pump.fluid._replace(air=share))


def main() -> None:
    """Measure, print, keep, remember."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--first-use", action="store_true", help="also compile all kernels anew")
    asked = parser.parse_args()
    begun = time.monotonic()
    found = {**transient(), "runs of 0.15 s, two cores [per s]": 2.0 * batch(), **points()}
    if asked.first_use:
        found[FIRST_USE] = first_use()
    rows = {name: {"measured": round(value, 1), "goal": GOALS.get(name, 10.0)} for name, value in found.items()}
    keep("speed", {"machine": platform.machine(), "rows": rows, "took_s": round(time.monotonic() - begun)})
    line = {"commit": commit(), "at": datetime.now(UTC).strftime("%Y-%m-%d"), "machine": platform.machine()}
    with HISTORY.open("a", encoding="utf-8") as file:
        file.write(json.dumps(line | {name: round(value, 1) for name, value in found.items()}) + "\n")


if __name__ == "__main__":
    main()
