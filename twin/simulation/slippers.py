"""Chambers with variable slipper gaps: piston and slipper are one moving body, its pocket a volume of its own.

Per piston the unknowns are chamber pressure, pocket pressure, gap and the piston's speed u along its bore; they couple
to P_d, P_c and the tilt rate only and are eliminated together. Speeds are linearly implicit through contact and film.
A slipper that slams down, strikes the retainer or changes its kidney takes substeps of its own.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled
from twin.laws.compressibility import pressure, relative_compressibility, relative_density
from twin.laws.fluid import film_viscosity
from twin.laws.friction import gap_drag
from twin.laws.orifice import smooth_orifice_conductance
from twin.parameters import Piston, Pump
from twin.parts.servo import contact_damping
from twin.parts.slipper import contact, lever
from twin.simulation.chambers import port
from twin.simulation.layout import (
    ALPHA,
    ALPHA_DOT,
    CAPACITY,
    COS,
    DENSITY,
    FIRST_SCRATCH,
    G_D,
    G_S,
    MASS,
    N_SHARED,
    OMEGA,
    P_C,
    P_D,
    POCKET,
    Q_SLIPPER,
    Q_SUCTION,
    SIN,
    SUBSTEPS,
    THETA,
    TORQUE,
)
from twin.simulation.scene import Scene

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

(_P, _U, _Q, _H, _TO_D, _FROM_S, _THROTTLED, _RING, _LAND, _LIFT, _SPEED, _PUSH, _WORK) = range(
    FIRST_SCRATCH, FIRST_SCRATCH + 52, 4
)
"""Affine results of a step: ends of chamber pressure, speed, pocket pressure, gap; means of the flows to discharge, from
suction, through throttle, ring and land, of the gap's rate, the piston's speed, the push on the plate, its power."""
_COS_NEW = FIRST_SCRATCH + 52
_DP_LAMINAR = 1.0e3
_FINE_STEP, _FINEST_STEP = 1.0e-6, 0.25e-6
"""Substeps of a slipper that is busy, and of one that slams down on the plate within some tens of microseconds [s]."""
_BUSY_OPENING = 0.35
"""Share of the opening ramp after which a chamber has changed its pressure."""
_QUIET_SHARE, _SLAM_SHARE, _BLOW_SHARE = 0.02, 0.2, 0.1
"""Shares of the gap that a quiet slipper may move in a step, from which on it slams, and falls towards a blow."""
_NEAR, _AT_REST, _THIN = 0.5e-6, 0.05e-6, 5.0e-6
"""Distance from plate or retainer at which contact is near, travel in a step of a slipper that rests there, and gap below
which the film holds a slipper whatever strikes it [m]."""


class Film(NamedTuple):
    """Passages and forces of one slipper and its piston: conductances [m3/s/Pa], drag flow [m3/s], torque arm [m],
    elastic contact force [N] and stiffness [N/m], damping by the gap's rate and by the piston's speed [N s/m].
    """

    land: float
    throttle: float
    ring: float
    drag: float
    arm: float
    elastic: float
    stiffness: float
    damping: float
    held: float


@compiled
def lifted_volume(piston: Piston, t_max: float, t: float, cos_phi: float, h: float) -> float:
    """Volume of a chamber whose slipper stands h off the plate [m3]."""
    A = 0.25 * math.pi * piston.d_p**2
    return piston.V_dead + A * (piston.R * (t_max + t * cos_phi) - h * math.sqrt(1.0 + t * t))


@compiled
def film(
    pump: Pump,
    scene: Scene,
    b: float,
    wear: float,
    t: float,
    cos_alpha: float,
    c: float,
    P: float,
    P_p: float,
    P_c: float,
    h: float,
    u: float,
    h_dot: float,
) -> Film:
    """Passages and forces of a slipper at gap h; ``b`` and ``wear`` are factors on the piston's and the land's gap.

    Wear of the land widens the gap through which it leaks; a land in contact still leaks through its roughness.
    """
    piston, slipper = pump.piston, pump.slipper
    mu = film_viscosity(scene.film, P, P_c)
    mu_p = film_viscosity(scene.film, P_p, P_c)
    height = max(h, slipper.h_min) + (wear - 1.0) * slipper.h
    area = slipper.C_q * 0.25 * math.pi * slipper.d_throttle**2
    length = piston.l_mean - piston.R * t * c
    elastic, stiffness = contact(slipper, h)
    damping = contact_damping(abs(elastic), h_dot, slipper.d_contact) + scene.squeeze * mu_p / height**3
    return Film(
        land=scene.slipper_scale * scene.land * height**3 / mu_p,
        throttle=smooth_orifice_conductance(P - P_p, area, scene.rho, _DP_LAMINAR),
        ring=scene.piston_scale * scene.ring * b**3 / (mu * length),
        drag=-scene.ring_drag * b * u,
        arm=lever(piston, h, cos_alpha, t, c),
        elastic=elastic,
        stiffness=stiffness,
        damping=damping,
        held=slipper.damping + gap_drag(mu, piston.d_p, piston.b * b, piston.e_rel, length),
    )


@compiled
def choose_substeps(pump: Pump, y: Vector, n: int, dt: float, ch: Matrix) -> bool:
    """Number of substeps of every slipper in a step of ``dt``, into the column SUBSTEPS: 1 for a quiet one.

    Returns True when one slams down in this step: the plate feels the blow, so that the step itself must be short.
    """
    blow = False
    plate, slipper, piston = pump.port_plate, pump.slipper, pump.piston
    t = math.tan(y[ALPHA])
    cos_alpha = 1.0 / math.sqrt(1.0 + t * t)
    turn = y[OMEGA] * dt
    many, most = max(1.0, math.ceil(dt / _FINE_STEP - 1.0e-9)), max(1.0, math.ceil(dt / _FINEST_STEP - 1.0e-9))
    first = math.pi - plate.phi_seal - turn
    last = plate.phi_seal + _BUSY_OPENING * plate.phi_ramp
    for k in range(n):
        angle = y[THETA] + 2.0 * math.pi * k / n
        delayed = (angle - plate.phi_commutation) % (2.0 * math.pi)
        since = delayed % math.pi
        h, u = y[N_SHARED + 2 * n + k], y[N_SHARED + 3 * n + k]
        arm = lever(piston, h, cos_alpha, t, math.cos(angle))
        rise = dt * (cos_alpha * (u - piston.R * t * math.sin(angle) * y[OMEGA]) + arm * y[ALPHA_DOT])
        moved, height = abs(rise), max(h, _THIN)
        blow = blow or -rise > _BLOW_SHARE * height
        near = h - moved < slipper.h_min + _NEAR or h + moved > slipper.h_retainer - _NEAR
        near = near and moved > _AT_REST
        slams = moved > _SLAM_SHARE * height or delayed < last or delayed > first + math.pi
        busy = near or since < last or since > first or moved > _QUIET_SHARE * height
        ch[k, SUBSTEPS] = most if slams else (many if busy else 1.0)
    return blow


@compiled
def eliminate_lifted(
    pump: Pump, scene: Scene, y: Vector, n: int, dt: float, clearances: Matrix, ch: Matrix, A: Matrix, b: Vector
) -> None:
    """Every piston's unknowns by P_d', P_c' and the tilt rate; their flows and torques into A and b."""
    piston, slipper = pump.piston, pump.slipper
    t = math.tan(y[ALPHA])
    S_back = scene.S_eq + (1.0 - slipper.pumped_repair) * (scene.A_outer - scene.S_eq)
    A_p = 0.25 * math.pi * piston.d_p**2
    for k in range(n):
        row = ch[k]
        volume = lifted_volume(piston, scene.t_max, t, row[COS], y[N_SHARED + 2 * n + k])
        row[MASS] = row[DENSITY] * volume
        _glide(pump, scene, y, n, k, dt, clearances[k, 0], clearances[k, 1], t, row)
        for j in range(4):
            into_d = row[_TO_D + j]
            into_c = row[_LAND + j] + row[_RING + j] + S_back * row[_LIFT + j] - A_p * row[_SPEED + j]
            torque = row[_PUSH + j]
            if j == 0:
                b[0] += into_d
                b[1] += into_c
                b[5] += torque
            else:
                column = 0 if j == 1 else (1 if j == 2 else 5)
                A[0, column] -= into_d
                A[1, column] -= into_c
                A[5, column] -= torque


@compiled
def _glide(
    pump: Pump,
    scene: Scene,
    y: Vector,
    n: int,
    k: int,
    dt: float,
    clearance: float,
    wear: float,
    t: float,
    row: Vector,
) -> None:
    """One piston through its substeps, the shared states standing at the step's end: affine results into ``row``.

    An affine quantity is four numbers: constant, by P_d', by P_c', by the tilt rate.
    """
    piston, slipper, plate, medium = pump.piston, pump.slipper, pump.port_plate, scene.medium
    A_p = 0.25 * math.pi * piston.d_p**2
    S = scene.S_eq
    extra = (1.0 - slipper.pumped_repair) * (scene.A_outer - S)
    cos_alpha = 1.0 / math.sqrt(1.0 + t * t)
    P_d, P_c, w_old, omega = y[P_D], y[P_C], y[ALPHA_DOT], y[OMEGA]
    i = N_SHARED + k
    for j in range(52):
        row[FIRST_SCRATCH + j] = 0.0
    P, P_p, h, u = y[i], y[i + n], y[i + 2 * n], y[i + 3 * n]
    row[_P], row[_Q], row[_H], row[_U] = P, P_p, h, u
    n_sub = int(row[SUBSTEPS])
    step, per = dt / n_sub, 1.0 / n_sub
    turn = omega * step
    turn_c, turn_s = math.cos(turn), math.sin(turn)
    c, s = row[COS], row[SIN]
    delayed = (y[THETA] + 2.0 * math.pi * k / n + 0.5 * turn - plate.phi_commutation) % (2.0 * math.pi)
    for _ in range(n_sub):
        c_new, s = c * turn_c - s * turn_s, s * turn_c + c * turn_s
        middle = 0.5 * (c + c_new)
        # rate of the gap by rotation alone
        r = cos_alpha * piston.R * t * (c_new - c) / step
        arm_old = lever(piston, h, cos_alpha, t, middle)
        f = film(
            pump, scene, clearance, wear, t, cos_alpha, middle, P, P_p, P_c, h, u, cos_alpha * u + r + arm_old * w_old
        )
        G_d, G_s = port(plate, delayed, P, P_d, scene.P_s, scene.rho)
        delayed += turn
        density = relative_density(medium, P)
        C = relative_compressibility(medium, P) * lifted_volume(piston, scene.t_max, t, c, h) / step
        w_p = relative_density(medium, P_p)
        C_p = relative_compressibility(medium, P_p) * (slipper.V_pocket + S * h) / step
        K_t = f.stiffness * step + f.damping
        D_p = 1.0 / (C_p + f.throttle + f.land)
        Sd = w_p * S * D_p
        # chamber and speed: [m_11 m_12; m_21 m_22] (P', u') = right
        m_11 = C + G_d + G_s + f.throttle + f.ring - f.throttle * f.throttle * D_p
        m_12 = -density * A_p + f.throttle * Sd * cos_alpha
        m_21 = A_p - cos_alpha * S * f.throttle * D_p
        m_22 = piston.m / step + f.held + cos_alpha * cos_alpha * (K_t + S * Sd)
        det = 1.0 / (m_11 * m_22 - m_12 * m_21)
        for j in range(4):
            q = C_p * row[_Q + j]
            r_1 = C * row[_P + j]
            force = -f.stiffness * row[_H + j]
            r_2 = piston.m / step * row[_U + j]
            lift = 0.0
            d_j = c_j = 0.0
            if j == 0:
                q -= w_p * S * r
                r_1 += G_s * scene.P_s - f.drag
                force += f.elastic + f.stiffness * h
                r_2 += cos_alpha * (extra * scene.P_amb - K_t * r)
                lift = r
            elif j == 1:
                r_1 += G_d
                d_j = 1.0
            elif j == 2:
                q += f.land
                r_1 += f.ring
                r_2 += A_p - cos_alpha * (S + extra)
                c_j = 1.0
            else:
                q -= w_p * S * f.arm
                r_2 -= cos_alpha * K_t * f.arm
                lift = f.arm
            q *= D_p
            r_1 += f.throttle * q
            r_2 += cos_alpha * (S * q + force)
            P_j = (r_1 * m_22 - m_12 * r_2) * det
            u_j = (m_11 * r_2 - m_21 * r_1) * det
            q_j = q + f.throttle * D_p * P_j - Sd * cos_alpha * u_j
            lift += cos_alpha * u_j
            push = S * (q_j - c_j) + force - K_t * lift
            row[_P + j], row[_U + j], row[_Q + j] = P_j, u_j, q_j
            row[_H + j] += step * lift
            row[_TO_D + j] += per * G_d * (P_j - d_j)
            row[_FROM_S + j] -= per * G_s * P_j
            row[_THROTTLED + j] += per * f.throttle * (P_j - q_j)
            row[_RING + j] += per * f.ring * (P_j - c_j)
            row[_LAND + j] += per * f.land * (q_j - c_j)
            row[_LIFT + j] += per * lift
            row[_SPEED + j] += per * u_j
            row[_PUSH + j] += per * f.arm * push
            row[_WORK + j] -= per * push * r
        row[_FROM_S] += per * G_s * scene.P_s
        row[_RING] += per * f.drag
        c = c_new
        P = row[_P] + row[_P + 1] * P_d + row[_P + 2] * P_c + row[_P + 3] * w_old
        P_p = row[_Q] + row[_Q + 1] * P_d + row[_Q + 2] * P_c + row[_Q + 3] * w_old
        h = row[_H] + row[_H + 1] * P_d + row[_H + 2] * P_c + row[_H + 3] * w_old
        u = row[_U] + row[_U + 1] * P_d + row[_U + 2] * P_c + row[_U + 3] * w_old
    row[_COS_NEW] = c


@compiled
def _at(row: Vector, first: int, P_d: float, P_c: float, w: float) -> float:
    return float(row[first] + row[first + 1] * P_d + row[first + 2] * P_c + row[first + 3] * w)


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
    to_discharge = leaked = power = drawn = slipped = 0.0
    for k in range(n):
        row, i = ch[k], N_SHARED + k
        q_d, q_s = _at(row, _TO_D, P_d, P_c, w_new), _at(row, _FROM_S, P_d, P_c, w_new)
        q_t, q_r = _at(row, _THROTTLED, P_d, P_c, w_new), _at(row, _RING, P_d, P_c, w_new)
        q_h = _at(row, _LAND, P_d, P_c, w_new)
        pocket = relative_density(scene.medium, y[i + n]) * (slipper.V_pocket + scene.S_eq * y[i + 2 * n])
        h_old, h = y[i + 2 * n], _at(row, _H, P_d, P_c, w_new)
        mass = row[MASS] + dt * (q_s - q_d - q_t - q_r)
        row[MASS] = mass
        pocket += dt * (q_t - q_h)
        row[POCKET] = pocket
        P, P_p = _at(row, _P, P_d, P_c, w_new), _at(row, _Q, P_d, P_c, w_new)
        y[i] = pressure(scene.medium, mass / lifted_volume(piston, scene.t_max, t_new, row[_COS_NEW], h), P)
        y[i + n] = pressure(scene.medium, pocket / (slipper.V_pocket + scene.S_eq * h), P_p)
        y[i + 2 * n], y[i + 3 * n] = h, _at(row, _U, P_d, P_c, w_new)
        # what slipper and piston displace in the case, from where they stand: the chamber's volume is told likewise
        rise = h - h_old
        stroke = h * math.sqrt(1.0 + t_new * t_new) - h_old * math.sqrt(1.0 + t * t)
        stroke -= piston.R * (t_new * row[_COS_NEW] - t * row[COS])
        to_discharge += q_d
        leaked += q_h + q_r + (S_back * rise - A_p * stroke) / dt
        drawn += q_s
        slipped += q_h
        power += _at(row, _WORK, P_d, P_c, w_new)
    flows[Q_SUCTION], flows[TORQUE], flows[Q_SLIPPER] = drawn, power / y[OMEGA], slipped
    return to_discharge, leaked


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
        P, P_p, h, u = y[i], y[i + n], y[i + 2 * n], y[i + 3 * n]
        c = ch[k, COS]
        arm = lever(piston, h, cos_alpha, t, c)
        h_dot = cos_alpha * (u - piston.R * t * ch[k, SIN] * omega) + arm * w
        f = film(pump, scene, clearances[k, 0], clearances[k, 1], t, cos_alpha, c, P, P_p, P_c, h, u, h_dot)
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
