"""The same right-hand side in other hands: CVODE (scikit-sundae) and SciPy's LSODA judge the pump's own stepper."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from sksundae.cvode import CVODE

from benchmarks.right_hand_side import rates
from twin.condition import Condition, Health
from twin.parameters import Circuit, Pump
from twin.parts.circuit import drain_conductance, turbulent_conductance
from twin.simulation.layout import N_COLUMNS, P_C, P_D, P_I, STATE_NAMES
from twin.simulation.run import steady_run
from twin.simulation.scenario import Scenario, Value
from twin.simulation.scene import N_SCENE, Scene, scene_of
from twin.units import M3_PER_S_PER_LPM, PA_PER_BAR
from twin.validation.spectrum import order_amplitudes

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

_SCALES: dict[str, float] = {
    "spool position": 1e-4,
    "spool speed": 1e-2,
    "tilt": 1e-2,
    "tilt rate": 1.0,
    "shaft angle": 1.0,
    "shaft speed": 100.0,
    "stroking piston position": 1e-4,
    "stroking piston speed": 1e-2,
    "rate piston position": 1e-4,
    "rate piston speed": 1e-2,
}
"""Sizes of the shared states, so that one tolerance fits all; pressures count in bar, gaps in um."""


@dataclass(frozen=True)
class Problem:
    """One pump at one constant condition as an initial value problem in scaled states.

    Attributes
    ----------
    scale
        Size of each state, shape (n_states,).
    rates
        Right-hand side ``f(t, y, dy)``, compiled but for its call.
    """

    pump: Pump
    circuit: Circuit
    scene: Scene
    scale: Vector
    rates: Callable[[float, Vector, Vector], None]


def problem(
    pump: Pump, circuit: Circuit, condition: Condition, health: Health, changes: dict[str, Value] | None = None
) -> Problem:
    """Initial value problem at a constant condition and health; ``changes`` as of a ``Scenario``, constants only."""
    n = int(pump.piston.n)
    _, table = Scenario(1.0, condition, health, changes or {}).table(n)
    row = table[0]
    scene = scene_of(pump, circuit, row)
    clearances = np.ascontiguousarray(row[N_SCENE:].reshape(2, n).T)
    chambers = np.empty((n, N_COLUMNS))
    shared = [_SCALES.get(name, PA_PER_BAR) for name in STATE_NAMES]
    rest = [PA_PER_BAR] * n + ([PA_PER_BAR] * n + [1e-6] * n + [1e-1] * n if pump.slipper.variable > 0.5 else [])
    scale = np.array(shared + rest)

    def f(_t: float, y: Vector, dy: Vector) -> None:
        rates(pump, circuit, scene, y * scale, n, clearances, chambers, dy)
        dy /= scale

    return Problem(pump, circuit, scene, scale, f)


def cvode(p: Problem, start: Vector, instants: Vector, rtol: float = 1e-9) -> Matrix:
    """States at ``instants`` by CVODE (BDF), SI, shape (len(instants), n_states)."""
    solver = CVODE(p.rates, method="BDF", rtol=rtol, atol=rtol, max_num_steps=100_000_000)
    solution = solver.solve(instants, start / p.scale)
    if not solution.success:
        raise RuntimeError(f"CVODE failed: {solution.message}")
    states: Matrix = solution.y * p.scale
    return states


def lsoda(p: Problem, start: Vector, instants: Vector, rtol: float = 1e-9) -> Matrix:
    """States at ``instants`` by SciPy's LSODA, SI, shape (len(instants), n_states)."""

    def f(t: float, y: Vector) -> Vector:
        dy = np.empty_like(y)
        p.rates(t, y, dy)
        return dy

    solution = solve_ivp(
        f, (instants[0], instants[-1]), start / p.scale, method="LSODA", t_eval=instants, rtol=rtol, atol=rtol
    )
    if not solution.success:
        raise RuntimeError(f"LSODA failed: {solution.message}")
    states: Matrix = solution.y.T * p.scale
    return states


def summary(p: Problem, states: Matrix, revolutions: int) -> dict[str, float]:
    """Means [bar, L/min] and order amplitudes [bar] of states sampled evenly over whole revolutions."""
    n = int(p.pump.piston.n)
    scene, shared = p.scene, p.circuit.shared > 0.5
    P_d, P_c, P_i = states[:, P_D], states[:, P_C], states[:, P_I]
    k_c, k_cQ = scene.k_c * (1.0 - scene.w_Q), scene.k_c * scene.w_Q / scene.Q_ref
    dP = P_c - (P_i if shared else scene.P_s)
    case_flow = np.array([drain_conductance(d, k_c, k_cQ) * d for d in dP])
    load = np.array([turbulent_conductance(d, scene.load) * d for d in P_d - P_i]) + scene.Q_load
    return {
        "discharge_pressure_bar": float(P_d.mean() - scene.P_amb) / PA_PER_BAR,
        "case_pressure_bar": float(P_c.mean() - scene.P_amb) / PA_PER_BAR,
        "case_flow_lpm": float(case_flow.mean()) / M3_PER_S_PER_LPM,
        "discharge_flow_lpm": float(load.mean()) / M3_PER_S_PER_LPM,
        "discharge_order_n_bar": float(order_amplitudes(P_d, revolutions, n)[-1]) / PA_PER_BAR,
        "case_order_n_bar": float(order_amplitudes(P_c, revolutions, n)[-1]) / PA_PER_BAR,
    }


@dataclass(frozen=True)
class Comparison:
    """What the pump's own stepper and CVODE make of the same revolutions from the same state."""

    own: dict[str, float]
    reference: dict[str, float]

    def error(self, name: str) -> float:
        """Relative error of the own value; of pressures against their absolute size."""
        absolute = 1.01325 if name.endswith("pressure_bar") else 0.0
        return abs(self.own[name] - self.reference[name]) / max(abs(self.reference[name] + absolute), 1e-9)


def compared(
    pump: Pump,
    circuit: Circuit,
    condition: Condition,
    health: Health,
    changes: dict[str, Value] | None = None,
    *,
    settle_revolutions: int = 60,
    lead_revolutions: int = 8,
    revolutions: int = 2,
    step_s: float | None = None,
    rtol: float = 1e-9,
) -> Comparison:
    """Settle with the own stepper, then go on with both from one state: compare what they say of the last revolutions.

    ``lead_revolutions`` lie between the common state and the compared revolutions, so that a bias of the stepper has
    time to show in the slow states too.
    """
    settled = steady_run(
        pump, condition, circuit, health, changes=changes, settle_revolutions=settle_revolutions - 1,
        mean_revolutions=1, step_s=step_s, keep_states=True,
    )  # fmt: skip
    if not settled.status.ok:
        raise RuntimeError(settled.status.advice)
    start = settled.states[-1]
    own = steady_run(
        pump, condition, circuit, health, changes=changes, settle_revolutions=lead_revolutions,
        mean_revolutions=revolutions, step_s=step_s, keep_states=True, initial_state=start,
    )  # fmt: skip
    p = problem(pump, circuit, condition, health, changes)
    period = 2 * math.pi / p.scene.omega
    fine = 1440
    instants = period * np.concatenate(
        ([0.0], lead_revolutions + np.arange(1, fine * revolutions + 1, dtype=np.float64) / fine)
    )
    states = cvode(p, start, instants, rtol)[1:]
    reference = summary(p, states, revolutions)
    per = round(len(own.states) / (lead_revolutions + revolutions))
    said = summary(p, own.states[-per * revolutions :], revolutions)
    # cycle means as the run itself gives them; amplitudes from its samples
    for name in ("discharge_pressure_bar", "case_pressure_bar", "case_flow_lpm", "discharge_flow_lpm"):
        said[name] = own.mean(name, revolutions)
    return Comparison(said, reference)
