"""Chambers with variable slipper gaps: piston and slipper are one moving body, its pocket a volume of its own.

Per piston the unknowns are chamber pressure, pocket pressure and the piston's speed u along its bore; they couple
to P_d, P_c and the tilt rate only and are eliminated together. Speeds are linearly implicit through contact and film.
"""

import math

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled
from twin.laws.compressibility import pressure, relative_compressibility, relative_density
from twin.laws.friction import gap_drag
from twin.laws.orifice import smooth_orifice_conductance
from twin.parameters import Piston, Pump
from twin.parts.servo import contact_damping
from twin.parts.slipper import contact, lever
from twin.simulation.layout import (
    ALPHA,
    ALPHA_DOT,
    CAPACITY,
    COS,
    DAMPING,
    DENSITY,
    DRAG,
    FIRST_SCRATCH,
    FORCE,
    G_D,
    G_LAND,
    G_RING,
    G_S,
    G_THROTTLE,
    HELD,
    LEVER,
    MASS,
    N_SHARED,
    OMEGA,
    P_C,
    P_D,
    POCKET,
    Q_SLIPPER,
    Q_SUCTION,
    SIN,
    TORQUE,
    VOLUME,
)
from twin.simulation.scene import Scene, viscosity_factor

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

_P = FIRST_SCRATCH
_U = FIRST_SCRATCH + 4
_Q = FIRST_SCRATCH + 8
_COS_NEW = FIRST_SCRATCH + 12
_R = FIRST_SCRATCH + 13
_DP_LAMINAR = 1.0e3


@compiled
def lifted_volume(piston: Piston, t_max: float, t: float, cos_phi: float, h: float) -> float:
    """Volume of a chamber whose slipper stands h off the plate [m3]."""
    A = 0.25 * math.pi * piston.d_p**2
    return piston.V_dead + A * (piston.R * (t_max + t * cos_phi) - h * math.sqrt(1.0 + t * t))


@compiled
def variable_gaps(pump: Pump, scene: Scene, y: Vector, n: int, clearances: Matrix, ch: Matrix) -> None:
    """Passages and forces of every slipper; the slipper's clearance factor widens its gap as wear of the land does."""
    piston, slipper = pump.piston, pump.slipper
    P_c, omega, w = y[P_C], y[OMEGA], y[ALPHA_DOT]
    t = math.tan(y[ALPHA])
    cos_alpha = 1.0 / math.sqrt(1.0 + t * t)
    for k in range(n):
        P, P_p = y[N_SHARED + k], y[N_SHARED + n + k]
        h, u = y[N_SHARED + 2 * n + k], y[N_SHARED + 3 * n + k]
        c, s = ch[k, COS], ch[k, SIN]
        mu = scene.mu_0 * viscosity_factor(scene.mu_slope * max(P - P_c, 0.0))
        mu_p = scene.mu_0 * viscosity_factor(scene.mu_slope * max(P_p - P_c, 0.0))
        # a land in contact still leaks through its roughness
        height = max(h, slipper.h_min) + (clearances[k, 1] - 1.0) * slipper.h
        ch[k, G_LAND] = scene.slipper_scale * scene.land * height**3 / mu_p
        area = slipper.C_q * 0.25 * math.pi * slipper.d_throttle**2
        ch[k, G_THROTTLE] = smooth_orifice_conductance(P - P_p, area, scene.rho, _DP_LAMINAR)
        b = clearances[k, 0]
        length = piston.l_mean - piston.R * t * c
        ch[k, G_RING] = scene.piston_scale * scene.ring * b**3 / (mu * length)
        ch[k, DRAG] = -scene.ring_drag * b * u
        ch[k, VOLUME] = lifted_volume(piston, scene.t_max, t, c, h)
        ch[k, POCKET] = slipper.V_pocket + scene.S_eq * h
        arm = lever(piston, h, cos_alpha, t, c)
        ch[k, LEVER] = arm
        elastic, _ = contact(slipper, h)
        h_dot = cos_alpha * (u - piston.R * t * s * omega) + arm * w
        ch[k, FORCE] = elastic
        ch[k, DAMPING] = contact_damping(abs(elastic), h_dot, slipper.d_contact) + scene.squeeze * mu_p / height**3
        ch[k, HELD] = slipper.damping + gap_drag(mu, piston.d_p, piston.b * b, piston.e_rel, length)


@compiled
def eliminate_lifted(pump: Pump, scene: Scene, y: Vector, n: int, dt: float, ch: Matrix, A: Matrix, b: Vector) -> None:
    """Every piston's three unknowns by P_d', P_c' and the tilt rate; their flows and torques into A and b."""
    piston, slipper = pump.piston, pump.slipper
    A_p = 0.25 * math.pi * piston.d_p**2
    S, A_e = scene.S_eq, scene.A_outer
    unrepaired = 1.0 - slipper.pumped_repair
    t = math.tan(y[ALPHA])
    cos_alpha = 1.0 / math.sqrt(1.0 + t * t)
    turn_c, turn_s = math.cos(y[OMEGA] * dt), math.sin(y[OMEGA] * dt)
    S_back = S + unrepaired * (A_e - S)
    for k in range(n):
        P, P_p = y[N_SHARED + k], y[N_SHARED + n + k]
        h, u = y[N_SHARED + 2 * n + k], y[N_SHARED + 3 * n + k]
        G_d, G_s, G_t, G_h, G_r = ch[k, G_D], ch[k, G_S], ch[k, G_THROTTLE], ch[k, G_LAND], ch[k, G_RING]
        arm, drag = ch[k, LEVER], ch[k, DRAG]
        c_new = ch[k, COS] * turn_c - ch[k, SIN] * turn_s
        # rate of the gap by rotation alone
        r = cos_alpha * piston.R * t * (c_new - ch[k, COS]) / dt
        w_p = relative_density(scene.medium, P_p)
        C = ch[k, CAPACITY] * ch[k, VOLUME] / dt
        C_p = relative_compressibility(scene.medium, P_p) * ch[k, POCKET] / dt
        _, stiffness = contact(slipper, h)
        K_t = stiffness * dt + ch[k, DAMPING]
        D_p = 1.0 / (C_p + G_t + G_h)
        # pocket: P_p' = q_0 + G_t D_p P' + G_h D_p P_c' - S D_p (cos u' + arm w')
        q_0 = (C_p * P_p - w_p * S * r) * D_p
        Sd = w_p * S * D_p
        # chamber and speed
        m_11 = C + G_d + G_s + G_t + G_r - G_t * G_t * D_p
        m_12 = -ch[k, DENSITY] * A_p + G_t * Sd * cos_alpha
        m_21 = A_p - cos_alpha * S * G_t * D_p
        m_22 = piston.m / dt + ch[k, HELD] + cos_alpha * cos_alpha * (K_t + S * Sd)
        det = 1.0 / (m_11 * m_22 - m_12 * m_21)
        push = cos_alpha * (S * q_0 + ch[k, FORCE] - K_t * r + unrepaired * (A_e - S) * scene.P_amb)
        right = (
            (C * P + G_s * scene.P_s - drag + G_t * q_0, piston.m / dt * u + push),
            (G_d, 0.0),
            (
                G_r + G_t * G_h * D_p,
                A_p + cos_alpha * (S * G_h * D_p - S - unrepaired * (A_e - S)),
            ),
            (-G_t * Sd * arm, -cos_alpha * (K_t + S * Sd) * arm),
        )
        own = ((q_0, 0.0), (0.0, 0.0), (G_h * D_p, 0.0), (-Sd * arm, 0.0))
        # columns of P', u', P_p' by (1, P_d', P_c', w')
        for j in range(4):
            r_1, r_2 = right[j]
            x_1 = (r_1 * m_22 - m_12 * r_2) * det
            x_2 = (m_11 * r_2 - m_21 * r_1) * det
            ch[k, _P + j], ch[k, _U + j] = x_1, x_2
            ch[k, _Q + j] = own[j][0] + G_t * D_p * x_1 - Sd * cos_alpha * x_2
        ch[k, _COS_NEW], ch[k, _R] = c_new, r
        ch[k, MASS] = ch[k, DENSITY] * ch[k, VOLUME]
        for j in range(4):
            P_j, u_j, q_j = ch[k, _P + j], ch[k, _U + j], ch[k, _Q + j]
            h_j = cos_alpha * u_j
            d_j = c_j = 0.0
            if j == 0:
                h_j += r
            elif j == 1:
                d_j = 1.0
            elif j == 2:
                c_j = 1.0
            else:
                h_j += arm
            into_d = G_d * (P_j - d_j)
            into_c = G_h * (q_j - c_j) + G_r * (P_j - c_j) + S_back * h_j - A_p * u_j
            torque = arm * (S * (q_j - c_j) - K_t * h_j)
            if j == 0:
                b[0] += into_d
                b[1] += into_c + drag
                b[5] += torque + arm * ch[k, FORCE]
            else:
                column = 0 if j == 1 else (1 if j == 2 else 5)
                A[0, column] -= into_d
                A[1, column] -= into_c
                A[5, column] -= torque


@compiled
def update_lifted(
    pump: Pump, scene: Scene, y: Vector, n: int, dt: float, ch: Matrix, b: Vector, t_new: float, flows: Vector
) -> tuple[float, float]:
    """New pressures, gaps and speeds; returns flow to discharge and into the case [m3/s]."""
    piston, slipper = pump.piston, pump.slipper
    P_d, P_c, w_new = b[0], b[1], b[5]
    A_p = 0.25 * math.pi * piston.d_p**2
    S_back = scene.S_eq + (1.0 - slipper.pumped_repair) * (scene.A_outer - scene.S_eq)
    t = math.tan(y[ALPHA])
    cos_alpha = 1.0 / math.sqrt(1.0 + t * t)
    to_discharge = leaked = torque = drawn = slipped = 0.0
    for k in range(n):
        P = ch[k, _P] + ch[k, _P + 1] * P_d + ch[k, _P + 2] * P_c + ch[k, _P + 3] * w_new
        u = ch[k, _U] + ch[k, _U + 1] * P_d + ch[k, _U + 2] * P_c + ch[k, _U + 3] * w_new
        P_p = ch[k, _Q] + ch[k, _Q + 1] * P_d + ch[k, _Q + 2] * P_c + ch[k, _Q + 3] * w_new
        h_dot = cos_alpha * u + ch[k, _R] + ch[k, LEVER] * w_new
        i = N_SHARED + k
        elastic, stiffness = contact(slipper, y[i + 2 * n])
        N = scene.S_eq * (P_p - P_c) + elastic - (stiffness * dt + ch[k, DAMPING]) * h_dot
        q_d, q_s, q_t = ch[k, G_D] * (P - P_d), ch[k, G_S] * (scene.P_s - P), ch[k, G_THROTTLE] * (P - P_p)
        q_r, q_h = ch[k, G_RING] * (P - P_c) + ch[k, DRAG], ch[k, G_LAND] * (P_p - P_c)
        h = y[i + 2 * n] + dt * h_dot
        mass = ch[k, MASS] + dt * (q_s - q_d - q_t - q_r)
        ch[k, MASS] = mass
        pocket = relative_density(scene.medium, y[i + n]) * ch[k, POCKET] + dt * (q_t - q_h)
        y[i] = pressure(scene.medium, mass / lifted_volume(piston, scene.t_max, t_new, ch[k, _COS_NEW], h), P)
        y[i + n] = pressure(scene.medium, pocket / (slipper.V_pocket + scene.S_eq * h), P_p)
        y[i + 2 * n], y[i + 3 * n] = h, u
        to_discharge += q_d
        leaked += q_h + q_r + S_back * h_dot - A_p * u
        drawn += q_s
        slipped += q_h
        torque -= N * ch[k, _R]
    flows[Q_SUCTION], flows[TORQUE], flows[Q_SLIPPER] = drawn, torque / y[OMEGA], slipped
    return to_discharge, leaked


@compiled
def lifted_rates(pump: Pump, scene: Scene, y: Vector, n: int, ch: Matrix, dy: Vector) -> tuple[float, float, float]:
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
        P, P_p, u = y[i], y[i + n], y[i + 3 * n]
        h_dot = cos_alpha * (u - piston.R * t * ch[k, SIN] * omega) + ch[k, LEVER] * w
        q_d, q_t = ch[k, G_D] * (P - P_d), ch[k, G_THROTTLE] * (P - P_p)
        q_r, q_h = ch[k, G_RING] * (P - P_c) + ch[k, DRAG], ch[k, G_LAND] * (P_p - P_c)
        film = ch[k, FORCE] - ch[k, DAMPING] * h_dot
        stored = ch[k, CAPACITY] * ch[k, VOLUME]
        dy[i] = (ch[k, G_S] * (scene.P_s - P) - q_d - q_t - q_r + ch[k, DENSITY] * A_p * u) / stored
        w_p = relative_density(scene.medium, P_p)
        pocket = relative_compressibility(scene.medium, P_p) * ch[k, POCKET]
        dy[i + n] = (q_t - q_h - w_p * S * h_dot) / pocket
        dy[i + 2 * n] = h_dot
        push = cos_alpha * (S * (P_p - P_c) - extra * (P_c - scene.P_amb) + film)
        dy[i + 3 * n] = (push - A_p * (P - P_c) - ch[k, HELD] * u) / piston.m
        to_discharge += q_d
        leaked += q_h + q_r + (S + extra) * h_dot - A_p * u
        torque += ch[k, LEVER] * (S * (P_p - P_c) + film)
    return to_discharge, leaked, torque
