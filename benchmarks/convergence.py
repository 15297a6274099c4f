"""Error of cycle means against the step, plain and extrapolated: a table and a plot.

``python -m benchmarks.convergence`` writes ``benchmarks/results/convergence.json`` and ``.svg``.
"""

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt

from benchmarks import RESULTS, keep
from twin.condition import Condition
from twin.pumps import circuit_parameters, pump_type
from twin.simulation.run import simulate, steady_run
from twin.simulation.scenario import Scenario

STEPS_US = (80.0, 60.0, 40.0, 20.0, 10.0, 5.0)
_NAMES = ("discharge_pressure_bar", "case_pressure_bar", "case_flow_lpm")


def study() -> dict[str, dict[str, list[float]]]:
    """Relative errors of the means of one revolution from one settled state, against steps of 0.5 us."""
    pump, bench, condition = pump_type("h225").pump, circuit_parameters("shared_return"), Condition(4600, 50, 0.5, 10)
    start = steady_run(pump, condition, bench, settle_revolutions=40, keep_states=True).states[-1]

    def means(step_us: float, extrapolate: bool) -> dict[str, float]:
        scenario = Scenario(60.0 / 4600, condition)
        run = simulate(
            pump, bench, scenario, step_s=step_us * 1e-6, extrapolate=extrapolate, initial_state=start
        )  # fmt: skip
        return {name: run.mean(name) for name in _NAMES}

    truth = means(0.5, extrapolate=True)
    found = {}
    for label, extrapolate in (("plain", False), ("extrapolated", True)):
        rows = [means(step, extrapolate) for step in STEPS_US]
        found[label] = {name: [abs(row[name] / truth[name] - 1.0) for row in rows] for name in _NAMES}
    return found


def main() -> None:
    """Measure, draw, keep."""
    found = study()
    kept = {"step_us": list(STEPS_US), **found}
    figure, axis = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
    for label, style in (("plain", "--"), ("extrapolated", "-")):
        for name, marker in zip(_NAMES, "osv", strict=True):
            words = name.rsplit("_", 1)[0].replace("_", " ")
            axis.loglog(STEPS_US, found[label][name], style, marker=marker, label=f"{words}, {label}")
    axis.set_xlabel("step [us]")
    axis.set_ylabel("relative error of the cycle mean [-]")
    axis.grid(visible=True, which="both", alpha=0.3)
    axis.legend(fontsize=8)
    figure.savefig(RESULTS / "convergence.svg", metadata={"Date": None})
    keep("convergence", kept)


if __name__ == "__main__":
    main()
