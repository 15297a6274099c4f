"""Many steps: extrapolation, schedules, step control, averages and samples. Nothing is allocated inside."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled, inlined, lent
from twin.laws.compressibility import P_FLOOR
from twin.parameters import Circuit, Pump
from twin.simulation import chambers, mapped_slippers, slippers
from twin.simulation.averages import ROUNDING, STOPPED_AT, TAKEN, Account, average
from twin.simulation.chambers import Step
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
    P_D,
    P_I,
    THETA,
)
from twin.simulation.mapped_slippers import Gaps
from twin.simulation.scene import N_SCENE, Scene, scene_of
from twin.simulation.step import Scratch, passages, pose_of, solve_step
from twin.simulation.turning import Pose, small_turn, tangent_after
from twin.simulation.volumes import set_pressures

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

    Scratch of a step; states before it and after the full step, masses of the last half step and of the full one, shape
    (4, m); flows of a step, of the full one and of its first half, shape (3, N_FLOWS); means for the metamodel of the
    slippers (``mapped_slippers``).
    """

    scratch: Scratch
    states: Matrix
    flows: Matrix
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
    return Workspace(scratch, np.empty((4, max(m, N_VOLUMES + 2 * n))), np.empty((3, N_FLOWS)), gathered)


@inlined
def advance(
    pump: Pump,
    circuit: Circuit,
    scene: Scene,
    y: Vector,
    dt: float,
    T_start: float,
    extrapolate: bool,
    scratch: Scratch,
    states: Matrix,
    flows: Matrix,
) -> bool:
    """One step of ``dt``; extrapolated from one full and two half steps: second order, the bias taken out.

    ``states``, shape (4, m or more), keeps what extrapolation compares, ``flows``, shape (3, N_FLOWS), the flows of
    the step and of its parts. Masses are extrapolated, not pressures, so that the extrapolated state conserves mass as the
    steps do: only the first half step's pressures are asked for. With variable gaps the chambers' table holds the
    slippers' substeps for this step (``slippers.choose_substeps``).
    """
    clearances, ch = scratch.clearances, scratch.ch
    n, m = ch.shape[0], y.shape[0]
    before, coarse, masses, masses_coarse = states[0], states[1], states[2], states[3]
    through, through_coarse, through_half = flows[0], flows[1], flows[2]
    n_sub = max(1, math.ceil(y[OMEGA] * dt / _FINE_ANGLE))
    for j in range(m):
        before[j] = y[j]
    first = pose_of(y)
    pose, ok, length = first, True, dt
    # one copy of the step serves all three: compiled once, and short enough for the processor's first cache
    for part in range(3 if extrapolate else 1):
        if part != 1:
            s = passages(pump, circuit, scene, y, pose, n, clearances, ch)
        step = Step(n, length, n_sub, T_start, pose.t, part == 1 or not extrapolate)
        ok, t = solve_step(pump, circuit, scene, s, y, step, scratch, masses, through)
        if not ok or not extrapolate:
            break
        if part == 0:
            for j in range(m):
                coarse[j], y[j] = y[j], before[j]
            for j in range(N_VOLUMES + 2 * n):
                masses_coarse[j] = masses[j]
            for j in range(N_FLOWS):
                through_coarse[j] = through[j]
            length = 0.5 * dt
        elif part == 1:
            for j in range(N_FLOWS):
                through_half[j] = through[j]
            pose = _moved(first, t, y[THETA] - before[THETA])
    if not ok or not extrapolate:
        return ok
    for j in range(N_FLOWS):
        through[j] += through_half[j] - through_coarse[j]
    for j in range(N_VOLUMES, N_SHARED):
        y[j] = 2.0 * y[j] - coarse[j]
    for j in range(N_VOLUMES + 2 * n):
        masses[j] = 2.0 * masses[j] - masses_coarse[j]
    set_pressures(pump, scene, masses, y)
    pose = _moved(first, tangent_after(first.t, y[ALPHA] - before[ALPHA]), y[THETA] - before[THETA])
    if pump.slipper.variable > 0.5:
        for j in range(N_SHARED + 2 * n, m):
            y[j] = 2.0 * y[j] - coarse[j]
        slippers.set_pressures(pump, scene, pose, masses, y, n)
    else:
        chambers.set_pressures(pump, scene, pose, masses, y, n)
    return math.isfinite(y[P_D] + y[ALPHA])


@inlined
def _moved(pose: Pose, t: float, turn: float) -> Pose:
    """Pose with the tilt's tangent ``t``, the shaft having turned by ``turn`` [rad]."""
    turn_c, turn_s = small_turn(turn)
    return Pose(t, pose.c * turn_c - pose.s * turn_s, pose.s * turn_c + pose.c * turn_s)


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
    # lent: taking a counted array out of a tuple, or a row out of it, costs more than a chamber
    y, times, table = lent(y), lent(inputs_of.times), lent(inputs_of.table)
    start, dt, n_steps, substeps, extrapolate, T_start = pace
    keep, samples, revolution = lent(account.keep), lent(account.samples), lent(account.revolution)
    means, counts = lent(account.means), lent(account.counts)
    states, all_flows, gathered = lent(ws.states), lent(ws.flows), lent(ws.gathered)
    clearances, ch, added = lent(ws.scratch.clearances), lent(ws.scratch.ch), lent(ws.scratch.added)
    scratch = Scratch(clearances, ch, lent(ws.scratch.A), lent(ws.scratch.b), added)
    flows = all_flows[0]
    mapped = added.shape[0] > 0
    n = ch.shape[0]
    inputs, through = np.empty(table.shape[1]), np.empty(N_FLOWS)
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
            ok = advance(pump, circuit, scene, y, step, T_start, extrapolate, scratch, states, all_flows)
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
            share = step / interval
            for k in range(N_FLOWS):
                through[k] += share * flows[k]
            average(y, time, step, flows, revolution, means, counts)
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
