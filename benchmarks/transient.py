"""Speed of the transient pump beside CVODE and SciPy's LSODA on the same compiled right-hand side, and a batch.

``python -m benchmarks.transient`` prints a table and writes ``benchmarks/results/transient.json``.
"""

import time
from collections.abc import Callable

import numpy as np

from benchmarks import keep
from benchmarks.referee import cvode, lsoda, problem
from twin.condition import Condition, Health
from twin.pumps import circuit_parameters, pump_type
from twin.simulation.run import simulate, simulate_batch, steady_run
from twin.simulation.scenario import Scenario

_CONDITION = Condition(4600, 50, 0.5, 10.0)


def seconds(work: Callable[[], object]) -> float:
    """Median processor time of five goes [s], all threads together: other work on the machine hardly counts."""
    spent = []
    for _ in range(5):
        begun = time.process_time()
        work()
        spent.append(time.process_time() - begun)
    return float(np.median(spent))


def side_by_side() -> dict[str, float]:
    """Times real time on one core, each method its own tolerance or step, constant and variable gaps."""
    pump, bench = pump_type("h225").pump, circuit_parameters("shared_return")
    lifted = pump._replace(slipper=pump.slipper._replace(variable=1.0))
    found: dict[str, float] = {}
    for name, kind, length in (("constant gaps", pump, 1.0), ("variable gaps", lifted, 0.2)):
        scenario = Scenario(length, _CONDITION)
        simulate(kind, bench, scenario)
        found[f"own stepper, {name}"] = length / seconds(lambda k=kind, s=scenario: simulate(k, bench, s))  # type: ignore[misc]
        start = steady_run(kind, _CONDITION, bench, settle_revolutions=20, keep_states=True).states[-1]
        p = problem(kind, bench, _CONDITION, Health())
        short = np.array([0.0, 0.01])
        for other, method, rtol in (("CVODE", cvode, 1e-6), ("CVODE", cvode, 1e-9), ("LSODA", lsoda, 1e-6)):
            begun = time.process_time()
            method(p, start, short, rtol)
            found[f"{other} at rtol {rtol:g}, {name}"] = short[1] / (time.process_time() - begun)
    return found


def batch() -> float:
    """Runs of 0.15 s per second of processor time in a batch on all cores: what each core gives."""
    pump, bench = pump_type("h225").pump, circuit_parameters("shared_return")
    rng = np.random.default_rng(1)
    scenarios = [Scenario(0.15, Condition(4600, rng.uniform(30, 90), 0.5, rng.uniform(0, 20))) for _ in range(200)]
    return len(scenarios) / seconds(lambda: simulate_batch(pump, bench, scenarios))


def main() -> None:
    """Measure, print, keep."""
    found = {"times real time": side_by_side(), "runs of 0.15 s per second of each core in a batch": batch()}
    keep("transient", found)


if __name__ == "__main__":
    main()
