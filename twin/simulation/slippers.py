"""Chambers with variable slipper gaps: piston and slipper are one moving body, its pocket a volume of its own.

Per piston the unknowns are chamber pressure, pocket pressure, gap and the piston's speed u along its bore; they couple
to P_d, P_c and the tilt rate only and are eliminated together. Speeds are linearly implicit through contact and film.
A slipper that slams down, strikes the retainer or changes its kidney takes substeps of its own.
"""

import math

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled
from twin.laws.compressibility import P_FLOOR, density_and_slope, pressure_of, relative_density
from twin.parameters import Pump
from twin.parts.slipper import lever
from twin.simulation.filling import port
from twin.simulation.film import Motion, Stance, film, lifted_volume
from twin.simulation.layout import (
    ALPHA,
    ALPHA_DOT,
    BY_C,
    BY_D,
    BY_W,
    COS,
    DENSITY,
    FIRST_SCRATCH,
    MASS,
    N_SHARED,
    N_VOLUMES,
    OF_PISTON,
    OF_SLIPPER,
    OMEGA,
    P_C,
    P_D,
    POCKET,
    Q_SLIPPER,
    Q_SUCTION,
    SIN,
    SUBSTEPS,
    THETA,
    TILT_RATE,
    TORQUE,
)
from twin.simulation.scene import Scene
from twin.simulation.turning import Pose

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

(_P, _U, _Q, _H, _TO_D, _FROM_S, _THROTTLED, _RING, _LAND, _LIFT, _SPEED, _PUSH, _WORK) = range(
    FIRST_SCRATCH, FIRST_SCRATCH + 52, 4
)
"""Affine results of a step: ends of chamber pressure, speed, pocket pressure, gap; means of the flows to discharge, from
suction, through throttle, ring and land, of the gap's rate, the piston's speed, the push on the plate, its power."""
_COS_NEW = FIRST_SCRATCH + 52
_FINE_STEP, _FINEST_STEP = 1.0e-6, 0.25e-6
"""Substeps of a slipper that is busy, and of one that slams down on the plate within some tens of microseconds [s]."""
_BUSY_OPENING = 0.35
"""Share of the opening ramp after which a chamber has changed its pressure."""
_QUIET_SHARE, _SLAM_SHARE, _BLOW_SHARE = 0.02, 0.2, 0.1
"""Shares of the gap that a quiet slipper may move in a step, from which on it slams, and falls towards a blow."""
_NEAR, _AT_REST, _THIN = 0.5e-6, 0.05e-6, 5.0e-6
"""Distance from plate or retainer at which contact is near, travel in a step of a slipper that rests there, and gap below
which the film holds a slipper whatever strikes it [m]."""

_LOW = 1.0e6
"""Pressure of chamber or pocket below which a cavity may open within a substep [Pa]."""


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
        _glide(pump, scene, y, n, k, dt, clearances[k, OF_PISTON], clearances[k, OF_SLIPPER], t, row)
        for j in range(4):
            into_d = row[_TO_D + j]
            into_c = row[_LAND + j] + row[_RING + j] + S_back * row[_LIFT + j] - A_p * row[_SPEED + j]
            torque = row[_PUSH + j]
            if j == 0:
                b[P_D] += into_d
                b[P_C] += into_c
                b[TILT_RATE] += torque
            else:
                column = P_D if j == BY_D else (P_C if j == BY_C else TILT_RATE)
                A[P_D, column] -= into_d
                A[P_C, column] -= into_c
                A[TILT_RATE, column] -= torque


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
    step, per, per_step = dt / n_sub, 1.0 / n_sub, n_sub / dt
    turn = omega * step
    turn_c, turn_s = math.cos(turn), math.sin(turn)
    c, s = row[COS], row[SIN]
    delayed = (y[THETA] + 2.0 * math.pi * k / n + 0.5 * turn - plate.phi_commutation) % (2.0 * math.pi)
    for _ in range(n_sub):
        c_new, s = c * turn_c - s * turn_s, s * turn_c + c * turn_s
        middle = 0.5 * (c + c_new)
        # rate of the gap by rotation alone
        r = cos_alpha * piston.R * t * (c_new - c) * per_step
        arm_old = lever(piston, h, cos_alpha, t, middle)
        stance = Stance(clearance, wear, t, cos_alpha, middle)
        # passages see the floor where a cavity stands open
        motion = Motion(max(P, P_FLOOR), max(P_p, P_FLOOR), P_c, h, u, cos_alpha * u + r + arm_old * w_old)
        f = film(pump, scene, stance, motion)
        G_d, G_s = port(plate, delayed, P, P_d, scene.P_s, scene.rho)
        delayed += turn
        density, capacity = density_and_slope(medium, P)
        C = capacity * lifted_volume(piston, scene.t_max, t, c, h) * per_step
        w_p, capacity = density_and_slope(medium, P_p)
        C_p = capacity * (slipper.V_pocket + S * h) * per_step
        K_t = f.stiffness * step + f.damping
        D_p = 1.0 / (C_p + f.throttle + f.land)
        Sd = w_p * S * D_p
        # chamber and speed: [m_11 m_12; m_21 m_22] (P', u') = right
        m_11 = C + G_d + G_s + f.throttle + f.ring - f.throttle * f.throttle * D_p
        m_12 = -density * A_p + f.throttle * Sd * cos_alpha
        m_21 = A_p - cos_alpha * S * f.throttle * D_p
        m_22 = piston.m / step + f.held + cos_alpha * cos_alpha * (K_t + S * Sd)
        det = 1.0 / (m_11 * m_22 - m_12 * m_21)
        empty = dry = False
        if P < _LOW or P_p < _LOW:
            # a cavity opens where the step would end below the floor, as in a chamber with a constant gap
            shift = r + f.arm * w_old
            q = (C_p * P_p + f.land * P_c - w_p * S * shift) * D_p
            r_1 = C * P + G_s * scene.P_s + G_d * P_d + f.ring * P_c - f.drag + f.throttle * q
            push = S * (q - P_c) + extra * (scene.P_amb - P_c) + f.elastic - K_t * shift
            r_2 = piston.m / step * u + A_p * P_c + cos_alpha * push
            ended = (r_1 * m_22 - m_12 * r_2) * det
            empty = ended < P_FLOOR
            moving = (m_11 * r_2 - m_21 * r_1) * det
            dry = q + f.throttle * D_p * ended - Sd * cos_alpha * moving < P_FLOOR
            if dry:
                D_p = Sd = 0.0
                m_11 = C + G_d + G_s + f.throttle + f.ring
                m_12, m_21 = -density * A_p, A_p
                m_22 = piston.m / step + f.held + cos_alpha * cos_alpha * K_t
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
            elif j == BY_D:
                r_1 += G_d
                d_j = 1.0
            elif j == BY_C:
                q += f.land
                r_1 += f.ring
                r_2 += A_p - cos_alpha * (S + extra)
                c_j = 1.0
            else:
                q -= w_p * S * f.arm
                r_2 -= cos_alpha * K_t * f.arm
                lift = f.arm
            floor = P_FLOOR if j == 0 else 0.0
            q = floor if dry else q * D_p
            r_1 += f.throttle * q
            r_2 += cos_alpha * (S * q + force)
            P_j = (r_1 * m_22 - m_12 * r_2) * det
            u_j = (m_11 * r_2 - m_21 * r_1) * det
            if empty:
                P_j, u_j = floor, (r_2 - m_21 * floor) / m_22
            q_j = q + f.throttle * D_p * P_j - Sd * cos_alpha * u_j
            lift += cos_alpha * u_j
            push = S * (q_j - c_j) + force - K_t * lift
            row[_U + j] = u_j
            if empty:
                # the state counts what is missing
                into = r_1 - f.throttle * q - C * row[_P + j] + f.throttle * q_j + density * A_p * u_j
                row[_P + j] += (into - (G_d + G_s + f.throttle + f.ring) * P_j) / C
            else:
                row[_P + j] = P_j
            if dry:
                row[_Q + j] += (f.throttle * (P_j - q_j) - f.land * (q_j - c_j) - w_p * S * lift) / C_p
            else:
                row[_Q + j] = q_j
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
        P = row[_P] + row[_P + BY_D] * P_d + row[_P + BY_C] * P_c + row[_P + BY_W] * w_old
        P_p = row[_Q] + row[_Q + BY_D] * P_d + row[_Q + BY_C] * P_c + row[_Q + BY_W] * w_old
        h = row[_H] + row[_H + BY_D] * P_d + row[_H + BY_C] * P_c + row[_H + BY_W] * w_old
        u = row[_U] + row[_U + BY_D] * P_d + row[_U + BY_C] * P_c + row[_U + BY_W] * w_old
    row[_COS_NEW] = c


@compiled
def _at(row: Vector, first: int, P_d: float, P_c: float, w: float) -> float:
    return float(row[first] + row[first + BY_D] * P_d + row[first + BY_C] * P_c + row[first + BY_W] * w)


@compiled
def update_lifted(
    pump: Pump, scene: Scene, y: Vector, n: int, dt: float, ch: Matrix, b: Vector, t_new: float, flows: Vector
) -> tuple[float, float]:
    """New pressures, gaps and speeds; returns flow to discharge and into the case [m3/s]."""
    piston, slipper = pump.piston, pump.slipper
    P_d, P_c, w_new = b[P_D], b[P_C], b[TILT_RATE]
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
        y[i] = pressure_of(scene.medium, mass, lifted_volume(piston, scene.t_max, t_new, row[_COS_NEW], h), P)
        y[i + n] = pressure_of(scene.medium, pocket, slipper.V_pocket + scene.S_eq * h, P_p)
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
def set_pressures(pump: Pump, scene: Scene, pose: Pose, held: Vector, y: Vector, n: int) -> None:
    """Pressures of chambers and pockets by the fluid that they hold, behind N_VOLUMES, into ``y``, which holds guesses."""
    t, c, s = pose
    for k in range(n):
        i = N_SHARED + k
        h = y[i + 2 * n]
        volume = lifted_volume(pump.piston, scene.t_max, t, c, h)
        y[i] = pressure_of(scene.medium, held[N_VOLUMES + k], volume, y[i])
        y[i + n] = pressure_of(scene.medium, held[N_VOLUMES + n + k], pump.slipper.V_pocket + scene.S_eq * h, y[i + n])
        c, s = c * scene.pitch_c - s * scene.pitch_s, s * scene.pitch_c + c * scene.pitch_s
