"""Many steps: extrapolation, schedules, step control, averages and samples. Nothing is allocated inside."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled
from twin.laws.compressibility import P_FLOOR, pressure_of
from twin.parameters import Circuit, Pump
from twin.parts.piston import chamber_volume
from twin.simulation import mapped_slippers, slippers
from twin.simulation.averages import ROUNDING, STOPPED_AT, TAKEN, Account, average
from twin.simulation.film import lifted_volume
from twin.simulation.layout import (
    ALPHA,
    N_COLUMNS,
    N_FLOWS,
    N_SHARED,
    N_SOLVED,
    N_VOLUMES,
    OF_PISTON,
    OF_SLIPPER,
    OMEGA,
    P_C,
    P_CTRL,
    P_D,
    P_I,
    THETA,
)
from twin.simulation.mapped_slippers import Gaps
from twin.simulation.scene import N_SCENE, Scene, scene_of
from twin.simulation.step import Scratch, Step, passages, solve_step

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

RUNNING, DIVERGED, CAVITATED = 0, 1, 2
N_SAMPLE = N_SHARED + N_FLOWS
"""A sample: shared states, then the means of the flows since the sample before."""
_CAVITY = 1.0e3
"""A shared volume this far below ``P_FLOOR`` [Pa] is starved: what it should deliver is not there."""
_BLOW_STEP = 1.0e-6
"""Step while a slipper slams down on the plate [s]."""
_FINE_ANGLE = 0.005
"""Angle that a filling chamber turns per substep [rad], 0.3 degrees."""


class Workspace(NamedTuple):
    """What a run works on, made once, so that no step allocates.

    Scratch of a step, states of the full step, masses of the last half step and of the full one, flows of a step and of
    half of it; means for the metamodel of the slippers (``mapped_slippers``).
    """

    scratch: Scratch
    coarse: Vector
    masses: Vector
    masses_coarse: Vector
    flows: Vector
    flows_half: Vector
    gathered: Vector


class Inputs(NamedTuple):
    """Schedule: instants (m,) and inputs (m, N_SCENE + 2 n), the last 2 n being factors on the gaps of pistons, slippers."""

    times: Vector
    table: Matrix


class Pace(NamedTuple):
    """How a run goes on: from ``start`` [s] by ``n_steps`` samples, each of ``substeps`` steps of ``dt`` [s];
    ``T_start`` is the pump's torque at the first instant [N m].
    """

    start: float
    dt: float
    n_steps: int
    substeps: int
    extrapolate: bool
    T_start: float


@compiled
def workspace(n: int, m: int, mapped: bool = False) -> Workspace:
    """Workspace for n pistons and m states; ``mapped`` where a metamodel stands for the slippers."""
    added = np.zeros(mapped_slippers.N_ADDED if mapped else 0)
    A, b = np.empty((N_SOLVED, N_SOLVED)), np.empty(N_SOLVED)
    scratch = Scratch(np.ones((n, 2)), np.empty((n, N_COLUMNS)), A, b, added)
    gathered = np.zeros(mapped_slippers.N_GATHERED)
    gathered[mapped_slippers.FIRST_OUTSIDE] = math.inf
    return Workspace(
        scratch,
        np.empty(m),
        np.empty(N_VOLUMES + 2 * n),
        np.empty(N_VOLUMES + 2 * n),
        np.empty(N_FLOWS),
        np.empty(N_FLOWS),
        gathered,
    )


@compiled
def advance(
    pump: Pump,
    circuit: Circuit,
    scene: Scene,
    y: Vector,
    dt: float,
    T_start: float,
    extrapolate: bool,
    ws: Workspace,
) -> bool:
    """One step of ``dt``; extrapolated from one full and two half steps: second order, the bias taken out.

    Masses are extrapolated, not pressures, so that the extrapolated state conserves mass as the steps do. With variable
    gaps the chambers' table holds the slippers' substeps for this step (``slippers.choose_substeps``).
    """
    scratch, coarse, masses, masses_coarse = ws.scratch, ws.coarse, ws.masses, ws.masses_coarse
    flows, flows_half = ws.flows, ws.flows_half
    clearances, ch = scratch.clearances, scratch.ch
    n = ch.shape[0]
    n_sub = max(1, math.ceil(y[OMEGA] * dt / _FINE_ANGLE))
    full, half = Step(n, dt, n_sub, T_start), Step(n, 0.5 * dt, n_sub, T_start)
    s = passages(pump, circuit, scene, y, n, clearances, ch)
    if not extrapolate:
        return solve_step(pump, circuit, scene, s, y, full, scratch, masses, flows)
    coarse[:] = y
    ok = solve_step(pump, circuit, scene, s, coarse, full, scratch, masses_coarse, flows)
    ok = ok and solve_step(pump, circuit, scene, s, y, half, scratch, masses, flows_half)
    if not ok:
        return False
    for j in range(N_FLOWS):
        flows[j] = flows_half[j] - flows[j]
    s = passages(pump, circuit, scene, y, n, clearances, ch)
    ok = solve_step(pump, circuit, scene, s, y, half, scratch, masses, flows_half)
    for j in range(N_FLOWS):
        flows[j] += flows_half[j]
    m, volumes, piston = scene.medium, pump.volumes, pump.piston
    for j in range(N_VOLUMES, y.shape[0]):
        y[j] = 2.0 * y[j] - coarse[j]
    other = masses_coarse
    y[P_D] = pressure_of(m, 2.0 * masses[P_D] - other[P_D], volumes.discharge, y[P_D])
    y[P_C] = pressure_of(m, 2.0 * masses[P_C] - other[P_C], volumes.case, y[P_C])
    y[P_I] = pressure_of(m, 2.0 * masses[P_I] - other[P_I], volumes.return_line, y[P_I])
    y[P_CTRL] = pressure_of(m, 2.0 * masses[P_CTRL] - other[P_CTRL], volumes.control, y[P_CTRL])
    t = math.tan(y[ALPHA])
    c, sn = math.cos(y[THETA]), math.sin(y[THETA])
    turn_c, turn_s = math.cos(2.0 * math.pi / n), math.sin(2.0 * math.pi / n)
    lifted = pump.slipper.variable > 0.5
    for k in range(n):
        if lifted:
            h = y[N_SHARED + 2 * n + k]
            V = lifted_volume(piston, scene.t_max, t, c, h)
            held = 2.0 * masses[N_VOLUMES + n + k] - other[N_VOLUMES + n + k]
            pocket = pump.slipper.V_pocket + scene.S_eq * h
            y[N_SHARED + n + k] = pressure_of(m, held, pocket, y[N_SHARED + n + k])
        else:
            V = chamber_volume(piston, scene.t_max, t, c)
        y[N_SHARED + k] = pressure_of(m, 2.0 * masses[N_VOLUMES + k] - other[N_VOLUMES + k], V, y[N_SHARED + k])
        c, sn = c * turn_c - sn * turn_s, sn * turn_c + c * turn_s
    return ok and math.isfinite(y[P_D] + y[ALPHA])


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
def _divided(pump: Pump, y: Vector, n: int, dt: float, ch: Matrix) -> tuple[int, float, bool]:
    """Pieces of a step of ``dt``, their length, and whether a slipper slams down: then they are short."""
    if pump.slipper.variable < 0.5 or not slippers.choose_substeps(pump, y, n, dt, ch):
        return 1, dt, False
    count = max(1, math.ceil(dt / _BLOW_STEP - 1.0e-9))
    return count, dt / count, True


@compiled
def run_loop(
    pump: Pump, circuit: Circuit, gaps: Gaps, inputs_of: Inputs, y: Vector, pace: Pace, account: Account, ws: Workspace
) -> int:
    """Advance ``y`` by the sample intervals of ``pace``; ``gaps`` is asked where the workspace is made for it.

    Returns
    -------
    int
        ``RUNNING`` when it went through; else what stopped it, ``y`` being the worst state and
        ``revolution[STOPPED_AT]`` its time.
    """
    # unpacked once: taking an array out of a tuple counts references, which costs more than a chamber
    times, table = inputs_of
    start, dt, n_steps, substeps, extrapolate, T_start = pace
    keep, samples, revolution, counts = account.keep, account.samples, account.revolution, account.counts
    clearances, ch, flows = ws.scratch.clearances, ws.scratch.ch, ws.flows
    added, gathered = ws.scratch.added, ws.gathered
    mapped = added.shape[0] > 0
    n = ch.shape[0]
    inputs = np.empty(table.shape[1])
    segment = 0
    time = start
    segment = _inputs_at(times, table, time, segment, inputs)
    scene = scene_of(pump, circuit, inputs)
    _clearances(inputs, n, clearances)
    fresh = segment
    constant = _is_constant(table, segment)
    if mapped and gathered[mapped_slippers.SPENT] == 0.0:
        mapped_slippers.gather(y, 1.0e-9, gathered)
        mapped_slippers.ask(pump, gaps, inputs, clearances[:, OF_SLIPPER], y[OMEGA], gathered, time, added)
    interval = dt * substeps
    whole = 2.0 * math.pi
    pieces_left, step, blow = 0, dt, False
    through = np.empty(N_FLOWS)
    for i in range(n_steps):
        through[:] = 0.0
        j = 0
        while j < substeps:
            if pieces_left == 0:
                pieces_left, step, blow = _divided(pump, y, n, dt, ch)
            if blow:
                slippers.choose_substeps(pump, y, n, step, ch)
            segment = _inputs_at(times, table, time + 0.5 * step, segment, inputs)
            if segment != fresh or not constant:
                scene = scene_of(pump, circuit, inputs)
                _clearances(inputs, n, clearances)
                fresh = segment
                constant = _is_constant(table, segment)
            ok = advance(pump, circuit, scene, y, step, T_start, extrapolate, ws)
            counts[TAKEN] += 1
            time = time + step
            pieces_left -= 1
            if pieces_left <= 0:
                pieces_left = 0
                j += 1
            if not ok:
                revolution[STOPPED_AT] = time
                return DIVERGED
            if mapped:
                mapped_slippers.gather(y, step, gathered)
                if gathered[mapped_slippers.TURNED] >= whole / n:
                    mapped_slippers.ask(pump, gaps, inputs, clearances[:, OF_SLIPPER], y[OMEGA], gathered, time, added)
            if min(y[P_D], y[P_C], y[P_I]) < P_FLOOR - _CAVITY:
                revolution[STOPPED_AT] = time
                return CAVITATED
            for k in range(N_FLOWS):
                through[k] += step / interval * flows[k]
            average(y, time, step, flows, account)
            if y[THETA] >= whole - ROUNDING:
                y[THETA] -= whole
        time = start + (i + 1) * interval
        samples[i, :N_SHARED] = y[:N_SHARED]
        samples[i, N_SHARED:] = through
        if keep.shape[0] > i:
            keep[i, :] = y
    return RUNNING


@compiled
def _clearances(inputs: Vector, n: int, clearances: Matrix) -> None:
    for k in range(n):
        clearances[k, OF_PISTON] = inputs[N_SCENE + k]
        clearances[k, OF_SLIPPER] = inputs[N_SCENE + n + k]
