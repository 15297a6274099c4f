"""One linearly implicit step: chambers eliminated, shared states solved together, masses updated by the solved flows.

The Jacobian is an arrow: a chamber couples to P_d, P_c and the tilt rate only. Flows are linear in the new pressures
through secant conductances (a tangent on a square-root law overshoots). After the solve every volume's mass is updated
by exactly the flows that its neighbours saw, and the pressure follows from the mass: mass is conserved to rounding.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled, inlined
from twin.parameters import Circuit, Pump
from twin.parts.drive import friction_torque, speed_after
from twin.simulation import chambers, mapped_slippers, slippers
from twin.simulation.chambers import Step
from twin.simulation.layout import (
    ALPHA,
    ALPHA_DOT,
    MASS,
    N_VOLUMES,
    OMEGA,
    P_C,
    P_CTRL,
    P_D,
    P_I,
    POCKET,
    Q_DRAIN,
    Q_LOAD,
    Q_RETURN,
    Q_SLIPPER,
    Q_SUCTION,
    Q_SYSTEM,
    SPOOL_SPEED,
    THETA,
    TILT_RATE,
    TORQUE,
    V_RATE,
    V_SPOOL,
    V_STROKE,
    X_RATE,
    X_STROKE,
    X,
)
from twin.simulation.scene import Scene
from twin.simulation.shared import Shared, assemble, bleed_ahead, open_cavity, servo_speed, shared_passages
from twin.simulation.turning import Pose, tangent_after
from twin.simulation.volumes import set_pressures

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


class Scratch(NamedTuple):
    """What a step works on: factors on the gaps (n, 2), table of the chambers (n, N_COLUMNS), shared system (6, 6), (6,),
    and what a metamodel says that slippers add (``mapped_slippers``), shape (N_ADDED,), or (0,) without one.
    """

    clearances: Matrix
    ch: Matrix
    A: Matrix
    b: Vector
    added: Vector


@inlined
def passages(
    pump: Pump, circuit: Circuit, scene: Scene, y: Vector, pose: Pose, n: int, clearances: Matrix, ch: Matrix
) -> Shared:
    """Every passage and force at the state ``y`` but the ports: chambers into ``ch``, the rest returned."""
    chambers.volumes(pump, scene, y, n, pose, ch)
    if pump.slipper.variable < 0.5:
        chambers.constant_gaps(pump, scene, y, n, clearances, pose.t, ch)
    return shared_passages(pump, circuit, scene, y, pose.t)


@inlined
def pose_of(y: Vector) -> Pose:
    """Where plate and shaft stand in the state ``y``."""
    return Pose(math.tan(y[ALPHA]), math.cos(y[THETA]), math.sin(y[THETA]))


@inlined
def solve_step(
    pump: Pump,
    circuit: Circuit,
    scene: Scene,
    s: Shared,
    y: Vector,
    step: Step,
    scratch: Scratch,
    masses: Vector,
    flows: Vector,
) -> tuple[bool, float]:
    """Advance ``y`` by a step in place with the passages in ``s`` and the scratch; False when it failed, and the tangent
    of the tilt that it ended with.

    ``masses`` (N_VOLUMES + 2 n,) receives the fluid in discharge, case, return, control volume, chambers and pockets
    [m3 at ambient density]; ``flows`` (N_FLOWS,) the step's flows.
    """
    n, dt, T_start = step.n, step.dt, step.T_start
    clearances, ch, A, b, added = scratch
    mapped = added.shape[0] > 0
    lifted = pump.slipper.variable > 0.5
    assemble(pump, circuit, scene, s, y, dt, A, b)
    if lifted:
        slippers.eliminate_lifted(pump, scene, y, n, dt, clearances, ch, A, b)
    else:
        chambers.eliminate(pump, scene, y, step, clearances, ch, A, b)
    if mapped:
        mapped_slippers.assemble(added, scene.P_s, A, b)
    bleed = bleed_slope = 0.0
    if scene.bleed > 0.0:
        bleed, bleed_slope = bleed_ahead(pump, scene, y, A, b)
    open_cavity(y, A, b)
    if not solve_shared(A, b):
        return False, 0.0
    Pd, Pc, Pi, Pctrl, v_new, w_new = b[P_D], b[P_C], b[P_I], b[P_CTRL], b[SPOOL_SPEED], b[TILT_RATE]
    alpha_new = y[ALPHA] + dt * w_new
    t_new = tangent_after(step.t, dt * w_new)
    if lifted:
        to_discharge, leaked = slippers.update_lifted(pump, scene, y, n, dt, ch, b, t_new, flows)
    else:
        to_discharge, leaked = chambers.update(pump, scene, y, step, ch, b, t_new, flows)

    P_s = scene.P_s
    shared = 1.0 if circuit.shared > 0.5 else 0.0
    q_load = s.load * (Pd - Pi) + scene.Q_load
    q_sys = s.system * (Pd - P_s)
    q_in = s.e_in * (Pd - Pctrl) + s.e_in_x * dt * v_new
    q_out = s.e_out * (Pctrl - Pc) + s.e_out_x * dt * v_new + bleed + bleed_slope * (Pctrl - Pc)
    q_dc = (s.plate_d + s.throttled + s.rate_leak) * (Pd - Pc)
    q_sc = s.plate_s * (P_s - Pc)
    if mapped:
        from_d, from_s = mapped_slippers.flows(added, Pd, Pc, P_s)
        q_dc, q_sc = q_dc + from_d, q_sc + from_s
        flows[Q_SLIPPER] = from_d + from_s
        flows[TORQUE] += added[mapped_slippers.SHAFT]
    q_drain = s.drain * (Pc - (Pi if shared > 0.5 else P_s))
    q_ret = s.ret * (Pi - P_s)
    swept, fed = -s.arm * w_new, s.arm_rate * w_new
    if pump.servo.contact > 0.5:
        swept, fed = _move_servos(pump, s, y, dt, b)
    held = s.held
    d_d, d_c = to_discharge - q_load - q_sys - q_in - q_dc - fed, leaked + q_dc + q_sc + q_out - q_drain + swept + fed
    d_i, d_x = q_load + q_sys + shared * q_drain - q_ret, q_in - q_out - swept
    masses[P_D], masses[P_C] = held.fluid_d + dt * d_d, held.fluid_c + dt * d_c
    masses[P_I], masses[P_CTRL] = held.fluid_i + dt * d_i, held.fluid_x + dt * d_x
    for k in range(n):
        masses[N_VOLUMES + k] = ch[k, MASS]
        if lifted:
            masses[N_VOLUMES + n + k] = ch[k, POCKET]
    y[P_D], y[P_C], y[P_I], y[P_CTRL] = Pd, Pc, Pi, Pctrl
    if step.settled:
        set_pressures(pump, scene, masses, y)
    y[X] += dt * v_new
    y[V_SPOOL] = v_new
    y[ALPHA] = alpha_new
    y[ALPHA_DOT] = w_new
    omega = y[OMEGA]
    y[THETA] += dt * omega
    flows[TORQUE] += friction_torque(pump.drive, scene.viscous, Pd - Pc)
    if pump.drive.J > 0.0:
        y[OMEGA] = speed_after(pump.drive, omega, scene.omega, T_start, flows[TORQUE], dt)
    else:
        y[OMEGA] = scene.omega
    flows[Q_LOAD], flows[Q_DRAIN], flows[Q_RETURN], flows[Q_SYSTEM] = q_load, q_drain, q_ret, q_sys
    flows[Q_SUCTION] += q_sc
    return math.isfinite(y[P_D] + y[P_C] + y[ALPHA]), t_new


@inlined
def solve_shared(A: Matrix, b: Vector) -> bool:
    """Solve the shared system in the order that its zeros allow: P_i and the spool's speed see P_d and P_c only.

    ``b``, shape (6,), becomes the solution; False when the system is singular.
    """
    i_i, i_v, i_x = 1.0 / A[P_I, P_I], 1.0 / A[SPOOL_SPEED, SPOOL_SPEED], 1.0 / A[P_CTRL, P_CTRL]
    # P_i = r_0 + r_d P_d + r_c P_c, likewise the spool's speed v and then, with the tilt rate, P_ctrl
    r_0, r_d, r_c = b[P_I] * i_i, -A[P_I, P_D] * i_i, -A[P_I, P_C] * i_i
    v_0, v_d, v_c = b[SPOOL_SPEED] * i_v, -A[SPOOL_SPEED, P_D] * i_v, -A[SPOOL_SPEED, P_C] * i_v
    x_0 = (b[P_CTRL] - A[P_CTRL, SPOOL_SPEED] * v_0) * i_x
    x_d = -(A[P_CTRL, P_D] + A[P_CTRL, SPOOL_SPEED] * v_d) * i_x
    x_c = -(A[P_CTRL, P_C] + A[P_CTRL, SPOOL_SPEED] * v_c) * i_x
    x_w = -A[P_CTRL, TILT_RATE] * i_x
    m_00 = A[P_D, P_D] + A[P_D, P_I] * r_d + A[P_D, P_CTRL] * x_d + A[P_D, SPOOL_SPEED] * v_d
    m_01 = A[P_D, P_C] + A[P_D, P_I] * r_c + A[P_D, P_CTRL] * x_c + A[P_D, SPOOL_SPEED] * v_c
    m_02 = A[P_D, TILT_RATE] + A[P_D, P_CTRL] * x_w
    k_0 = b[P_D] - A[P_D, P_I] * r_0 - A[P_D, P_CTRL] * x_0 - A[P_D, SPOOL_SPEED] * v_0
    m_10 = A[P_C, P_D] + A[P_C, P_I] * r_d + A[P_C, P_CTRL] * x_d + A[P_C, SPOOL_SPEED] * v_d
    m_11 = A[P_C, P_C] + A[P_C, P_I] * r_c + A[P_C, P_CTRL] * x_c + A[P_C, SPOOL_SPEED] * v_c
    m_12 = A[P_C, TILT_RATE] + A[P_C, P_CTRL] * x_w
    k_1 = b[P_C] - A[P_C, P_I] * r_0 - A[P_C, P_CTRL] * x_0 - A[P_C, SPOOL_SPEED] * v_0
    m_20 = A[TILT_RATE, P_D] + A[TILT_RATE, P_CTRL] * x_d
    m_21 = A[TILT_RATE, P_C] + A[TILT_RATE, P_CTRL] * x_c
    m_22 = A[TILT_RATE, TILT_RATE] + A[TILT_RATE, P_CTRL] * x_w
    k_2 = b[TILT_RATE] - A[TILT_RATE, P_CTRL] * x_0
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
    b[P_D], b[P_C], b[TILT_RATE] = P_d, P_c, w
    b[P_I] = r_0 + r_d * P_d + r_c * P_c
    b[P_CTRL] = x_0 + x_d * P_d + x_c * P_c + x_w * w
    b[SPOOL_SPEED] = v_0 + v_d * P_d + v_c * P_c
    return True


@compiled
def _move_servos(pump: Pump, s: Shared, y: Vector, dt: float, b: Vector) -> tuple[float, float]:
    """Move the servo pistons by the solution; returns the stroking piston's and the fed rate piston's flows."""
    servo, w_new = pump.servo, b[TILT_RATE]
    a_0, a_p, share = servo_speed(s.stroke, y[V_STROKE], servo.m_stroke, dt)
    v_s = a_0 + a_p * servo.A_stroke * (b[P_CTRL] - b[P_C]) - share * s.stroke.reach * w_new
    a_0, a_p, share = servo_speed(s.rate, y[V_RATE], servo.m_rate, dt)
    fed = servo.A_rate * servo.rate_fed
    v_r = a_0 + a_p * fed * (b[P_D] - b[P_C]) + share * s.rate.reach * w_new
    y[X_STROKE] += dt * v_s
    y[V_STROKE] = v_s
    y[X_RATE] += dt * v_r
    y[V_RATE] = v_r
    return servo.A_stroke * v_s, fed * v_r
