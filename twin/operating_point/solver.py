"""Damped Newton for the steady state, one row after the other."""

import math

import numpy as np
from numpy.typing import NDArray

from twin import columns as at
from twin.compiled import compiled, lent
from twin.condition import INPUTS, RANGES, RESERVOIR_RANGE_BAR
from twin.operating_point.derivatives import N_COMMUTING, SCALES, differentiate
from twin.operating_point.elimination import solve_in_place
from twin.operating_point.equations import (
    BALANCE,
    CONTROL,
    DELIVERY,
    DEMAND,
    DRAIN,
    N_UNKNOWNS,
    U_LOAD,
    U_P_C,
    U_P_D,
    U_SPOOL,
    U_TILT,
    Passing,
    Warmth,
    commute,
    evaluate,
    warmth_of,
)
from twin.parameters import Circuit, Pump
from twin.parts.slipper_map import SlipperMap
from twin.units import M3_PER_S_PER_LPM, PA_PER_BAR, RAD_PER_S_PER_RPM

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

SOLVED = 0
NOT_FINITE = 1
OUT_OF_RANGE = 2
DEMAND_TOO_HIGH = 3
NOT_CONVERGED = 4

_ANY = (-math.inf, math.inf)
_LOW = tuple(RANGES.get(name, _ANY)[0] for name in INPUTS)
_HIGH = tuple(RANGES.get(name, _ANY)[1] for name in INPUTS)

WORK_ROWS = 15
"""Rows of scratch that ``solve`` asks for, N_UNKNOWNS long."""
_RESIDUALS, _NEARBY, _KEPT, _JACOBIAN, _SPENT, _MOVE, _BEFORE = 0, 1, 2, 3, 8, 13, 14
"""Where they hold residuals, residuals nearby, the unknowns before a step, the Jacobian, what elimination spends of it,
the step, the residuals before it."""

_MAX_ITERATIONS = 60
_MAX_HALVINGS = 12
_WINS = 0.1
"""Share of the residual that a step may leave for its Jacobian, with what the step has taught, to serve the next one."""
_TOLERANCE = 1.0e-13
"""Largest scaled residual; flows are scaled by 1e-4 m3/s, so 1e-13 is far below 1e-9 of any throughput."""

_STEP = 1.0e-6
"""Of the Jacobian's differences, in scaled unknowns."""
_MAX_STEPS = (0.5e7, 1.0e9, 0.1, 1.0e-3, 1.0e9)
"""Longest Newton steps of P_d [Pa], tilt coordinate s [rad] and spool x [m]; the others are as good as free."""
_TILT_LOW = -0.1
"""Lowest tilt coordinate of a true solution [rad]: tan(alpha) repeats, and half a turn on lies a false one."""


@compiled
def _norm(F: Vector, k_d: float) -> float:
    last = F[DEMAND] / (1.0e7 if k_d > 0.0 else 1.0e-4)
    return float(
        max(
            abs(F[DELIVERY]) / 1.0e-4,
            abs(F[DRAIN]) / 1.0e5,
            abs(F[BALANCE]) / 100.0,
            abs(F[CONTROL]) / 1.0e-5,
            abs(last),
        )
    )


@compiled
def start(pump: Pump, row: Vector, k_d: float, at_stop: bool, u: Vector) -> None:
    """First guess of the unknowns: the regulated pump at its setting, or the pump at its tilt stop."""
    comp = pump.compensator
    alpha_max = pump.swashplate.alpha_max
    P_r = (row[at.RESERVOIR] + row[at.AMBIENT]) * PA_PER_BAR
    setting = (comp.F_preload + comp.k_spool * comp.x_zero) / comp.A_spool + row[at.SETTING_CHANGE] * PA_PER_BAR
    A_p = 0.25 * math.pi * pump.piston.d_p**2
    per_tangent = pump.piston.n * A_p * pump.piston.R * row[at.SPEED] * RAD_PER_S_PER_RPM / math.pi
    Q_max = 0.97 * per_tangent * math.tan(alpha_max)
    Q = min(math.sqrt(setting / k_d), Q_max) if k_d > 0.0 else row[at.ASKED_FLOW] * M3_PER_S_PER_LPM
    u[U_P_C] = P_r + 0.5e5
    u[U_LOAD] = Q
    if at_stop:
        u[U_P_D] = P_r + min(k_d * Q * Q, 0.98 * setting) if k_d > 0.0 else P_r + 0.9 * setting
        u[U_TILT] = alpha_max + 0.05
        # the spring balance says how far the missing pressure lets a soft spring push the spool
        lacking = (setting - (u[U_P_D] - u[U_P_C])) * comp.A_spool
        u[U_SPOOL] = min(comp.x_zero - lacking / (comp.k_spool * max(row[at.DROOP_SCALE], 0.01)), -0.2e-3)
    else:
        u[U_P_D] = u[U_P_C] + setting
        u[U_TILT] = min(math.atan((Q + 2.0e-5) / per_tangent), alpha_max)
        u[U_SPOOL] = comp.x_zero


@compiled
def _jacobian(
    pump: Pump,
    model: SlipperMap,
    circuit: Circuit,
    warmth: Warmth,
    passing: Passing,
    row: Vector,
    k_d: float,
    u: Vector,
    Y: Vector,
    work: Matrix,
) -> None:
    """Forward-difference Jacobian of the residuals in scaled unknowns, into ``work``, which holds the residuals."""
    F, F_2, J = work[_RESIDUALS], work[_NEARBY], work[_JACOBIAN:_SPENT]
    for j in range(N_UNKNOWNS):
        kept = u[j]
        u[j] = kept + _STEP * SCALES[j]
        there = commute(pump, model, warmth, row, u) if j < N_COMMUTING else passing
        evaluate(pump, circuit, warmth, there, row, k_d, u, F_2, Y)
        u[j] = kept
        for i in range(N_UNKNOWNS):
            J[i, j] = (F_2[i] - F[i]) / _STEP


@compiled
def _learn(J: Matrix, b: Matrix, damping: float, F: Vector, F_before: Vector) -> None:
    """Change the Jacobian so that it explains the step ``damping b``, (5, 1) scaled, which J had led to: Broyden's method."""
    square = 0.0
    for j in range(N_UNKNOWNS):
        square += b[j, 0] * b[j, 0]
    per = 1.0 / (damping * max(square, 1.0e-300))
    for i in range(N_UNKNOWNS):
        missed = (F[i] - (1.0 - damping) * F_before[i]) * per
        for j in range(N_UNKNOWNS):
            J[i, j] += missed * b[j, 0]


@compiled
def solve(
    pump: Pump,
    model: SlipperMap,
    circuit: Circuit,
    row: Vector,
    k_d: float,
    u: Vector,
    Y: Vector,
    work: Matrix,
    near: bool,
) -> bool:
    """Drive the residuals to zero from the guess in ``u``; True when solved. ``work`` is (WORK_ROWS, 5) of scratch.

    While a step wins a digit its Jacobian serves the next one too, changed so that it explains the step (Broyden's method).
    ``near`` says that ``work`` holds the Jacobian of a neighbour: it is tried first.
    """
    F, kept, J, spent = work[_RESIDUALS], work[_KEPT], work[_JACOBIAN:_SPENT], work[_SPENT:_MOVE]
    b = work[_MOVE].reshape((N_UNKNOWNS, 1))
    before_F = work[_BEFORE]
    warmth = warmth_of(pump, row)
    passing = commute(pump, model, warmth, row, u)
    evaluate(pump, circuit, warmth, passing, row, k_d, u, F, Y)
    norm = _norm(F, k_d)
    reused = near
    for _ in range(_MAX_ITERATIONS):
        if norm < _TOLERANCE:
            return True
        if not reused:
            _jacobian(pump, model, circuit, warmth, passing, row, k_d, u, Y, work)
        for i in range(N_UNKNOWNS):
            for j in range(N_UNKNOWNS):
                spent[i, j] = J[i, j]
            b[i, 0] = -F[i]
            before_F[i] = F[i]
            kept[i] = u[i]
        if not solve_in_place(spent, b):
            return False
        damping = 1.0
        for i in range(N_UNKNOWNS):
            if abs(b[i, 0]) * SCALES[i] * damping > _MAX_STEPS[i]:
                damping = _MAX_STEPS[i] / (abs(b[i, 0]) * SCALES[i])
        before, improved = norm, False
        for _halving in range(1 if reused else _MAX_HALVINGS):
            for i in range(N_UNKNOWNS):
                u[i] = kept[i] + damping * b[i, 0] * SCALES[i]
            passing = commute(pump, model, warmth, row, u)
            evaluate(pump, circuit, warmth, passing, row, k_d, u, F, Y)
            trial = _norm(F, k_d)
            if u[U_TILT] > _TILT_LOW and (trial < norm or trial < _TOLERANCE):
                improved = True
                norm = trial
                break
            damping *= 0.5
        if not improved:
            for i in range(N_UNKNOWNS):
                u[i] = kept[i]
            passing = commute(pump, model, warmth, row, u)
            evaluate(pump, circuit, warmth, passing, row, k_d, u, F, Y)
            # at the floor of rounding no step improves: accept what is solved for every purpose
            if not reused:
                return _norm(F, k_d) < 1.0e4 * _TOLERANCE
        reused = improved and norm < _WINS * before
        if reused:
            _learn(J, b, damping, F, before_F)
    return norm < 1.0e4 * _TOLERANCE


@compiled
def solve_cold(
    pump: Pump, model: SlipperMap, circuit: Circuit, row: Vector, k_d: float, u: Vector, Y: Vector, work: Matrix
) -> bool:
    """Solve without a neighbour to start from; a stiff valve is reached from softer ones where it has to be."""
    asked = row[at.DROOP_SCALE]
    solved = False
    for droop in (asked, max(asked, 1.0), max(asked, 3.0)):
        for at_stop in (False, True):
            if not solved:
                row[at.DROOP_SCALE] = droop
                start(pump, row, k_d, at_stop, u)
                solved = solve(pump, model, circuit, row, k_d, u, Y, work, False)
        while solved and row[at.DROOP_SCALE] > asked:
            row[at.DROOP_SCALE] = max(asked, 0.5 * row[at.DROOP_SCALE] - 0.01)
            solved = solve(pump, model, circuit, row, k_d, u, Y, work, False)
        if solved:
            break
    row[at.DROOP_SCALE] = asked
    return solved


@compiled
def is_finite(row: Vector) -> bool:
    """True when every input is a number."""
    return bool(np.all(np.isfinite(row)))


@compiled
def is_in_range(row: Vector) -> bool:
    """True within the range in which the model's laws are meant: ``twin.condition.RANGES``."""
    absolute = row[at.RESERVOIR] + row[at.AMBIENT]
    ok = RESERVOIR_RANGE_BAR[0] <= absolute <= RESERVOIR_RANGE_BAR[1]
    for j in range(len(_LOW)):
        ok = ok and _LOW[j] <= row[j] <= _HIGH[j]
    return bool(ok)


@compiled
def solve_batch(
    pump: Pump,
    model: SlipperMap,
    circuit: Circuit,
    rows: Matrix,
    k_d: Vector,
    Y: Matrix,
    by: NDArray[np.int64],
    D: NDArray[np.float64],
    status: NDArray[np.int64],
) -> None:
    """Solve every row; a neighbour's failure costs nothing.

    ``model`` is the metamodel of a variable slipper gap, or ``NO_MAP``: then the gap is ``slipper.h``.
    ``D`` of shape (0, 0, 0) asks for no derivatives; else those by the inputs ``by`` are written, the rest is left.
    """
    n_out = Y.shape[1]
    held_u, held_work = np.empty(N_UNKNOWNS), np.empty((WORK_ROWS, N_UNKNOWNS))
    u, work, rows, k_d, Y, D = lent(held_u), lent(held_work), lent(rows), lent(k_d), lent(Y), lent(D)
    model = SlipperMap(
        lent(model.nodes),
        lent(model.weights),
        lent(model.centre),
        lent(model.per_length),
        lent(model.mean),
        lent(model.low),
        lent(model.high),
    )
    by, status = lent(by), lent(status)
    warm = False
    for i in range(rows.shape[0]):
        row = rows[i]
        if not (is_finite(row) and math.isfinite(k_d[i])):
            status[i] = NOT_FINITE
        elif not is_in_range(row):
            status[i] = OUT_OF_RANGE
        else:
            solved = warm and solve(pump, model, circuit, row, k_d[i], u, Y[i], work, True)
            solved = solved or solve_cold(pump, model, circuit, row, k_d[i], u, Y[i], work)
            # an imposed flow beyond the delivery pulls the fully tilted pump down to the return line or lower
            starved = not Y[i, at.DISCHARGE_PRESSURE] > Y[i, at.RETURN_PRESSURE] or (
                not solved and u[U_TILT] > pump.swashplate.alpha_max
            )
            if solved and not starved:
                status[i] = SOLVED
            else:
                status[i] = DEMAND_TOO_HIGH if starved and not k_d[i] > 0.0 else NOT_CONVERGED
        warm = status[i] == SOLVED
        if warm and D.shape[0] > 0 and not differentiate(pump, model, circuit, row, k_d[i], u, n_out, by, D[i]):
            status[i] = NOT_CONVERGED
        if status[i] != SOLVED:
            Y[i, :] = np.nan
            if D.shape[0] > 0:
                D[i, :, :] = np.nan
    # what was lent lives as long as its owner is in use
    held_u[0] = held_work[0, 0] = 0.0
