"""The transient pump as dy/dt, from the passages that its own steps take: for integrators that referee the stepper."""

import math

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled
from twin.laws.compressibility import P_FLOOR, relative_compressibility, relative_density
from twin.parameters import Circuit, Pump
from twin.parts.slipper import lever
from twin.simulation import chambers
from twin.simulation.film import Motion, Stance, film, lifted_volume
from twin.simulation.layout import (
    ALPHA,
    ALPHA_DOT,
    CAPACITY,
    COS,
    DENSITY,
    DRAG,
    G_D,
    G_L,
    G_S,
    N_SHARED,
    OF_PISTON,
    OF_SLIPPER,
    OMEGA,
    P_C,
    P_CTRL,
    P_D,
    P_I,
    ROTATION,
    SIN,
    THETA,
    TILT,
    V_RATE,
    V_SPOOL,
    V_STROKE,
    VOLUME,
    X_RATE,
    X_STROKE,
    X,
)
from twin.simulation.scene import Scene
from twin.simulation.step import passages, pose_of

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


@compiled
def rates(
    pump: Pump,
    circuit: Circuit,
    scene: Scene,
    y: Vector,
    n: int,
    clearances: Matrix,
    ch: Matrix,
    dy: Vector,
) -> None:
    """Right-hand side dy/dt of the same network: for reference integrators."""
    s = passages(pump, circuit, scene, y, pose_of(y), n, clearances, ch)
    chambers.ports(pump, scene, y, n, ch)
    if pump.slipper.variable > 0.5:
        to_discharge, leaked, torque = lifted_rates(pump, scene, y, n, clearances, ch, dy)
    else:
        to_discharge, leaked, torque = chamber_rates(scene, y, n, ch, dy)
    volumes, comp, servo, m, P_s = pump.volumes, pump.compensator, pump.servo, scene.medium, scene.P_s
    P_d, P_c, P_i, P_ctrl, w = y[P_D], y[P_C], y[P_I], max(y[P_CTRL], P_FLOOR), y[ALPHA_DOT]
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


@compiled
def chamber_rates(scene: Scene, y: Vector, n: int, ch: Matrix, dy: Vector) -> tuple[float, float, float]:
    """Pressure rates of the chambers into ``dy``; returns flow to discharge, into the case and torque on the plate."""
    P_d, P_c, w = y[P_D], y[P_C], y[ALPHA_DOT]
    to_discharge = leaked = torque = 0.0
    for k in range(n):
        P = max(y[N_SHARED + k], P_FLOOR)
        q_d, q_l = ch[k, G_D] * (P - P_d), ch[k, G_L] * (P - P_c) + ch[k, DRAG]
        grown = ch[k, DENSITY] * (ch[k, ROTATION] + ch[k, TILT] * w)
        stored = ch[k, CAPACITY] * ch[k, VOLUME]
        dy[N_SHARED + k] = (ch[k, G_S] * (scene.P_s - P) - q_d - q_l - grown) / stored
        to_discharge += q_d
        leaked += q_l
        torque += ch[k, TILT] * (P - P_c)
    return to_discharge, leaked, torque


@compiled
def lifted_rates(
    pump: Pump, scene: Scene, y: Vector, n: int, clearances: Matrix, ch: Matrix, dy: Vector
) -> tuple[float, float, float]:
    """Rates of pressures, gaps and speeds into ``dy``; returns flow to discharge, into the case, torque on the plate."""
    piston, slipper = pump.piston, pump.slipper
    A_p = 0.25 * math.pi * piston.d_p**2
    S, extra = scene.S_eq, (1.0 - slipper.pumped_repair) * (scene.A_outer - scene.S_eq)
    P_d, P_c, omega, w = y[P_D], y[P_C], y[OMEGA], y[ALPHA_DOT]
    t = math.tan(y[ALPHA])
    cos_alpha = 1.0 / math.sqrt(1.0 + t * t)
    to_discharge = leaked = torque = 0.0
    for k in range(n):
        i = N_SHARED + k
        P, P_p, h, u = max(y[i], P_FLOOR), max(y[i + n], P_FLOOR), y[i + 2 * n], y[i + 3 * n]
        c = ch[k, COS]
        arm = lever(piston, h, cos_alpha, t, c)
        h_dot = cos_alpha * (u - piston.R * t * ch[k, SIN] * omega) + arm * w
        stance = Stance(clearances[k, OF_PISTON], clearances[k, OF_SLIPPER], t, cos_alpha, c)
        f = film(pump, scene, stance, Motion(P, P_p, P_c, h, u, h_dot))
        q_d, q_t = ch[k, G_D] * (P - P_d), f.throttle * (P - P_p)
        q_r, q_h = f.ring * (P - P_c) + f.drag, f.land * (P_p - P_c)
        force = f.elastic - f.damping * h_dot
        stored = ch[k, CAPACITY] * lifted_volume(piston, scene.t_max, t, c, h)
        dy[i] = (ch[k, G_S] * (scene.P_s - P) - q_d - q_t - q_r + ch[k, DENSITY] * A_p * u) / stored
        w_p = relative_density(scene.medium, P_p)
        pocket = relative_compressibility(scene.medium, P_p) * (slipper.V_pocket + S * h)
        dy[i + n] = (q_t - q_h - w_p * S * h_dot) / pocket
        dy[i + 2 * n] = h_dot
        push = cos_alpha * (S * (P_p - P_c) - extra * (P_c - scene.P_amb) + force)
        dy[i + 3 * n] = (push - A_p * (P - P_c) - f.held * u) / piston.m
        to_discharge += q_d
        leaked += q_h + q_r + (S + extra) * h_dot - A_p * u
        torque += arm * (S * (P_p - P_c) + force)
    return to_discharge, leaked, torque
