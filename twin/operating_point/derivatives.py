"""Derivatives of the steady state by its inputs: the implicit function theorem on differences of its equations."""

import numpy as np
from numpy.typing import NDArray

from twin import columns as at
from twin.compiled import compiled, lent
from twin.condition import INPUTS
from twin.operating_point.elimination import solve_in_place
from twin.operating_point.equations import N_UNKNOWNS, commute, evaluate, warmth_of
from twin.parameters import Circuit, Pump
from twin.parts.slipper_map import SlipperMap

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

N_COMMUTING = 3
"""The first unknowns, P_d, P_c and s, are those that the commutations depend on."""
_COMMUTES = tuple(
    name
    in (
        "speed_rpm",
        "fluid_temperature_degc",
        "reservoir_pressure_bar",
        "ambient_pressure_bar",
        "pump_leakage_scale",
        "slipper_leakage_scale",
        "piston_leakage_scale",
        "control_bleed_lpm",
    )
    for name in INPUTS
)
"""Inputs that the commutations depend on."""

N_GAUGE = 4
"""The first outputs are gauge pressures, counted from ambient: discharge, case, return, control."""
SCALES = (1.0e7, 1.0e5, 0.1, 1.0e-3, 1.0e-4)
"""Scales of the unknowns P_d, P_c, s, x, Q_L."""
_SLOPE_STEP = 1.0e-6
"""Relative step of the derivatives: truncation and rounding both stay below 1e-5 of a slope."""


@compiled
def _place_of(by: NDArray[np.int64], column: int) -> int:
    """Where an input stands among those that are differentiated by; -1 where it does not."""
    for place in range(len(by)):
        if by[place] == column:
            return place
    return -1


@compiled
def _write_slope(there: Vector, here: Vector, per_step: float, out: Matrix, column: int) -> None:
    """Difference quotient of one row of values into a column; without an array between."""
    for i in range(len(here)):
        out[i, column] = (there[i] - here[i]) * per_step


@compiled
def differentiate(
    pump: Pump,
    model: SlipperMap,
    circuit: Circuit,
    row: Vector,
    k_d: float,
    u: Vector,
    n_out: int,
    by: NDArray[np.int64],
    D: Matrix,
) -> bool:
    """Derivatives of the outputs by the inputs ``by``, D of shape (n_out, len(row)), at a solution ``u``.

    With F(u, p) = 0: du/dp = -F_u^-1 F_p and dY/dp = Y_u du/dp + Y_p, the partials by forward differences: half the
    price of central ones, and a health input is never taken below the zero that it starts from. Two columns follow from
    others: the pump's leakage scale is a factor on three scales, and ambient pressure carries the reservoir's.
    """
    n_in = len(by)
    n = N_UNKNOWNS
    held = np.empty((2, n)), np.empty((2, n_out)), np.empty((n, n)), np.empty((n_out, n)), np.empty((n + n_out, n_in))
    F_0, F_a, Y_0, Y_a = lent(held[0])[0], lent(held[0])[1], lent(held[1])[0], lent(held[1])[1]
    F_u, Y_u = lent(held[2]), lent(held[3])
    F_p, Y_p = lent(held[4])[:n], lent(held[4])[n:]
    warmth = warmth_of(pump, row)
    passing = commute(pump, model, warmth, row, u)
    evaluate(pump, circuit, warmth, passing, row, k_d, u, F_0, Y_0)
    for j in range(n):
        kept = u[j]
        u[j] = kept + _SLOPE_STEP * SCALES[j]
        there = commute(pump, model, warmth, row, u) if j < N_COMMUTING else passing
        evaluate(pump, circuit, warmth, there, row, k_d, u, F_a, Y_a)
        u[j] = kept
        _write_slope(F_a, F_0, 1.0 / _SLOPE_STEP, F_u, j)
        _write_slope(Y_a, Y_0, 1.0 / _SLOPE_STEP, Y_u, j)
    of_reservoir = _place_of(by, at.RESERVOIR) if model.nodes.shape[0] == 0 else -1
    of_slippers, of_pistons = _place_of(by, at.SLIPPER_SCALE), _place_of(by, at.PISTON_SCALE)
    of_plate = _place_of(by, at.PORT_PLATE_SCALE)
    follows = min(of_slippers, of_pistons, of_plate) >= 0
    for place in range(n_in):
        j = by[place]
        if (j == at.PUMP_SCALE and follows) or (j == at.AMBIENT and of_reservoir >= 0):
            continue
        kept = row[j]
        h = _SLOPE_STEP * max(1.0, abs(kept))
        row[j] = kept + h
        warmer = warmth_of(pump, row) if j in (at.TEMPERATURE, at.SPEED) else warmth
        there = commute(pump, model, warmer, row, u) if _COMMUTES[j] else passing
        evaluate(pump, circuit, warmer, there, row, k_d, u, F_a, Y_a)
        row[j] = kept
        _write_slope(F_a, F_0, -1.0 / h, F_p, place)
        _write_slope(Y_a, Y_0, 1.0 / h, Y_p, place)
    pumps, ambient = _place_of(by, at.PUMP_SCALE), _place_of(by, at.AMBIENT)
    if pumps >= 0 and follows:
        per = 1.0 / row[at.PUMP_SCALE]
        s, p, q = row[at.SLIPPER_SCALE] * per, row[at.PISTON_SCALE] * per, row[at.PORT_PLATE_SCALE] * per
        for i in range(n):
            F_p[i, pumps] = s * F_p[i, of_slippers] + p * F_p[i, of_pistons] + q * F_p[i, of_plate]
        for i in range(n_out):
            Y_p[i, pumps] = s * Y_p[i, of_slippers] + p * Y_p[i, of_pistons] + q * Y_p[i, of_plate]
    if ambient >= 0 and of_reservoir >= 0:
        for i in range(n):
            F_p[i, ambient] = F_p[i, of_reservoir]
        for i in range(n_out):
            Y_p[i, ambient] = Y_p[i, of_reservoir] - (1.0 if i < N_GAUGE else 0.0)
    solved = solve_in_place(F_u, F_p)
    for i in range(n_out):
        for j in range(n_in):
            total = Y_p[i, j]
            for k in range(n):
                total += Y_u[i, k] * F_p[k, j]
            D[i, by[j]] = total
    # what was lent lives as long as its owner is in use
    held[0][0, 0] = 0.0
    return solved
