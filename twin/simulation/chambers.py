"""Chambers with constant slipper gaps: passages, elimination from the shared system, update by mass.

A chamber couples to P_d, P_c and the tilt rate only. Where its pressure has fallen below ``P_FLOOR`` a cavity is
open: passages see the floor, and the state counts the missing mass until it is filled again.
"""

import math

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled, inlined
from twin.laws.compressibility import P_FLOOR, Medium, density_and_slope, pressure_of
from twin.laws.fluid import Film, film_fluidity
from twin.laws.orifice import smooth_orifice_conductance
from twin.parameters import Piston, PortPlate, Pump
from twin.parts.piston import chamber_volume, volume_by_tilt, volume_rate_by_rotation
from twin.parts.port_plate import window
from twin.parts.slipper import throttled_conductance
from twin.simulation.layout import (
    ALPHA,
    ALPHA_DOT,
    CAPACITY,
    COS,
    DENSITY,
    DRAG,
    FIRST_SCRATCH,
    G_D,
    G_L,
    G_LAND,
    G_RING,
    G_S,
    MASS,
    N_SHARED,
    OMEGA,
    P_C,
    P_D,
    Q_SLIPPER,
    Q_SUCTION,
    ROTATION,
    SIN,
    THETA,
    TILT,
    TORQUE,
    VOLUME,
)
from twin.simulation.scene import Scene

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

_P_END, _TO_D, _FROM_S, _TO_C, _MEAN = range(FIRST_SCRATCH, FIRST_SCRATCH + 20, 4)
_COS_NEW = FIRST_SCRATCH + 20
_SLIPPED = FIRST_SCRATCH + 21
_FILLS = FIRST_SCRATCH + 22
_FILLING = 0.25
"""Share of the opening ramp after which a chamber is full."""


@inlined
def volumes(pump: Pump, scene: Scene, y: Vector, n: int, t: float, ch: Matrix) -> None:
    """Angle, volume and fluid of every chamber: what both kinds of slipper share."""
    piston = pump.piston
    theta, omega = y[THETA], y[OMEGA]
    # the next piston's angle by rotation: one sine and cosine for all of them
    c, s = math.cos(theta), math.sin(theta)
    turn_c, turn_s = math.cos(2.0 * math.pi / n), math.sin(2.0 * math.pi / n)
    for k in range(n):
        ch[k, COS], ch[k, SIN] = c, s
        ch[k, VOLUME] = chamber_volume(piston, scene.t_max, t, c)
        ch[k, ROTATION] = volume_rate_by_rotation(piston, t, s, omega)
        ch[k, TILT] = volume_by_tilt(piston, t, c)
        ch[k, DENSITY], ch[k, CAPACITY] = density_and_slope(scene.medium, y[N_SHARED + k])
        c, s = c * turn_c - s * turn_s, s * turn_c + c * turn_s


@inlined
def port(plate: PortPlate, delayed: float, P: float, P_d: float, P_s: float, rho: float) -> tuple[float, float]:
    """Conductances of a chamber to discharge and suction at an angle past the delayed dead centre [m3/s/Pa]."""
    if delayed >= 2.0 * math.pi:
        delayed -= 2.0 * math.pi
    P = max(P, P_FLOOR)
    if delayed < math.pi:
        area = plate.C_q * window(plate, delayed)
        return (smooth_orifice_conductance(P - P_d, area, rho, plate.dP_laminar) if area > 0.0 else 0.0), 0.0
    area = plate.C_q * window(plate, delayed - math.pi)
    return 0.0, (smooth_orifice_conductance(P - P_s, area, rho, plate.dP_laminar) if area > 0.0 else 0.0)


@inlined
def ports(pump: Pump, scene: Scene, y: Vector, n: int, ch: Matrix) -> None:
    """Conductances of every chamber to discharge and suction at a state; a step takes them as they stand in its middle."""
    delayed = (y[THETA] - pump.port_plate.phi_commutation) % (2.0 * math.pi)
    for k in range(n):
        P = y[N_SHARED + k]
        ch[k, G_D], ch[k, G_S] = port(pump.port_plate, delayed, P, y[P_D], scene.P_s, scene.rho)
        delayed += 2.0 * math.pi / n
        if delayed >= 2.0 * math.pi:
            delayed -= 2.0 * math.pi


@inlined
def constant_gaps(pump: Pump, scene: Scene, y: Vector, n: int, clearances: Matrix, t: float, ch: Matrix) -> None:
    """Leakage of every piston and slipper; ``clearances`` (n, 2) are factors on each one's gap height."""
    piston, slipper = pump.piston, pump.slipper
    P_c, omega = y[P_C], y[OMEGA]
    land = scene.land * slipper.h**3
    K = scene.throttle
    for k in range(n):
        P = max(y[N_SHARED + k], P_FLOOR)
        fluidity = film_fluidity(scene.film, P, P_c)
        b, h = clearances[k, 0], clearances[k, 1]
        G = land * h * h * h * fluidity
        ch[k, G_LAND] = scene.slipper_scale * throttled_conductance(P - P_c, K, G)
        ring = scene.piston_scale * scene.ring * b * b * b
        ch[k, G_RING] = ring * fluidity / (piston.l_mean - piston.R * t * ch[k, COS])
        ch[k, G_L] = ch[k, G_LAND] + ch[k, G_RING]
        ch[k, DRAG] = -scene.ring_drag * b * piston.R * t * ch[k, SIN] * omega


@inlined
def eliminate(
    pump: Pump,
    scene: Scene,
    y: Vector,
    n: int,
    dt: float,
    n_sub: int,
    clearances: Matrix,
    ch: Matrix,
    A: Matrix,
    b: Vector,
) -> None:
    """Chambers as affine functions of P_d', P_c' and the tilt rate; their flows and torques into A and b.

    A chamber fills within three degrees of its port's opening: it takes ``n_sub`` substeps there and one step
    elsewhere. An affine quantity is four numbers: constant, by P_d', by P_c', by alpha_dot'.
    """
    piston, plate = pump.piston, pump.port_plate
    t = math.tan(y[ALPHA])
    P_d, P_c, w_old, P_s = y[P_D], y[P_C], y[ALPHA_DOT], scene.P_s
    turn, per_dt = y[OMEGA] * dt, 1.0 / dt
    turn_c, turn_s = math.cos(turn), math.sin(turn)
    busy = plate.phi_seal + _FILLING * plate.phi_ramp
    area_R = 0.25 * math.pi * piston.d_p**2 * piston.R
    land = scene.slipper_scale, scene.land * pump.slipper.h**3, scene.throttle
    ring = scene.piston_scale * scene.ring
    pitch = 2.0 * math.pi / n
    delayed = (y[THETA] - plate.phi_commutation) % (2.0 * math.pi)
    A_00 = A_01 = A_05 = A_10 = A_11 = A_15 = A_50 = A_51 = A_55 = b_0 = b_1 = b_5 = 0.0
    for k in range(n):
        P = y[N_SHARED + k]
        c_new = ch[k, COS] * turn_c - ch[k, SIN] * turn_s
        ch[k, _COS_NEW] = c_new
        ch[k, MASS] = ch[k, DENSITY] * ch[k, VOLUME]
        # torque arm and volume rate as they are in the middle of the step
        tilt = area_R * (1.0 + t * t) * 0.5 * (ch[k, COS] + c_new)
        ch[k, ROTATION] = area_R * t * (c_new - ch[k, COS]) * per_dt
        since = delayed if delayed < math.pi else delayed - math.pi
        if since < busy and n_sub > 1:
            ch[k, _FILLS] = 1.0
            ends = clearances[k, 0], clearances[k, 1], delayed, tilt, t, area_R
            fill(
                piston,
                plate,
                scene.medium,
                ends,
                land,
                scene.film,
                ring,
                scene.rho,
                P_s,
                P_d,
                P_c,
                w_old,
                P,
                turn,
                dt,
                n_sub,
                ch[k],
            )
            b_0 += ch[k, _TO_D]
            A_00 -= ch[k, _TO_D + 1]
            A_01 -= ch[k, _TO_D + 2]
            A_05 -= ch[k, _TO_D + 3]
            b_1 += ch[k, _TO_C]
            A_10 -= ch[k, _TO_C + 1]
            A_11 -= ch[k, _TO_C + 2]
            A_15 -= ch[k, _TO_C + 3]
            b_5 += tilt * ch[k, _MEAN]
            A_50 -= tilt * ch[k, _MEAN + 1]
            A_51 -= tilt * (ch[k, _MEAN + 2] - 1.0)
            A_55 -= tilt * ch[k, _MEAN + 3]
        else:
            ch[k, _FILLS] = 0.0
            G_d, G_s = port(plate, delayed + 0.5 * turn, P, P_d, P_s, scene.rho)
            ch[k, G_D], ch[k, G_S] = G_d, G_s
            G_l, drag = ch[k, G_L], ch[k, DRAG]
            C = ch[k, CAPACITY] * ch[k, VOLUME] * per_dt
            D = 1.0 / (C + G_d + G_s + G_l)
            grow = ch[k, DENSITY] * tilt
            forced = C * P + G_s * P_s - drag - ch[k, DENSITY] * ch[k, ROTATION]
            a_0, a_d, a_c, a_w = forced * D, G_d * D, G_l * D, -grow * D
            if a_0 + a_d * P_d + a_c * P_c + a_w * w_old < P_FLOOR:
                # a cavity: passages see the floor, the state counts what is missing
                a_0, a_d, a_c, a_w = P_FLOOR, 0.0, 0.0, 0.0
            ch[k, _P_END], ch[k, _P_END + 1], ch[k, _P_END + 2], ch[k, _P_END + 3] = a_0, a_d, a_c, a_w
            A_00 += G_d * (1.0 - a_d)
            A_01 -= G_d * a_c
            A_05 -= G_d * a_w
            b_0 += G_d * a_0
            A_10 -= G_l * a_d
            A_11 += G_l * (1.0 - a_c)
            A_15 -= G_l * a_w
            b_1 += G_l * a_0 + drag
            A_50 -= tilt * a_d
            A_51 += tilt * (1.0 - a_c)
            A_55 -= tilt * a_w
            b_5 += tilt * a_0
        delayed += pitch
        if delayed >= 2.0 * math.pi:
            delayed -= 2.0 * math.pi
    A[0, 0] += A_00
    A[0, 1] += A_01
    A[0, 5] += A_05
    A[1, 0] += A_10
    A[1, 1] += A_11
    A[1, 5] += A_15
    A[5, 0] += A_50
    A[5, 1] += A_51
    A[5, 5] += A_55
    b[0] += b_0
    b[1] += b_1
    b[5] += b_5


@compiled
def fill(
    piston: Piston,
    plate: PortPlate,
    m: Medium,
    ends: tuple[float, float, float, float, float, float],
    land: tuple[float, float, float],
    film: Film,
    ring: float,
    rho: float,
    P_s: float,
    P_d: float,
    P_c: float,
    w_old: float,
    P: float,
    turn: float,
    dt: float,
    n_sub: int,
    row: Vector,
) -> None:
    """A chamber through ``n_sub`` substeps, the shared states standing at the step's end: affine results into ``row``.

    ``ends`` are clearance factors of piston and slipper, angle past the delayed dead centre, torque arm, tan(alpha),
    area times R; ``land`` scale, coefficient and throttle.
    """
    gap_b, gap_h, angle, tilt, t, area_R = ends
    t_max = (row[VOLUME] - piston.V_dead) / area_R - t * row[COS]
    drag, G_l, G_h = row[DRAG], row[G_L], row[G_LAND]
    p_0, p_d, p_c, p_w = P, 0.0, 0.0, 0.0
    d_0 = d_d = d_c = d_w = s_0 = s_d = s_c = s_w = l_0 = l_d = l_c = l_w = m_0 = m_d = m_c = m_w = h_0 = 0.0
    per, per_h = 1.0 / n_sub, n_sub / dt
    step_c, step_s = math.cos(turn * per), math.sin(turn * per)
    guess, c, sn, volume = P, row[COS], row[SIN], row[VOLUME]
    density, capacity = row[DENSITY], row[CAPACITY]
    angle += 0.5 * turn * per
    for _ in range(n_sub):
        G_d, G_s = port(plate, angle, guess, P_d, P_s, rho)
        angle += turn * per
        c, sn = c * step_c - sn * step_s, sn * step_c + c * step_s
        turned = piston.V_dead + area_R * (t_max + t * c)
        C = capacity * volume * per_h
        D = 1.0 / (C + G_d + G_s + G_l)
        forced = G_s * P_s - drag - density * (turned - volume) * per_h
        if (C * guess + forced + G_d * P_d + G_l * P_c - density * tilt * w_old) * D >= P_FLOOR:
            p_0, p_d, p_c, p_w = (
                (C * p_0 + forced) * D,
                (C * p_d + G_d) * D,
                (C * p_c + G_l) * D,
                (C * p_w - density * tilt) * D,
            )
            e_0, e_d, e_c, e_w = p_0, p_d, p_c, p_w
        else:
            e_0, e_d, e_c, e_w = P_FLOOR, 0.0, 0.0, 0.0
            p_0 += (forced - (G_d + G_s + G_l) * P_FLOOR) / C
            p_d += G_d / C
            p_c += G_l / C
            p_w -= density * tilt / C
        guess = p_0 + p_d * P_d + p_c * P_c + p_w * w_old
        d_0 += G_d * e_0
        d_d += G_d * (e_d - 1.0)
        d_c += G_d * e_c
        d_w += G_d * e_w
        s_0 += G_s * (P_s - e_0)
        s_d -= G_s * e_d
        s_c -= G_s * e_c
        s_w -= G_s * e_w
        l_0 += G_l * e_0
        l_d += G_l * e_d
        l_c += G_l * (e_c - 1.0)
        l_w += G_l * e_w
        m_0 += e_0
        m_d += e_d
        m_c += e_c
        m_w += e_w
        h_0 += G_h * (guess - P_c)
        volume = turned
        density, capacity = density_and_slope(m, guess)
        dP = max(guess - P_c, 0.0)
        fluidity = film_fluidity(film, guess, P_c)
        G_h = land[0] * throttled_conductance(dP, land[2], land[1] * gap_h * gap_h * gap_h * fluidity)
        G_l = G_h + ring * gap_b * gap_b * gap_b * fluidity / (piston.l_mean - piston.R * t * c)
    row[_P_END], row[_P_END + 1], row[_P_END + 2], row[_P_END + 3] = p_0, p_d, p_c, p_w
    row[_TO_D], row[_TO_D + 1], row[_TO_D + 2], row[_TO_D + 3] = d_0 * per, d_d * per, d_c * per, d_w * per
    row[_FROM_S], row[_FROM_S + 1], row[_FROM_S + 2], row[_FROM_S + 3] = s_0 * per, s_d * per, s_c * per, s_w * per
    row[_TO_C], row[_TO_C + 1], row[_TO_C + 2], row[_TO_C + 3] = l_0 * per + drag, l_d * per, l_c * per, l_w * per
    row[_MEAN], row[_MEAN + 1], row[_MEAN + 2], row[_MEAN + 3] = m_0 * per, m_d * per, m_c * per, m_w * per
    row[_SLIPPED] = h_0 * per


@inlined
def update(
    pump: Pump, scene: Scene, y: Vector, n: int, dt: float, ch: Matrix, b: Vector, t_new: float, flows: Vector
) -> tuple[float, float]:
    """New pressures by the masses that the solved flows move; returns flow to discharge and into the case [m3/s].

    ``y`` still holds the tilt of before; ``b`` is the solution of the shared system.
    """
    P_d, P_c, w_new = b[0], b[1], b[5]
    to_discharge = leaked = torque = drawn = slipped = 0.0
    for k in range(n):
        P = ch[k, _P_END] + ch[k, _P_END + 1] * P_d + ch[k, _P_END + 2] * P_c + ch[k, _P_END + 3] * w_new
        if ch[k, _FILLS] > 0.5:
            q_d = ch[k, _TO_D] + ch[k, _TO_D + 1] * P_d + ch[k, _TO_D + 2] * P_c + ch[k, _TO_D + 3] * w_new
            q_s = ch[k, _FROM_S] + ch[k, _FROM_S + 1] * P_d + ch[k, _FROM_S + 2] * P_c + ch[k, _FROM_S + 3] * w_new
            q_l = ch[k, _TO_C] + ch[k, _TO_C + 1] * P_d + ch[k, _TO_C + 2] * P_c + ch[k, _TO_C + 3] * w_new
            over = ch[k, _MEAN] + ch[k, _MEAN + 1] * P_d + ch[k, _MEAN + 2] * P_c + ch[k, _MEAN + 3] * w_new - P_c
            slipped += ch[k, _SLIPPED]
        else:
            over = P - P_c
            q_d, q_s = ch[k, G_D] * (P - P_d), ch[k, G_S] * (scene.P_s - P)
            q_l = ch[k, G_L] * over + ch[k, DRAG]
            slipped += ch[k, G_LAND] * over
        mass = ch[k, MASS] + dt * (q_s - q_d - q_l)
        ch[k, MASS] = mass
        volume = chamber_volume(pump.piston, scene.t_max, t_new, ch[k, _COS_NEW])
        y[N_SHARED + k] = pressure_of(scene.medium, mass, volume, P)
        to_discharge += q_d
        leaked += q_l
        drawn += q_s
        torque -= over * ch[k, ROTATION]
    flows[Q_SUCTION], flows[TORQUE], flows[Q_SLIPPER] = drawn, torque / y[OMEGA], slipped
    return to_discharge, leaked


@compiled
def chamber_rates(scene: Scene, y: Vector, n: int, ch: Matrix, dy: Vector) -> tuple[float, float, float]:
    """Pressure rates of the chambers into ``dy``; returns flow to discharge, into the case and torque on the plate."""
    P_d, P_c, w = y[P_D], y[P_C], y[ALPHA + 1]
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
