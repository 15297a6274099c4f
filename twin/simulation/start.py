"""Where a run starts: the state at the operating point of its first instant."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin import columns as at
from twin.condition import INPUTS, OUTPUTS
from twin.laws.fluid import P_ATMOSPHERE
from twin.operating_point.equations import N_UNKNOWNS, U_SPOOL, U_TILT
from twin.operating_point.points import evenly_worn, slipper_model
from twin.operating_point.solver import WORK_ROWS, solve_cold
from twin.parameters import Circuit, Pump
from twin.simulation.layout import (
    ALPHA,
    N_SHARED,
    OMEGA,
    P_C,
    P_CTRL,
    P_D,
    P_I,
    X_RATE,
    X_STROKE,
    X,
    n_states,
)
from twin.simulation.scene import LOAD_OPENING, N_SCENE
from twin.units import PA_PER_BAR, RAD_PER_S_PER_RPM

Vector = NDArray[np.float64]


def load_coefficient(conductance: float) -> float:
    """k_d of equation 3-2 [Pa/(m3/s)^2] of an opening in L/min/sqrt(bar); 0 where it is shut."""
    return PA_PER_BAR / (conductance / 60.0e3) ** 2 if conductance > 0.0 else 0.0


class SteadyInputs(NamedTuple):
    """What the operating point is asked in place of one row of a scenario.

    Attributes
    ----------
    pump
        With equal pistons of the mean clearance.
    row
        Conditions and health, shape (len(INPUTS),): uneven gaps enter by their mean leakage.
    k_d
        Of equation 3-2 [Pa/(m3/s)^2].
    """

    pump: Pump
    row: Vector
    k_d: float


def steady_inputs(pump: Pump, inputs: Vector) -> SteadyInputs:
    """What the operating point is asked in place of one row of a scenario's table, shape (N_SCENE + 2 n,)."""
    n = int(pump.piston.n)
    row = inputs[: len(INPUTS)].copy()
    even, piston_scale = evenly_worn(pump, inputs[N_SCENE : N_SCENE + n])
    row[at.PISTON_SCALE] *= piston_scale
    row[at.SLIPPER_SCALE] *= np.mean(inputs[N_SCENE + n :] ** 3)
    return SteadyInputs(even, row, load_coefficient(float(inputs[LOAD_OPENING])))


def starting_state(pump: Pump, circuit: Circuit, inputs: Vector) -> tuple[Vector, float]:
    """State at the operating point of one row of inputs, and the shaft torque there [N m].

    Parameters
    ----------
    inputs
        One row of a scenario's table, shape (N_SCENE + 2 n,).

    Raises
    ------
    ValueError
        when there is no operating point to start from.
    """
    n = int(pump.piston.n)
    even, row, k_d = steady_inputs(pump, inputs)
    u, Y, work = np.empty(N_UNKNOWNS), np.empty(len(OUTPUTS)), np.empty((WORK_ROWS, N_UNKNOWNS))
    if not solve_cold(even, slipper_model(pump), circuit, row, k_d, u, Y, work):
        raise ValueError("no operating point to start from: ask for less flow or a healthier pump")
    ambient = row[at.AMBIENT] * PA_PER_BAR
    pressures = [at.DISCHARGE_PRESSURE, at.CASE_PRESSURE, at.RETURN_PRESSURE, at.CONTROL_PRESSURE]
    if min(Y[pressures]) < -row[at.AMBIENT]:
        raise ValueError("no operating point to start from: an absolute pressure would lie below zero")
    P_s = row[at.RESERVOIR] * PA_PER_BAR + ambient
    alpha = min(float(u[U_TILT]), pump.swashplate.alpha_max)
    t, omega = np.tan(alpha), row[at.SPEED] * RAD_PER_S_PER_RPM
    variable = pump.slipper.variable > 0.5
    y = np.zeros(n_states(n, variable))
    y[[P_D, P_C, P_I, P_CTRL]] = Y[pressures] * PA_PER_BAR + ambient
    y[X], y[ALPHA], y[OMEGA] = u[U_SPOOL], alpha, omega
    # pressed against the plate: as deep in contact as each one's force asks
    force_stroke = (y[P_CTRL] - y[P_C]) * pump.servo.A_stroke
    force_rate = pump.servo.F_rate + pump.servo.k_rate * pump.servo.L_rate * (np.tan(pump.swashplate.alpha_max) - t)
    force_rate += pump.servo.rate_fed * pump.servo.A_rate * (y[P_D] - y[P_C])
    y[X_STROKE] = -pump.servo.L_stroke * t + max(force_stroke, 0.0) / pump.servo.k_contact
    y[X_RATE] = pump.servo.L_rate * t + force_rate / pump.servo.k_contact
    angles = 2.0 * np.pi * np.arange(n) / n
    high = (angles > pump.port_plate.phi_commutation) & (angles < np.pi)
    y[N_SHARED : N_SHARED + n] = np.where(high, y[P_D], P_s)
    if variable:
        slipper = pump.slipper
        # pockets near balance on the plate; the first revolutions set the rest
        pocket = y[P_C] + np.where(high, (y[P_D] - y[P_C]) / slipper.balance, max(P_s - y[P_C], 0.0))
        y[N_SHARED + n : N_SHARED + 2 * n] = np.maximum(pocket, 0.5 * P_ATMOSPHERE)
        y[N_SHARED + 2 * n : N_SHARED + 3 * n] = slipper.h
        y[N_SHARED + 3 * n :] = pump.piston.R * t * np.sin(angles) * omega
    return y, float(Y[at.SHAFT_TORQUE])
