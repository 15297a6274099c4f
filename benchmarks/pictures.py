"""The pictures of ``docs/twin.md``: parts and ports, two revolutions with variable gaps, a load step.

``python -m benchmarks.pictures`` draws them anew into ``docs/images/``.
"""

from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import FancyBboxPatch
from numpy.typing import NDArray

from twin.condition import Condition
from twin.pumps import circuit_parameters, pump_type
from twin.simulation.layout import N_SHARED, THETA
from twin.simulation.run import simulate, steady_run
from twin.simulation.scenario import Scenario, Schedule

IMAGES = Path(__file__).parent.parent / "docs" / "images"
_BLUE = "#1f4e79"
Traces = list[tuple[str, NDArray[np.float64]]]


def _stack(name: str, title: str, x_label: str, x: NDArray[np.float64], traces: Traces) -> None:
    figure, axes = plt.subplots(len(traces), 1, figsize=(7.2, 7.6), sharex=True, layout="constrained")
    for axis, (label, values) in zip(axes, traces, strict=True):
        axis.plot(x, values, lw=1.1, color=_BLUE)
        axis.set_ylabel(label)
        axis.grid(visible=True, alpha=0.3)
    axes[-1].set_xlabel(x_label)
    axes[0].set_title(title, fontsize=10)
    if name == "twin-load-step":
        axes[0].axhline(257, color="#a33", ls="--", lw=1)
        axes[0].text(x[-1], 258, "limit 257 bar", ha="right", va="bottom", fontsize=8)
        axes[0].set_ylim(50, 280)
    figure.savefig(IMAGES / f"{name}.svg", metadata={"Date": None})


def two_revolutions() -> None:
    """Pressures and one slipper's gap."""
    pump, bench = pump_type("h225").pump, circuit_parameters("shared_return")
    pump = pump._replace(slipper=pump.slipper._replace(variable=1.0))
    condition = Condition(4600, 50, 0.2, 10)
    start = steady_run(pump, condition, bench, settle_revolutions=40, keep_states=True).states[-1]
    run = simulate(pump, bench, Scenario(2 * 60 / 4600, condition), keep_states=True, initial_state=start)
    gap = N_SHARED + 2 * int(pump.piston.n)
    traces = [
        ("discharge\n[bar]", run.recording["discharge_pressure_bar"]),
        ("case\n[mbar]", 1e3 * run.recording["case_pressure_bar"]),
        ("chamber 1\n[bar, abs.]", run.states[:, N_SHARED] / 1e5),
        ("gap 1\n[um]", run.states[:, gap] * 1e6),
    ]
    angle = np.degrees(np.unwrap(run.states[:, THETA]))
    title = "Two revolutions, 4600 rpm, 50 degC, 10 L/min, variable gaps"
    _stack("twin-two-revolutions", title, "shaft angle [deg]", angle, traces)


def load_step() -> None:
    """Full flow to zero at 0.25 s and back at 1.25 s."""
    load = Schedule((0.25, 0.255, 1.25, 1.255), (2.25, 0.0, 0.0, 2.25))
    scenario = Scenario(2.0, Condition(4600, 60, 0.1), changes={"load_conductance_lpm_per_sqrt_bar": load})
    run = simulate(pump_type("h225").pump, circuit_parameters("acceptance_stand"), scenario, sample_rate_hz=5000)
    names = {
        "discharge\n[bar]": "discharge_pressure_bar",
        "control\n[bar]": "control_pressure_bar",
        "tilt\n[deg]": "swashplate_angle_deg",
        "load flow\n[L/min]": "discharge_flow_lpm",
    }
    traces = [(label, run.recording[name]) for label, name in names.items()]
    title = "Load step on the acceptance stand, 4600 rpm, 60 degC"
    _stack("twin-load-step", title, "time [s]", run.recording.time_s, traces)


_BOXES = (
    (0.2, 4.6, 1.5, "drive"),
    (2.6, 4.6, 2.0, "pistons and\nchambers (5 to 13)"),
    (5.6, 4.6, 1.6, "port plate"),
    (8.2, 4.6, 1.6, "circuit:\nload, return, leak"),
    (2.6, 2.7, 2.0, "slippers:\nthrottle, pocket, land"),
    (5.6, 2.7, 1.6, "case volume"),
    (8.2, 2.7, 1.6, "drain line"),
    (2.6, 0.8, 2.0, "swashplate:\nstops, bearings"),
    (5.6, 0.8, 1.6, "servo pistons:\nstroking, rate"),
    (8.2, 0.8, 1.6, "compensator:\nspool, edges, bleed"),
)
_ARROWS = (
    ((1.7, 5.0), (2.6, 5.0), "torque, speed", 0.0, 0.12),
    ((4.6, 5.0), (5.6, 5.0), "P, Q", 0.0, 0.12),
    ((7.2, 5.15), (8.2, 5.15), "discharge P_d", 0.0, 0.12),
    ((7.2, 4.75), (8.2, 4.75), "suction P_s", 0.0, -0.22),
    ((3.6, 4.6), (3.6, 3.5), "ball joint force;\nthrottle flow", -0.72, -0.05),
    ((3.6, 2.7), (3.6, 1.6), "film force, gap h", 0.75, -0.02),
    ((4.6, 1.2), (5.6, 1.2), "push, tilt", 0.0, 0.12),
    ((7.2, 1.2), (8.2, 1.2), "control P_ctrl", 0.0, 0.12),
    ((4.6, 3.1), (5.6, 3.1), "leakage", 0.0, 0.12),
    ((7.2, 3.1), (8.2, 3.1), "case P_c", 0.0, 0.12),
    ((4.5, 4.6), (5.7, 3.5), "piston leakage", 0.62, -0.05),
    ((6.4, 4.6), (6.4, 3.5), "gap leakage", 0.6, 0.0),
    ((6.4, 1.6), (6.4, 2.7), "leakage,\nswept volume", 0.62, -0.02),
    ((8.4, 1.6), (7.1, 2.7), "bleed", 0.25, 0.0),
    ((9.5, 4.6), (9.5, 1.6), "P_d", 0.22, -0.55),
    ((8.6, 3.5), (8.6, 4.6), "drain", 0.33, 0.0),
)


def parts() -> None:
    """Blocks of the pump with what passes between their ports."""
    figure, axis = plt.subplots(figsize=(9, 5.2), layout="constrained")
    axis.axis("off")
    axis.set_xlim(0, 10)
    axis.set_ylim(0.5, 5.8)
    for x, y, width, words in _BOXES:
        colour = "#f5efe2" if words == "case volume" else "#e8eef5"
        axis.add_patch(FancyBboxPatch((x, y), width, 0.8, boxstyle="round,pad=0.03", fc=colour, ec=_BLUE))
        axis.text(x + width / 2, y + 0.4, words, ha="center", va="center", fontsize=9)
    for start, end, words, dx, dy in _ARROWS:
        axis.annotate("", end, start, arrowprops={"arrowstyle": "<->", "color": "#444", "lw": 1.2})
        middle = ((start[0] + end[0]) / 2 + dx, (start[1] + end[1]) / 2 + dy)
        axis.text(*middle, words, fontsize=7.5, ha="center", color="#444")
    figure.savefig(IMAGES / "twin-parts.svg", metadata={"Date": None})


if __name__ == "__main__":
    parts()
    two_revolutions()
    load_step()
