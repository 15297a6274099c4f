"""Many steps: extrapolation, schedules, step control, averages and samples. Nothing is allocated inside."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled
from twin.laws.compressibility import P_FLOOR, pressure_of
from twin.parameters import Circuit, Pump
from twin.parts.piston import chamber_volume
from twin.simulation import slippers
from twin.simulation.layout import (
    ALPHA,
    ALPHA_DOT,
    N_COLUMNS,
    N_FLOWS,
    N_SHARED,
    OMEGA,
    P_CTRL,
    P_D,
    THETA,
    V_SPOOL,
    X,
)
from twin.simulation.scene import N_SCENE, Scene, scene_of
from twin.simulation.step import N_SOLVED, passages, solve_step

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

RUNNING, DIVERGED, CAVITATED, STEP_TOO_SHORT = 0, 1, 2, 3
N_SAMPLE = N_SHARED + N_FLOWS
"""A sample: shared states, then the means of the flows since the sample before."""
N_MEAN = 5 + N_FLOWS
"""A mean: P_d, P_c, P_i, P_ctrl, tilt, then the flows."""
_CAVITY = 1.0e3
"""A shared volume this far below ``P_FLOOR`` [Pa] is starved: what it should deliver is not there."""
_SHORTEST = 0.2e-6
_BLOW_STEP = 1.0e-6
"""Step while a slipper slams down on the plate [s]."""
_FINE_ANGLE = 0.005
"""Angle that a filling chamber turns per substep [rad], 0.3 degrees."""
_ROUNDING = 1.0e-9
"""Angle by which a sum of steps may miss a whole revolution [rad]."""


class Workspace(NamedTuple):
    """Scratch of one run: made once, so that no step allocates."""

    ch: Matrix
    A: Matrix
    b: Vector
    coarse: Vector
    before: Vector
    masses: Vector
    masses_coarse: Vector
    flows: Vector
    flows_half: Vector
    clearances: Matrix


@compiled
def workspace(n: int, m: int) -> Workspace:
    """Scratch for n pistons and m states."""
    return Workspace(
        np.empty((n, N_COLUMNS)),
        np.empty((N_SOLVED, N_SOLVED)),
        np.empty(N_SOLVED),
        np.empty(m),
        np.empty(m),
        np.empty(4 + 2 * n),
        np.empty(4 + 2 * n),
        np.empty(N_FLOWS),
        np.empty(N_FLOWS),
        np.ones((n, 2)),
    )


@compiled
def advance(
    pump: Pump,
    circuit: Circuit,
    scene: Scene,
    y: Vector,
    n: int,
    dt: float,
    T_start: float,
    extrapolate: bool,
    clearances: Matrix,
    ch: Matrix,
    A: Matrix,
    b: Vector,
    coarse: Vector,
    masses: Vector,
    masses_coarse: Vector,
    flows: Vector,
    flows_half: Vector,
) -> bool:
    """One step of ``dt``; extrapolated from one full and two half steps: second order, the bias taken out.

    Masses are extrapolated, not pressures, so that the extrapolated state conserves mass as the steps do. With variable
    gaps ``ch`` holds the slippers' substeps for this step (``slippers.choose_substeps``).
    """
    s = passages(pump, circuit, scene, y, n, clearances, ch)
    n_sub = max(1, math.ceil(y[OMEGA] * dt / _FINE_ANGLE))
    if not extrapolate:
        return solve_step(pump, circuit, scene, s, y, n, dt, n_sub, T_start, clearances, ch, A, b, masses, flows)
    half = 0.5 * dt
    coarse[:] = y
    ok = solve_step(
        pump,
        circuit,
        scene,
        s,
        coarse,
        n,
        dt,
        n_sub,
        T_start,
        clearances,
        ch,
        A,
        b,
        masses_coarse,
        flows,
    )
    ok = ok and solve_step(
        pump, circuit, scene, s, y, n, half, n_sub, T_start, clearances, ch, A, b, masses, flows_half
    )
    if not ok:
        return False
    for j in range(N_FLOWS):
        flows[j] = flows_half[j] - flows[j]
    s = passages(pump, circuit, scene, y, n, clearances, ch)
    ok = solve_step(pump, circuit, scene, s, y, n, half, n_sub, T_start, clearances, ch, A, b, masses, flows_half)
    for j in range(N_FLOWS):
        flows[j] += flows_half[j]
    m, volumes, piston = scene.medium, pump.volumes, pump.piston
    for j in range(4, y.shape[0]):
        y[j] = 2.0 * y[j] - coarse[j]
    other = masses_coarse
    y[0] = pressure_of(m, 2.0 * masses[0] - other[0], volumes.discharge, y[0])
    y[1] = pressure_of(m, 2.0 * masses[1] - other[1], volumes.case, y[1])
    y[2] = pressure_of(m, 2.0 * masses[2] - other[2], volumes.return_line, y[2])
    y[3] = pressure_of(m, 2.0 * masses[3] - other[3], volumes.control, y[3])
    t = math.tan(y[ALPHA])
    c, sn = math.cos(y[THETA]), math.sin(y[THETA])
    turn_c, turn_s = math.cos(2.0 * math.pi / n), math.sin(2.0 * math.pi / n)
    lifted = pump.slipper.variable > 0.5
    for k in range(n):
        if lifted:
            h = y[N_SHARED + 2 * n + k]
            V = slippers.lifted_volume(piston, scene.t_max, t, c, h)
            held = 2.0 * masses[4 + n + k] - other[4 + n + k]
            pocket = pump.slipper.V_pocket + scene.S_eq * h
            y[N_SHARED + n + k] = pressure_of(m, held, pocket, y[N_SHARED + n + k])
        else:
            V = chamber_volume(piston, scene.t_max, t, c)
        y[N_SHARED + k] = pressure_of(m, 2.0 * masses[4 + k] - other[4 + k], V, y[N_SHARED + k])
        c, sn = c * turn_c - sn * turn_s, sn * turn_c + c * turn_s
    return ok and math.isfinite(y[P_D] + y[ALPHA])


@compiled
def step_error(y: Vector, coarse: Vector) -> float:
    """Change that extrapolation made, over the tolerances 0.02 bar, 2 um, 20 urad and 0.5 % of speeds' scales [-].

    ``y`` is the extrapolated, ``coarse`` the full step's state; the true error of ``y`` is far smaller.
    """
    worst = 0.0
    for j in range(P_D, P_CTRL + 1):
        worst = max(worst, abs(y[j] - coarse[j]) / 2.0e4)
    worst = max(worst, abs(y[X] - coarse[X]) / 2.0e-5)
    worst = max(worst, abs(y[V_SPOOL] - coarse[V_SPOOL]) / 0.05)
    worst = max(worst, abs(y[ALPHA] - coarse[ALPHA]) / 1.0e-4)
    return float(max(worst, abs(y[ALPHA_DOT] - coarse[ALPHA_DOT]) / 0.5))


@compiled
def _inputs_at(times: Vector, table: Matrix, time: float, segment: int, out: Vector) -> int:
    """Linear interpolation of the schedule; returns the segment, the last whose start is not after ``time``."""
    last = times.shape[0] - 1
    while segment < last and times[segment + 1] <= time:
        segment += 1
    if segment >= last:
        out[:] = table[last]
    else:
        span = times[segment + 1] - times[segment]
        share = min(max((time - times[segment]) / span, 0.0), 1.0)
        for j in range(out.shape[0]):
            out[j] = table[segment, j] + share * (table[segment + 1, j] - table[segment, j])
    return segment


@compiled
def _is_constant(table: Matrix, segment: int) -> bool:
    if segment >= table.shape[0] - 1:
        return True
    same = True
    for j in range(table.shape[1]):
        same = same and table[segment, j] == table[segment + 1, j]
    return same


@compiled
def run_loop(
    pump: Pump,
    circuit: Circuit,
    times: Vector,
    table: Matrix,
    y: Vector,
    n: int,
    start: float,
    dt: float,
    n_steps: int,
    substeps: int,
    extrapolate: bool,
    adaptive: bool,
    T_start: float,
    keep: Matrix,
    samples: Matrix,
    revolution: Vector,
    means: Matrix,
    counts: NDArray[np.int64],
    ws: Workspace,
) -> int:
    """Advance ``y`` from ``start`` by ``n_steps`` sample intervals, each of ``substeps`` steps of ``dt`` or adaptive ones.

    Parameters
    ----------
    times, table
        Schedule: instants (m,) and inputs (m, N_SCENE + 2 n), the last 2 n being clearance factors of pistons, slippers.
    samples, keep
        A sample per interval (>= n_steps, N_SAMPLE); all states where ``keep`` has as many rows, else none.
    revolution
        Time, integral of the means and angle since the last whole revolution, (3 + 2 N_MEAN,): carried between calls.
    means
        Cycle means, one row per revolution that ended: its end [s], then N_MEAN values; ``counts[0]`` rows are filled.
    counts
        Revolutions ended, steps taken, steps rejected, (3,).

    Returns
    -------
    int
        ``RUNNING`` when it went through; else what stopped it, ``y`` being the worst state and ``revolution[0]`` its time.
    """
    # unpacked once: taking an array out of a tuple counts references, which costs more than a chamber
    ch, A, b, coarse, before, clearances = ws.ch, ws.A, ws.b, ws.coarse, ws.before, ws.clearances
    masses, masses_coarse, flows, flows_half = ws.masses, ws.masses_coarse, ws.flows, ws.flows_half
    inputs = np.empty(table.shape[1])
    segment = 0
    time = start
    segment = _inputs_at(times, table, time, segment, inputs)
    scene = scene_of(pump, circuit, inputs)
    _clearances(inputs, n, clearances)
    fresh = segment
    constant = _is_constant(table, segment)
    interval = dt * substeps
    h = dt
    whole = 2.0 * math.pi
    lifted = pump.slipper.variable > 0.5
    pieces_left, step, blow = 0, dt, False
    through = np.empty(N_FLOWS)
    for i in range(n_steps):
        end = start + (i + 1) * interval
        through[:] = 0.0
        j = 0
        while True:
            left = end - time
            if adaptive:
                if left <= 0.25 * _SHORTEST:
                    break
                n_left = math.ceil(left / h - 1.0e-9)
                step = left / n_left
                before[:] = y
                blow = lifted and slippers.choose_substeps(pump, y, n, step, ch)
            else:
                if j == substeps:
                    break
                if pieces_left == 0:
                    pieces_left, step = 1, dt
                    blow = lifted and slippers.choose_substeps(pump, y, n, dt, ch)
                    if blow:
                        pieces_left = max(1, math.ceil(dt / _BLOW_STEP - 1.0e-9))
                        step = dt / pieces_left
                if blow:
                    slippers.choose_substeps(pump, y, n, step, ch)
            segment = _inputs_at(times, table, time + 0.5 * step, segment, inputs)
            if segment != fresh or not constant:
                scene = scene_of(pump, circuit, inputs)
                _clearances(inputs, n, clearances)
                fresh = segment
                constant = _is_constant(table, segment)
            ok = advance(
                pump, circuit, scene, y, n, step, T_start, extrapolate or adaptive,
                clearances, ch, A, b, coarse, masses, masses_coarse, flows, flows_half,
            )  # fmt: skip
            counts[1] += 1
            if adaptive:
                error = step_error(y, coarse) if ok else math.inf
                if error > 1.0:
                    counts[2] += 1
                    y[:] = before
                    h = step * max(0.2, 0.8 / math.sqrt(error))
                    if h < _SHORTEST:
                        revolution[0] = time
                        return STEP_TOO_SHORT
                    continue
                h = min(dt, step * min(1.5, 0.9 / math.sqrt(max(error, 1.0e-4))))
            time = time + step
            pieces_left -= 1
            if pieces_left <= 0:
                pieces_left = 0
                j += 1
            if not ok:
                revolution[0] = time
                return DIVERGED
            if y[P_D] < P_FLOOR - _CAVITY or y[P_D + 1] < P_FLOOR - _CAVITY:
                revolution[0] = time
                return CAVITATED
            for k in range(N_FLOWS):
                through[k] += step / interval * flows[k]
            _average(y, n, time, step, flows, revolution, means, counts)
            if y[THETA] >= whole - _ROUNDING:
                y[THETA] -= whole
        time = end
        if not adaptive:
            time = start + (i + 1) * interval
        samples[i, :N_SHARED] = y[:N_SHARED]
        samples[i, N_SHARED:] = through
        if keep.shape[0] > i:
            keep[i, :] = y
    return RUNNING


@compiled
def _clearances(inputs: Vector, n: int, clearances: Matrix) -> None:
    for k in range(n):
        clearances[k, 0] = inputs[N_SCENE + k]
        clearances[k, 1] = inputs[N_SCENE + n + k]


@compiled
def _average(
    y: Vector,
    n: int,
    time: float,
    step: float,
    flows: Vector,
    revolution: Vector,
    means: Matrix,
    counts: NDArray[np.int64],
) -> None:
    """Add a step to the integrals of its revolution; where the shaft came round, split the step and close the mean."""
    angle = y[THETA]
    turned = angle - revolution[1]
    whole = 2.0 * math.pi
    share = 1.0
    ended = angle >= whole - _ROUNDING
    if ended:
        share = (whole - revolution[1]) / turned
        share = 1.0 if share > 1.0 - 1.0e-6 else share
    revolution[2] += share * step
    first = 3 + N_MEAN
    for j in range(N_MEAN):
        value = y[j] if j < 4 else (y[ALPHA] if j == 4 else flows[j - 5])
        if j < 5:
            # states by the trapezium of the step's both ends, flows as means of the step
            begun = revolution[first + j]
            middle = begun + 0.5 * share * (value - begun)
            revolution[3 + j] += share * step * middle
        else:
            revolution[3 + j] += share * step * value
    if ended:
        if counts[0] < means.shape[0]:
            row = means[counts[0]]
            row[0] = time - (1.0 - share) * step
            for j in range(N_MEAN):
                row[1 + j] = revolution[3 + j] / revolution[2]
        counts[0] += 1
        rest = (1.0 - share) * step
        revolution[2] = rest
        for j in range(N_MEAN):
            value = y[j] if j < 4 else (y[ALPHA] if j == 4 else flows[j - 5])
            if j < 5:
                begun = revolution[first + j]
                middle = value - 0.5 * (1.0 - share) * (value - begun)
                revolution[3 + j] = rest * middle
            else:
                revolution[3 + j] = rest * value
    for j in range(5):
        revolution[first + j] = y[j] if j < 4 else y[ALPHA]
    revolution[1] = angle - whole if ended else angle
