"""One run of the transient pump with everything but its chambers and slippers held: what the slippers add there.

Volumes of 100 m3, a plate of 10 t m2 and a spool of 1e6 t keep pressures, tilt and valve where they are put; chambers,
pockets, gaps and pistons turn as in every other run. What the operating point without slippers says is taken off.
"""

import math

import numpy as np
from numpy.typing import NDArray

from twin import columns as at
from twin.condition import OUTPUTS, Condition, Health, input_rows
from twin.operating_point.equations import N_UNKNOWNS, commute, evaluate, warmth_of
from twin.parameters import Circuit, Pump
from twin.parts.servo import stroking_arm
from twin.parts.slipper_map import (
    ANSWERS,
    FROM_DISCHARGE,
    FROM_SUCTION,
    MEAN_GAP,
    NO_MAP,
    OVER_CASE,
    OVER_SUCTION,
    PLATE_TORQUE,
    SHAFT_TORQUE,
    SPEED,
    SUCTION,
    TEMPERATURE,
    TILT,
    WEAR,
)
from twin.simulation.layout import (
    ALPHA,
    ALPHA_DOT,
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
from twin.simulation.run import simulate
from twin.simulation.scenario import Scenario
from twin.units import PA_PER_BAR, RAD_PER_DEG, RAD_PER_S_PER_RPM, STANDARD_ATMOSPHERE_BAR

Vector = NDArray[np.float64]

_VOLUME, _INERTIA, _MASS = 100.0, 1.0e4, 1.0e9
_SETTLING, _KEPT = 2, 1
"""Revolutions that a slipper is given, and those that are averaged: it meets plate or retainer in every one of them."""
_CONTROL_SHARE = 0.3
"""Control over discharge pressure, counted from the case: it is held, and its torque taken off."""


def held_pump(pump: Pump) -> Pump:
    """The same pump with volumes, plate and spool that do not move within some revolutions."""
    volumes = pump.volumes._replace(discharge=_VOLUME, case=_VOLUME, return_line=_VOLUME, control=_VOLUME)
    return pump._replace(
        volumes=volumes,
        swashplate=pump.swashplate._replace(J=_INERTIA),
        compensator=pump.compensator._replace(m_spool=_MASS),
    )


def held_run(pump: Pump, circuit: Circuit, axes: Vector) -> Vector:
    """What the slippers of a pump with variable gaps add at a point of ``AXES``, shape (len(ANSWERS),).

    Parameters
    ----------
    pump
        A set with ``slipper.variable`` 1.
    circuit
        Any: its flows are taken off.
    axes
        Shape (len(AXES),), in the units of their names.

    Returns
    -------
    ndarray
        Answers in the units of their names; NaN where the run did not go through.
    """
    held, n = held_pump(pump), int(pump.piston.n)
    health = Health(slipper_leakage_scale=math.exp(axes[WEAR]))
    condition = Condition(float(axes[SPEED]), float(axes[TEMPERATURE]), float(axes[SUCTION]))
    y = _state(pump, axes)
    P_c, P_x, omega = y[P_C], y[P_CTRL], y[OMEGA]
    period = 2.0 * math.pi / omega
    scenario = Scenario(period * (_SETTLING + _KEPT), condition, health)
    run = simulate(held, circuit, scenario, keep_states=True, initial_state=y)
    found = np.full(len(ANSWERS), np.nan)
    if not run.status.ok:
        return found
    states = run.states[-1 - len(run.states) // (_SETTLING + _KEPT) * _KEPT :]
    # an operating point at the same place: whatever is not the slippers'
    bare = held._replace(slipper=held.slipper._replace(variable=0.0, h=1.0e-12))
    row = input_rows([condition], [health])[0]
    u = np.array([y[P_D], P_c, y[ALPHA], y[X], 0.0])
    warmth = warmth_of(bare, row)
    F, Y = np.empty(N_UNKNOWNS), np.empty(len(OUTPUTS))
    passing = commute(bare, NO_MAP, warmth, row, u)
    evaluate(bare, circuit, warmth, passing, row, 0.0, u, F, Y)
    rate = (states[-1, ALPHA_DOT] - states[0, ALPHA_DOT]) / (period * _KEPT)
    missing = (P_x - P_c) - ((Y[at.CONTROL_PRESSURE] + condition.ambient_pressure_bar) * PA_PER_BAR - P_c)
    leakage = run.mean("slipper_leakage_lpm", _KEPT)
    found[FROM_SUCTION] = run.mean("suction_flow_lpm", _KEPT) - Y[at.SUCTION_FLOW]
    found[FROM_DISCHARGE] = leakage - found[FROM_SUCTION]
    found[PLATE_TORQUE] = _INERTIA * rate + stroking_arm(pump.servo, math.tan(y[ALPHA])) * missing
    found[SHAFT_TORQUE] = run.mean("shaft_torque_nm", _KEPT) - Y[at.SHAFT_TORQUE]
    found[MEAN_GAP] = states[1:, N_SHARED + 2 * n : N_SHARED + 3 * n].mean() * 1.0e6
    return found


def _state(pump: Pump, axes: Vector) -> Vector:
    """State of the held pump: chambers as their kidneys, slippers a little off the plate."""
    n, servo = int(pump.piston.n), pump.servo
    P_s = (axes[SUCTION] + STANDARD_ATMOSPHERE_BAR) * PA_PER_BAR
    P_c = P_s + axes[OVER_SUCTION] * PA_PER_BAR
    P_d = P_c + axes[OVER_CASE] * PA_PER_BAR
    alpha, omega = axes[TILT] * RAD_PER_DEG, axes[SPEED] * RAD_PER_S_PER_RPM
    t = math.tan(alpha)
    y = np.zeros(n_states(n, True))
    y[P_D], y[P_C], y[P_I], y[P_CTRL] = P_d, P_c, P_s, P_c + _CONTROL_SHARE * (P_d - P_c)
    y[X], y[ALPHA], y[OMEGA] = pump.compensator.x_zero, alpha, omega
    y[X_STROKE], y[X_RATE] = -servo.L_stroke * t, servo.L_rate * t
    angles = 2.0 * np.pi * np.arange(n) / n
    high = (angles > pump.port_plate.phi_commutation) & (angles < np.pi)
    y[N_SHARED : N_SHARED + n] = np.where(high, P_d, P_s)
    y[N_SHARED + n : N_SHARED + 2 * n] = np.where(high, P_c + (P_d - P_c) / pump.slipper.balance, max(P_s, P_c))
    y[N_SHARED + 2 * n : N_SHARED + 3 * n] = 10.0 * pump.slipper.h_min
    y[N_SHARED + 3 * n :] = pump.piston.R * t * np.sin(angles) * omega
    return y


__all__ = ["held_pump", "held_run"]
