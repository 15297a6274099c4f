"""Run the transient pump at one condition: compiled loop and typed shell."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled
from twin.condition import OUTPUTS, Condition, Health, input_rows
from twin.parameters import Circuit, Pump
from twin.simulation.network import ALPHA, Scene, scene_of
from twin.simulation.step import N_FLOWS, N_SHARED, N_SOLVED, step
from twin.steady_solver import WORK_ROWS, solve_cold
from twin.steady_state import N_UNKNOWNS
from twin.units import M3_PER_S_PER_LPM, PA_PER_BAR, RAD_PER_DEG

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

RUN_OK, RUN_FAILED = 0, 1
DEFAULT_STEP_S = 40.0e-6
MEANS: tuple[str, ...] = (
    "discharge_pressure_bar",
    "case_pressure_bar",
    "return_pressure_bar",
    "control_pressure_bar",
    "swashplate_angle_deg",
    "discharge_flow_lpm",
    "case_flow_lpm",
    "return_flow_lpm",
    "suction_flow_lpm",
    "shaft_torque_nm",
)
"""Cycle means that a run gives; discharge flow includes what leaks in the circuit, torque is the hydraulic part."""


@dataclass(frozen=True, slots=True)
class SteadyRun:
    """A run at constant condition.

    Attributes
    ----------
    time_s, states
        Instants, shape (m,), and states, shape (m, n + 8): chambers' pressures, P_d, P_c, P_i, P_ctrl [Pa
        absolute], spool position [m] and speed, tilt [rad] and tilt rate.
    means
        Means over the last whole revolutions by the names of ``MEANS``.
    status
        0 when the run went through; else it stopped at the last instant of ``time_s``.
    """

    time_s: Vector
    states: Matrix
    means: dict[str, float]
    status: int


@compiled
def advance(
    pump: Pump,
    circuit: Circuit,
    scene: Scene,
    y: Vector,
    n: int,
    theta: float,
    dt: float,
    extrapolate: bool,
    scales: Matrix,
    chambers: Matrix,
    A: Matrix,
    b: Vector,
    coarse: Vector,
    flows: Vector,
    flows_2: Vector,
) -> bool:
    """One step of ``dt``, extrapolated from one full and two half steps: second order, the bias taken out."""
    if not extrapolate:
        return step(pump, circuit, scene, y, n, theta, dt, scales, chambers, A, b, flows)
    coarse[:] = y
    ok = step(pump, circuit, scene, coarse, n, theta, dt, scales, chambers, A, b, flows)
    half = 0.5 * dt
    ok = ok and step(pump, circuit, scene, y, n, theta, half, scales, chambers, A, b, flows_2)
    for j in range(N_FLOWS):
        flows[j] = flows_2[j] - flows[j]
    ok = ok and step(pump, circuit, scene, y, n, theta + scene.omega * half, half, scales, chambers, A, b, flows_2)
    for j in range(N_FLOWS):
        flows[j] += flows_2[j]
    for j in range(y.shape[0]):
        y[j] = 2.0 * y[j] - coarse[j]
    return ok


@compiled
def run_loop(
    pump: Pump,
    circuit: Circuit,
    scene: Scene,
    y: Vector,
    n: int,
    dt: float,
    n_steps: int,
    n_mean: int,
    every: int,
    extrapolate: bool,
    scales: Matrix,
    out: Matrix,
    means: Vector,
) -> int:
    """Take ``n_steps``; every ``every``-th state goes to ``out``; the last ``n_mean`` steps are averaged.

    Returns the number of steps that went through. Nothing is allocated inside the loop.
    """
    chambers = np.empty((n, 12))
    A, b = np.empty((N_SOLVED, N_SOLVED)), np.empty(N_SOLVED)
    coarse = np.empty(y.shape[0])
    flows, flows_2 = np.empty(N_FLOWS), np.empty(N_FLOWS)
    means[:] = 0.0
    theta = 0.0
    for i in range(n_steps):
        if i % every == 0:
            out[i // every, :] = y
        ok = advance(pump, circuit, scene, y, n, theta, dt, extrapolate, scales, chambers, A, b, coarse, flows, flows_2)
        if not ok:
            return i
        theta = (theta + scene.omega * dt) % (2.0 * math.pi)
        if i >= n_steps - n_mean:
            for j in range(4):
                means[j] += y[n + j] / n_mean
            means[4] += y[n + ALPHA] / n_mean
            for j in range(N_FLOWS):
                means[5 + j] += flows[j] / n_mean
    return n_steps


def initial_state(pump: Pump, circuit: Circuit, row: Vector, k_d: float) -> Vector:
    """State at the operating point of one row of inputs, chambers included, shape (n + 8,).

    Raises
    ------
    ValueError
        when there is no operating point to start from.
    """
    u, Y, work = np.empty(N_UNKNOWNS), np.empty(len(OUTPUTS)), np.empty((WORK_ROWS, N_UNKNOWNS))
    if not solve_cold(pump, circuit, row, k_d, u, Y, work):
        raise ValueError("no operating point to start from: ask for less flow or a healthier pump")
    n = int(pump.piston.n)
    ambient = row[4] * PA_PER_BAR
    P_s = row[2] * PA_PER_BAR + ambient
    angles = 2.0 * np.pi * np.arange(n) / n
    y = np.empty(n + N_SHARED)
    y[:n] = np.where((angles > pump.port_plate.phi_commutation) & (angles < np.pi), u[0], P_s)
    y[n : n + 4] = Y[:4] * PA_PER_BAR + ambient
    y[n + 4 :] = (u[3], 0.0, min(u[2], pump.swashplate.alpha_max), 0.0)
    return y


def steady_run(
    pump: Pump,
    condition: Condition,
    circuit: Circuit,
    health: Health = Health(),  # noqa: B008 - immutable
    *,
    load_coefficient: float = 0.0,
    settle_revolutions: int = 12,
    mean_revolutions: int = 4,
    step_s: float = DEFAULT_STEP_S,
    extrapolate: bool = True,
    piston_scales: Vector | None = None,
    slipper_scales: Vector | None = None,
) -> SteadyRun:
    """Simulate the pump at constant condition from its operating point, and average over whole revolutions.

    Parameters
    ----------
    load_coefficient
        Where positive, the load is equation 3-2 with this k_d [Pa/(m3/s)^2].
    settle_revolutions, mean_revolutions
        Revolutions before and within the average.
    step_s
        Step [s], shortened so that a revolution is a whole number of steps.
    extrapolate
        Second order by extrapolation; False gives the plain first-order step.
    piston_scales, slipper_scales
        Leakage of each piston and slipper relative to the health's, shape (n,).

    Raises
    ------
    ValueError
        when there is no operating point to start from, or a scale has the wrong shape.
    """
    n = int(pump.piston.n)
    row = input_rows([condition], [health])[0]
    scene = scene_of(pump, circuit, row, load_coefficient)
    scales = np.ones((n, 2))
    for j, own in enumerate((piston_scales, slipper_scales)):
        if own is not None:
            if np.shape(own) != (n,):
                raise ValueError(f"leakage scales must have shape ({n},), one per piston; got {np.shape(own)}")
            scales[:, j] = own
    per_revolution = math.ceil(2.0 * math.pi / scene.omega / step_s)
    dt = 2.0 * math.pi / scene.omega / per_revolution
    n_steps = per_revolution * (settle_revolutions + mean_revolutions)
    y = initial_state(pump, circuit, row, load_coefficient)
    states, means = np.empty((n_steps, len(y))), np.empty(len(MEANS))
    done = run_loop(
        pump,
        circuit,
        scene,
        y,
        n,
        dt,
        n_steps,
        per_revolution * mean_revolutions,
        1,
        extrapolate,
        scales,
        states,
        means,
    )
    ambient = condition.ambient_pressure_bar * PA_PER_BAR
    means[:4] = (means[:4] - ambient) / PA_PER_BAR
    means[4] /= RAD_PER_DEG
    means[5:9] /= M3_PER_S_PER_LPM
    named: dict[str, float] = dict(zip(MEANS, means.tolist(), strict=True))
    time_s = dt * np.arange(done, dtype=np.float64)
    return SteadyRun(time_s, states[:done], named, RUN_OK if done == n_steps else RUN_FAILED)
