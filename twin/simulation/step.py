"""One linearly implicit step: chambers eliminated, shared states solved together, masses updated by the solved flows.

The Jacobian is an arrow: a chamber couples to P_d, P_c and the tilt rate only. Flows are linear in the new pressures
through secant conductances (a tangent on a square-root law overshoots). After the solve every volume's mass is updated
by exactly the flows that its neighbours saw, and the pressure follows from the mass: mass is conserved to rounding.
"""

import math

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled, inlined
from twin.laws.compressibility import pressure_of, relative_compressibility, relative_density
from twin.parameters import Circuit, Pump
from twin.parts.drive import friction_torque, speed_after
from twin.simulation import chambers, slippers
from twin.simulation.layout import (
    ALPHA,
    ALPHA_DOT,
    MASS,
    OMEGA,
    P_C,
    P_CTRL,
    P_D,
    P_I,
    POCKET,
    Q_DRAIN,
    Q_LOAD,
    Q_RETURN,
    Q_SUCTION,
    Q_SYSTEM,
    THETA,
    TORQUE,
    V_RATE,
    V_SPOOL,
    V_STROKE,
    X_RATE,
    X_STROKE,
    X,
)
from twin.simulation.scene import Scene
from twin.simulation.shared import Shared, assemble, servo_speed, shared_passages

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

N_SOLVED = 6


@inlined
def passages(pump: Pump, circuit: Circuit, scene: Scene, y: Vector, n: int, clearances: Matrix, ch: Matrix) -> Shared:
    """Every passage and force at the state ``y`` but the ports: chambers into ``ch``, the rest returned."""
    t = math.tan(y[ALPHA])
    chambers.volumes(pump, scene, y, n, t, ch)
    if pump.slipper.variable < 0.5:
        chambers.constant_gaps(pump, scene, y, n, clearances, t, ch)
    return shared_passages(pump, circuit, scene, y)


@inlined
def solve_step(
    pump: Pump,
    circuit: Circuit,
    scene: Scene,
    s: Shared,
    y: Vector,
    n: int,
    dt: float,
    n_sub: int,
    T_start: float,
    clearances: Matrix,
    ch: Matrix,
    A: Matrix,
    b: Vector,
    masses: Vector,
    flows: Vector,
) -> bool:
    """Advance ``y`` by ``dt`` in place with the passages in ``s`` and ``ch``; False when it failed.

    ``A`` (6, 6) and ``b`` (6,) are scratch; ``masses`` (4 + 2 n,) receives the fluid in discharge, case, return, control
    volume, chambers and pockets [m3 at ambient density]; ``flows`` (N_FLOWS,) the step's flows.
    """
    lifted = pump.slipper.variable > 0.5
    assemble(pump, circuit, scene, s, y, dt, A, b)
    if lifted:
        slippers.eliminate_lifted(pump, scene, y, n, dt, clearances, ch, A, b)
    else:
        chambers.eliminate(pump, scene, y, n, dt, n_sub, clearances, ch, A, b)
    if not solve_shared(A, b):
        return False
    Pd, Pc, Pi, Pctrl, v_new, w_new = b[0], b[1], b[2], b[3], b[4], b[5]
    alpha_new = y[ALPHA] + dt * w_new
    t_new = math.tan(alpha_new)
    if lifted:
        to_discharge, leaked = slippers.update_lifted(pump, scene, y, n, dt, ch, b, t_new, flows)
    else:
        to_discharge, leaked = chambers.update(pump, scene, y, n, dt, ch, b, t_new, flows)

    P_s = scene.P_s
    shared = 1.0 if circuit.shared > 0.5 else 0.0
    q_load = s.load * (Pd - Pi) + scene.Q_load
    q_sys = s.system * (Pd - P_s)
    q_in = s.e_in * (Pd - Pctrl) + s.e_in_x * dt * v_new
    q_out = s.e_out * (Pctrl - Pc) + s.e_out_x * dt * v_new + s.bleed
    q_dc = (s.plate_d + s.throttled + s.rate_leak) * (Pd - Pc)
    q_sc = s.plate_s * (P_s - Pc)
    q_drain = s.drain * (Pc - (Pi if shared > 0.5 else P_s))
    q_ret = s.ret * (Pi - P_s)
    swept, fed = -s.arm * w_new, s.arm_rate * w_new
    if pump.servo.contact > 0.5:
        swept, fed = _move_servos(pump, s, y, dt, b)
    m, volumes = scene.medium, pump.volumes
    d_d, d_c = to_discharge - q_load - q_sys - q_in - q_dc - fed, leaked + q_dc + q_sc + q_out - q_drain + swept + fed
    d_i, d_x = q_load + q_sys + shared * q_drain - q_ret, q_in - q_out - swept
    masses[0] = relative_density(m, y[P_D]) * volumes.discharge + dt * d_d
    masses[1] = relative_density(m, y[P_C]) * volumes.case + dt * d_c
    masses[2] = relative_density(m, y[P_I]) * volumes.return_line + dt * d_i
    masses[3] = relative_density(m, y[P_CTRL]) * volumes.control + dt * d_x
    for k in range(n):
        masses[4 + k] = ch[k, MASS]
        if lifted:
            masses[4 + n + k] = ch[k, POCKET]
    y[P_D] = pressure_of(m, masses[0], volumes.discharge, Pd)
    y[P_C] = pressure_of(m, masses[1], volumes.case, Pc)
    y[P_I] = pressure_of(m, masses[2], volumes.return_line, Pi)
    y[P_CTRL] = pressure_of(m, masses[3], volumes.control, Pctrl)
    y[X] += dt * v_new
    y[V_SPOOL] = v_new
    y[ALPHA] = alpha_new
    y[ALPHA_DOT] = w_new
    omega = y[OMEGA]
    y[THETA] += dt * omega
    if pump.drive.J > 0.0:
        T = flows[TORQUE] + friction_torque(pump.drive, scene.mu_ratio, omega * scene.omega_ratio, Pd - Pc)
        y[OMEGA] = speed_after(pump.drive, omega, scene.omega, T_start, T, dt)
    else:
        y[OMEGA] = scene.omega
    flows[Q_LOAD], flows[Q_DRAIN], flows[Q_RETURN], flows[Q_SYSTEM] = q_load, q_drain, q_ret, q_sys
    flows[Q_SUCTION] += q_sc
    return math.isfinite(y[P_D] + y[P_C] + y[ALPHA])


@inlined
def solve_shared(A: Matrix, b: Vector) -> bool:
    """Solve the shared system in the order that its zeros allow: P_i and the spool's speed see P_d and P_c only.

    ``b``, shape (6,), becomes the solution; False when the system is singular.
    """
    i_i, i_v, i_x = 1.0 / A[2, 2], 1.0 / A[4, 4], 1.0 / A[3, 3]
    # P_i = r_0 + r_d P_d + r_c P_c, likewise the spool's speed v and then, with the tilt rate, P_ctrl
    r_0, r_d, r_c = b[2] * i_i, -A[2, 0] * i_i, -A[2, 1] * i_i
    v_0, v_d, v_c = b[4] * i_v, -A[4, 0] * i_v, -A[4, 1] * i_v
    x_0 = (b[3] - A[3, 4] * v_0) * i_x
    x_d = -(A[3, 0] + A[3, 4] * v_d) * i_x
    x_c = -(A[3, 1] + A[3, 4] * v_c) * i_x
    x_w = -A[3, 5] * i_x
    m_00 = A[0, 0] + A[0, 2] * r_d + A[0, 3] * x_d + A[0, 4] * v_d
    m_01 = A[0, 1] + A[0, 2] * r_c + A[0, 3] * x_c + A[0, 4] * v_c
    m_02 = A[0, 5] + A[0, 3] * x_w
    k_0 = b[0] - A[0, 2] * r_0 - A[0, 3] * x_0 - A[0, 4] * v_0
    m_10 = A[1, 0] + A[1, 2] * r_d + A[1, 3] * x_d + A[1, 4] * v_d
    m_11 = A[1, 1] + A[1, 2] * r_c + A[1, 3] * x_c + A[1, 4] * v_c
    m_12 = A[1, 5] + A[1, 3] * x_w
    k_1 = b[1] - A[1, 2] * r_0 - A[1, 3] * x_0 - A[1, 4] * v_0
    m_20 = A[5, 0] + A[5, 3] * x_d
    m_21 = A[5, 1] + A[5, 3] * x_c
    m_22 = A[5, 5] + A[5, 3] * x_w
    k_2 = b[5] - A[5, 3] * x_0
    i_0 = 1.0 / m_00
    f_1, f_2 = m_10 * i_0, m_20 * i_0
    n_11, n_12, k_1 = m_11 - f_1 * m_01, m_12 - f_1 * m_02, k_1 - f_1 * k_0
    n_21, n_22, k_2 = m_21 - f_2 * m_01, m_22 - f_2 * m_02, k_2 - f_2 * k_0
    det = n_11 * n_22 - n_12 * n_21
    if det == 0.0:
        return False
    P_c = (k_1 * n_22 - n_12 * k_2) / det
    w = (n_11 * k_2 - k_1 * n_21) / det
    P_d = (k_0 - m_01 * P_c - m_02 * w) * i_0
    b[0], b[1], b[5] = P_d, P_c, w
    b[2] = r_0 + r_d * P_d + r_c * P_c
    b[3] = x_0 + x_d * P_d + x_c * P_c + x_w * w
    b[4] = v_0 + v_d * P_d + v_c * P_c
    return True


@compiled
def _move_servos(pump: Pump, s: Shared, y: Vector, dt: float, b: Vector) -> tuple[float, float]:
    """Move the servo pistons by the solution; returns the stroking piston's and the fed rate piston's flows."""
    servo, w_new = pump.servo, b[5]
    a_0, a_p, share = servo_speed(s.stroke, y[V_STROKE], servo.m_stroke, dt)
    v_s = a_0 + a_p * servo.A_stroke * (b[3] - b[1]) - share * s.stroke.reach * w_new
    a_0, a_p, share = servo_speed(s.rate, y[V_RATE], servo.m_rate, dt)
    fed = servo.A_rate * servo.rate_fed
    v_r = a_0 + a_p * fed * (b[0] - b[1]) + share * s.rate.reach * w_new
    y[X_STROKE] += dt * v_s
    y[V_STROKE] = v_s
    y[X_RATE] += dt * v_r
    y[V_RATE] = v_r
    return servo.A_stroke * v_s, fed * v_r


@compiled
def rates(
    pump: Pump,
    circuit: Circuit,
    scene: Scene,
    y: Vector,
    n: int,
    T_start: float,
    clearances: Matrix,
    ch: Matrix,
    dy: Vector,
) -> None:
    """Right-hand side dy/dt of the same network: for reference integrators."""
    s = passages(pump, circuit, scene, y, n, clearances, ch)
    chambers.ports(pump, scene, y, n, ch)
    if pump.slipper.variable > 0.5:
        to_discharge, leaked, torque = slippers.lifted_rates(pump, scene, y, n, clearances, ch, dy)
    else:
        to_discharge, leaked, torque = chambers.chamber_rates(scene, y, n, ch, dy)
    volumes, comp, servo, m, P_s = pump.volumes, pump.compensator, pump.servo, scene.medium, scene.P_s
    P_d, P_c, P_i, P_ctrl, w = y[P_D], y[P_C], y[P_I], y[P_CTRL], y[ALPHA_DOT]
    shared = 1.0 if circuit.shared > 0.5 else 0.0
    q_load = s.load * (P_d - P_i) + scene.Q_load + s.system * (P_d - P_s)
    q_in = s.e_in * (P_d - P_ctrl)
    q_out = s.e_out * (P_ctrl - P_c) + s.bleed
    q_dc = (s.plate_d + s.throttled + s.rate_leak) * (P_d - P_c)
    q_drain = s.drain * (P_c - (P_i if shared > 0.5 else P_s))
    swept, fed = -s.arm * w, s.arm_rate * w
    torque += s.torque + s.torque_rate * w
    for i in range(X_STROKE, V_RATE + 1):
        dy[i] = 0.0
    if servo.contact > 0.5:
        v_s, v_r = y[V_STROKE], y[V_RATE]
        fed_area = servo.A_rate * servo.rate_fed
        swept, fed = servo.A_stroke * v_s, fed_area * v_r
        F_s = s.stroke.elastic + s.stroke.contact * (v_s + s.stroke.reach * w)
        F_r = s.rate.elastic + s.rate.contact * (v_r - s.rate.reach * w)
        torque += s.rate.reach * F_r - s.stroke.reach * F_s
        dy[X_STROKE], dy[X_RATE] = v_s, v_r
        own = servo.A_stroke * (P_ctrl - P_c) + s.stroke.push
        dy[V_STROKE] = (own - F_s - s.stroke.own * v_s) / servo.m_stroke
        dy[V_RATE] = (fed_area * (P_d - P_c) + s.rate.push - F_r - s.rate.own * v_r) / servo.m_rate
    else:
        torque += s.arm_rate * (P_d - P_c) - s.arm * (P_ctrl - P_c)
    into_c = leaked + q_dc + s.plate_s * (P_s - P_c) + q_out - q_drain + swept + fed
    dy[P_D] = (to_discharge - q_load - q_in - q_dc - fed) / (relative_compressibility(m, P_d) * volumes.discharge)
    dy[P_C] = into_c / (relative_compressibility(m, P_c) * volumes.case)
    into_i = q_load + shared * q_drain - s.ret * (P_i - P_s)
    dy[P_I] = into_i / (relative_compressibility(m, P_i) * volumes.return_line)
    dy[P_CTRL] = (q_in - q_out - swept) / (relative_compressibility(m, P_ctrl) * volumes.control)
    dy[X] = y[V_SPOOL]
    dy[V_SPOOL] = ((P_d - P_c) * comp.A_spool - s.F_spring - s.F_spring_v * y[V_SPOOL]) / comp.m_spool
    dy[ALPHA] = w
    dy[ALPHA_DOT] = torque / s.J
    dy[THETA] = y[OMEGA]
    dy[OMEGA] = 0.0
