"""One linearly implicit step: chambers eliminated, shared states solved together, masses updated by the solved flows.

The Jacobian is an arrow: a chamber couples to P_d, P_c and the tilt rate only. Flows are linear in the new pressures
through secant conductances (a tangent on a square-root law overshoots). After the solve every volume's mass is updated
by exactly the flows that its neighbours saw, and the pressure follows from the mass: mass is conserved to rounding.
"""

import math

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled
from twin.laws.fluid import P_ATMOSPHERE, gauge_pressure, relative_compressibility, relative_density
from twin.linear import solve_in_place
from twin.parameters import Circuit, Pump
from twin.parts.piston import chamber_volume
from twin.simulation.network import (
    ALPHA,
    ALPHA_DOT,
    P_C,
    P_CTRL,
    P_D,
    P_I,
    V_SPOOL,
    Scene,
    X,
    chamber_network,
    shared_network,
)

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

N_SHARED = 8
N_SOLVED = 6
N_FLOWS = 5
"""Flows that a step reports: discharge (load and system), case drain, return line, suction, shaft torque [N m]."""
_V_ROW, _W_ROW = 4, 5
_FLOOR = 1.0e3
"""Lowest absolute pressure [Pa]: fluid does not bear tension; reaching it is cavitation and is counted."""


@compiled
def step(
    pump: Pump,
    circuit: Circuit,
    scene: Scene,
    y: Vector,
    n: int,
    theta: float,
    dt: float,
    scales: Matrix,
    chambers: Matrix,
    A: Matrix,
    b: Vector,
    flows: Vector,
) -> bool:
    """Advance ``y``, shape (n + 8,), by ``dt`` in place from shaft angle ``theta``; False when it failed.

    ``chambers`` (n, 12), ``A`` (6, 6) and ``b`` (6,) are scratch; ``flows`` (5,) receives the step's flows.
    """
    z = y[n:]
    chamber_network(pump, scene, y, n, theta, scales, chambers)
    s = shared_network(pump, circuit, scene, z)
    piston, volumes, comp = pump.piston, pump.volumes, pump.compensator
    B, gain = scene.B_0, scene.B_gain
    P_s = scene.P_s
    P_d, P_c, P_i, P_ctrl = z[P_D], z[P_C], z[P_I], z[P_CTRL]
    x, v, alpha, alpha_dot = z[X], z[V_SPOOL], z[ALPHA], z[ALPHA_DOT]
    t, t_max = math.tan(alpha), math.tan(pump.swashplate.alpha_max)
    shared = 1.0 if circuit.shared > 0.5 else 0.0
    A[:, :] = 0.0
    # unknowns: P_d, P_c, P_i, P_ctrl, v, alpha_dot, all at the end of the step
    for i, (P, volume) in enumerate(
        ((P_d, volumes.discharge), (P_c, volumes.case), (P_i, volumes.return_line), (P_ctrl, volumes.control))
    ):
        C = relative_compressibility(P - P_ATMOSPHERE, B, gain) * volume / dt
        A[i, i] = C
        b[i] = C * P
    A[_W_ROW, _W_ROW] = pump.swashplate.J / dt
    b[_W_ROW] = pump.swashplate.J / dt * alpha_dot

    turn_c, turn_s = math.cos(scene.omega * dt), math.sin(scene.omega * dt)
    # chambers: P' = a_0 + a_d P_d' + a_c P_c' + a_w alpha_dot'
    for k in range(n):
        G_d, G_s, G_l, drag, volume, _, tilt = chambers[k, :7]
        p = y[k] - P_ATMOSPHERE
        w = relative_density(p, B, gain)
        c_new = chambers[k, 7] * turn_c - chambers[k, 8] * turn_s
        chambers[k, 7] = c_new
        turned = chamber_volume(piston, t_max, t, c_new)
        C = relative_compressibility(p, B, gain) * volume / dt
        D = C + G_d + G_s + G_l
        a_0 = (C * y[k] + G_s * P_s - drag - w * (turned - volume) / dt) / D
        a_d, a_c, a_w = G_d / D, G_l / D, -w * tilt / D
        chambers[k, 8], chambers[k, 9], chambers[k, 10], chambers[k, 11] = a_0, a_d, a_c, a_w
        # into P_d: G_d (P' - P_d'); into P_c: G_l (P' - P_c') + drag; on the plate: tilt (P' - P_c')
        A[0, 0] += G_d * (1.0 - a_d)
        A[0, 1] -= G_d * a_c
        A[0, 5] -= G_d * a_w
        b[0] += G_d * a_0
        A[1, 1] += G_l * (1.0 - a_c)
        A[1, 0] -= G_l * a_d
        A[1, 5] -= G_l * a_w
        b[1] += G_l * a_0 + drag
        A[5, 0] -= tilt * a_d
        A[5, 1] += tilt * (1.0 - a_c)
        A[5, 5] -= tilt * a_w
        b[5] += tilt * a_0

    G_dc = s.plate_d + s.throttled
    # discharge
    A[0, 0] += s.load + s.e_in + G_dc
    A[0, 2] -= s.load
    A[0, 3] -= s.e_in
    A[0, 1] -= G_dc
    A[0, 4] += s.e_in_x * dt
    b[0] -= scene.Q_load + scene.Q_sys
    # case; a separate drain ends in the reservoir
    A[1, 0] -= G_dc
    A[1, 1] += G_dc + s.plate_s + s.e_out + s.drain
    A[1, 3] -= s.e_out
    A[1, 2] -= s.drain * shared
    A[1, 4] -= s.e_out_x * dt
    A[1, 5] += s.arm
    b[1] += s.plate_s * P_s + s.bleed + s.drain * (1.0 - shared) * P_s
    # return junction
    A[2, 0] -= s.load
    A[2, 2] += s.load + s.ret + s.drain * shared
    A[2, 1] -= s.drain * shared
    b[2] += scene.Q_load + scene.Q_sys + s.ret * P_s
    # control volume: it grows as the tilt falls
    A[3, 3] += s.e_in + s.e_out
    A[3, 0] -= s.e_in
    A[3, 1] -= s.e_out
    A[3, 4] -= (s.e_in_x - s.e_out_x) * dt
    A[3, 5] -= s.arm
    b[3] -= s.bleed
    # spool
    A[4, 4] = comp.m_spool / dt + s.F_spring_x * dt + comp.damping
    A[4, 0] -= comp.A_spool
    A[4, 1] += comp.A_spool
    b[4] = comp.m_spool / dt * v - (s.F_spring - comp.damping * v)
    # plate
    A[5, 5] -= s.torque_alpha_dot + s.torque_alpha * dt
    A[5, 3] += s.arm
    A[5, 1] -= s.arm
    b[5] += s.torque - s.torque_alpha_dot * alpha_dot
    if not solve_in_place(A, b.reshape((N_SOLVED, 1))):
        return False

    Pd, Pc, Pi, Pctrl, v_new, w_new = b[0], b[1], b[2], b[3], b[4], b[5]
    alpha_new = alpha + dt * w_new
    t_new = math.tan(alpha_new)
    to_discharge = leaked = torque = drawn = 0.0
    for k in range(n):
        G_d, G_s, G_l, drag, volume, rotation, _ = chambers[k, :7]
        P = chambers[k, 8] + chambers[k, 9] * Pd + chambers[k, 10] * Pc + chambers[k, 11] * w_new
        q_d, q_s, q_l = G_d * (P - Pd), G_s * (P_s - P), G_l * (P - Pc) + drag
        mass = relative_density(y[k] - P_ATMOSPHERE, B, gain) * volume + dt * (q_s - q_d - q_l)
        new_volume = chamber_volume(piston, t_max, t_new, chambers[k, 7])
        y[k] = max(P_ATMOSPHERE + gauge_pressure(mass / new_volume, B, gain), _FLOOR)
        to_discharge += q_d
        leaked += q_l
        drawn += q_s
        torque -= (P - Pc) * rotation / scene.omega
    q_load = s.load * (Pd - Pi) + scene.Q_load + scene.Q_sys
    q_in = s.e_in * (Pd - Pctrl) + s.e_in_x * dt * v_new
    q_out = s.e_out * (Pctrl - Pc) + s.e_out_x * dt * v_new + s.bleed
    q_dc = G_dc * (Pd - Pc)
    q_sc = s.plate_s * (P_s - Pc)
    q_drain = s.drain * (Pc - (Pi if shared > 0.5 else P_s))
    q_ret = s.ret * (Pi - P_s)
    z[P_D] = _filled(P_d, volumes.discharge, dt * (to_discharge - q_load - q_in - q_dc), B, gain)
    z[P_C] = _filled(P_c, volumes.case, dt * (leaked + q_dc + q_sc + q_out - q_drain - s.arm * w_new), B, gain)
    z[P_I] = _filled(P_i, volumes.return_line, dt * (q_load + shared * q_drain - q_ret), B, gain)
    z[P_CTRL] = _filled(P_ctrl, volumes.control, dt * (q_in - q_out + s.arm * w_new), B, gain)
    z[X] = x + dt * v_new
    z[V_SPOOL] = v_new
    z[ALPHA] = alpha_new
    z[ALPHA_DOT] = w_new
    flows[0], flows[1], flows[2], flows[3], flows[4] = q_load, q_drain, q_ret, drawn + q_sc, torque
    return math.isfinite(z[P_D] + z[P_C] + z[ALPHA])


@compiled
def _filled(P: float, volume: float, added: float, B: float, gain: float) -> float:
    """Pressure of a fixed volume after fluid was added [Pa]; ``added`` counts volume at ambient density."""
    w = relative_density(P - P_ATMOSPHERE, B, gain) + added / volume
    return P_ATMOSPHERE + gauge_pressure(w, B, gain)


@compiled
def rates(
    pump: Pump,
    circuit: Circuit,
    scene: Scene,
    y: Vector,
    n: int,
    theta: float,
    scales: Matrix,
    chambers: Matrix,
    dy: Vector,
) -> None:
    """Right-hand side dy/dt, shape (n + 8,), of the same network: for reference integrators."""
    z = y[n:]
    chamber_network(pump, scene, y, n, theta, scales, chambers)
    s = shared_network(pump, circuit, scene, z)
    volumes, comp = pump.volumes, pump.compensator
    B, gain, P_s = scene.B_0, scene.B_gain, scene.P_s
    P_d, P_c, P_i, P_ctrl = z[P_D], z[P_C], z[P_I], z[P_CTRL]
    alpha_dot = z[ALPHA_DOT]
    shared = 1.0 if circuit.shared > 0.5 else 0.0
    to_discharge = leaked = torque = 0.0
    for k in range(n):
        G_d, G_s, G_l, drag, volume, rotation, tilt = chambers[k, :7]
        p = y[k] - P_ATMOSPHERE
        q_d, q_l = G_d * (y[k] - P_d), G_l * (y[k] - P_c) + drag
        grown = relative_density(p, B, gain) * (rotation + tilt * alpha_dot)
        dy[k] = (G_s * (P_s - y[k]) - q_d - q_l - grown) / (relative_compressibility(p, B, gain) * volume)
        to_discharge += q_d
        leaked += q_l
        torque += tilt * (y[k] - P_c)
    q_load = s.load * (P_d - P_i) + scene.Q_load + scene.Q_sys
    q_in = s.e_in * (P_d - P_ctrl)
    q_out = s.e_out * (P_ctrl - P_c) + s.bleed
    q_dc = (s.plate_d + s.throttled) * (P_d - P_c)
    q_sc = s.plate_s * (P_s - P_c)
    q_drain = s.drain * (P_c - (P_i if shared > 0.5 else P_s))
    q_ret = s.ret * (P_i - P_s)
    dy[n + P_D] = (to_discharge - q_load - q_in - q_dc) / (
        relative_compressibility(P_d - P_ATMOSPHERE, B, gain) * volumes.discharge
    )
    dy[n + P_C] = (leaked + q_dc + q_sc + q_out - q_drain - s.arm * alpha_dot) / (
        relative_compressibility(P_c - P_ATMOSPHERE, B, gain) * volumes.case
    )
    dy[n + P_I] = (q_load + shared * q_drain - q_ret) / (
        relative_compressibility(P_i - P_ATMOSPHERE, B, gain) * volumes.return_line
    )
    dy[n + P_CTRL] = (q_in - q_out + s.arm * alpha_dot) / (
        relative_compressibility(P_ctrl - P_ATMOSPHERE, B, gain) * volumes.control
    )
    dy[n + X] = z[V_SPOOL]
    dy[n + V_SPOOL] = ((P_d - P_c) * comp.A_spool - s.F_spring) / comp.m_spool
    dy[n + ALPHA] = alpha_dot
    dy[n + ALPHA_DOT] = (s.torque + torque - s.arm * (P_ctrl - P_c)) / pump.swashplate.J
