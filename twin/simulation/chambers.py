"""Chambers with constant slipper gaps: passages, elimination from the shared system, update by mass.

A chamber couples to P_d, P_c and the tilt rate only. Where its pressure has fallen below ``P_FLOOR`` a cavity is
open: passages see the floor, and the state counts the missing mass until it is filled again.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.compiled import inlined
from twin.laws.compressibility import P_FLOOR, density_and_slope, pressure_of
from twin.laws.fluid import relative_fluidity
from twin.parameters import Pump
from twin.parts.piston import chamber_volume, volume_by_tilt, volume_rate_by_rotation
from twin.parts.port_plate import opened_share
from twin.parts.slipper import throttled_sum
from twin.simulation.filling import (
    COS_NEW,
    FILLS,
    FROM_S,
    MEAN,
    P_END,
    SLIPPED,
    TO_C,
    TO_D,
    Leaks,
    Place,
    Surroundings,
    fill,
    port,
    port_coefficient,
)
from twin.simulation.layout import (
    ALPHA_DOT,
    BY_C,
    BY_D,
    BY_W,
    CAPACITY,
    COS,
    DENSITY,
    DRAG,
    G_D,
    G_L,
    G_LAND,
    G_RING,
    G_S,
    MASS,
    N_SHARED,
    N_VOLUMES,
    OF_PISTON,
    OF_SLIPPER,
    OMEGA,
    P_C,
    P_D,
    Q_SLIPPER,
    Q_SUCTION,
    ROTATION,
    SIN,
    THETA,
    TILT,
    TILT_RATE,
    TORQUE,
    VOLUME,
)
from twin.simulation.scene import Scene
from twin.simulation.turning import Pose, past_dead_centre, small_turn

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

_FILLING = 0.25
"""Share of the opening ramp after which a chamber is full."""


class Step(NamedTuple):
    """One step: number of pistons, length [s], substeps of a filling chamber, pump's torque at the start [N m], tangent of
    the tilt before it, and whether the states end with the pressures of their masses or with those of the linear system,
    where nothing but the masses is asked for.
    """

    n: int
    dt: float
    n_sub: int
    T_start: float
    t: float
    settled: bool


@inlined
def volumes(pump: Pump, scene: Scene, y: Vector, n: int, pose: Pose, ch: Matrix) -> None:
    """Angle, volume and fluid of every chamber: what both kinds of slipper share."""
    piston = pump.piston
    omega = y[OMEGA]
    # the next piston's angle by rotation: one sine and cosine for all of them
    t, c, s = pose
    turn_c, turn_s = scene.pitch_c, scene.pitch_s
    for k in range(n):
        ch[k, COS], ch[k, SIN] = c, s
        ch[k, VOLUME] = chamber_volume(piston, scene.t_max, t, c)
        ch[k, ROTATION] = volume_rate_by_rotation(piston, t, s, omega)
        ch[k, TILT] = volume_by_tilt(piston, t, c)
        ch[k, DENSITY], ch[k, CAPACITY] = density_and_slope(scene.medium, y[N_SHARED + k])
        c, s = c * turn_c - s * turn_s, s * turn_c + c * turn_s


@inlined
def ports(pump: Pump, scene: Scene, y: Vector, n: int, ch: Matrix) -> None:
    """Conductances of every chamber to discharge and suction at a state; a step takes them as they stand in its middle."""
    delayed = past_dead_centre(y[THETA], pump.port_plate.phi_commutation)
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
    per_mu = 1.0 / scene.film.mu_0
    land = scene.land * slipper.h**3 * per_mu
    ring = scene.piston_scale * scene.ring * per_mu
    K, K_scaled = scene.throttle, 2.0 * scene.throttle * scene.slipper_scale
    for k in range(n):
        P = max(y[N_SHARED + k], P_FLOOR)
        fluidity = relative_fluidity(scene.film, P, P_c)
        b, h = clearances[k, OF_PISTON], clearances[k, OF_SLIPPER]
        G = land * h * h * h * fluidity
        # throttle and land in series (``throttled_conductance``), and the ring, by one division
        length, series = piston.l_mean - piston.R * t * ch[k, COS], throttled_sum(P - P_c, K, G)
        per = 1.0 / (length * series)
        ch[k, G_LAND] = K_scaled * G * length * per
        ch[k, G_RING] = ring * b * b * b * fluidity * series * per
        ch[k, G_L] = ch[k, G_LAND] + ch[k, G_RING]
        ch[k, DRAG] = -scene.ring_drag * b * piston.R * t * ch[k, SIN] * omega


@inlined
def eliminate(
    pump: Pump,
    scene: Scene,
    y: Vector,
    step: Step,
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
    n, dt, n_sub, t = step.n, step.dt, step.n_sub, step.t
    P_d, P_c, w_old, P_s = y[P_D], y[P_C], y[ALPHA_DOT], scene.P_s
    turn, per_dt = y[OMEGA] * dt, 1.0 / dt
    turn_c, turn_s = small_turn(turn)
    busy = plate.phi_seal + _FILLING * plate.phi_ramp
    area_R = 0.25 * math.pi * piston.d_p**2 * piston.R
    leaks = Leaks(
        scene.medium, scene.film, scene.rho, scene.slipper_scale, scene.land * pump.slipper.h**3 / scene.film.mu_0,
        scene.throttle, scene.piston_scale * scene.ring / scene.film.mu_0,
    )  # fmt: skip
    wide_open, per_ramp = port_coefficient(plate, scene.rho), 1.0 / plate.phi_ramp
    laminar = plate.dP_laminar * plate.dP_laminar
    around = Surroundings(P_s, P_d, P_c, w_old, t, area_R, turn, dt, n_sub)
    pitch = 2.0 * math.pi / n
    delayed = past_dead_centre(y[THETA], plate.phi_commutation)
    A_dd = A_dc = A_dw = A_cd = A_cc = A_cw = A_wd = A_wc = A_ww = b_d = b_c = b_w = 0.0
    for k in range(n):
        P = y[N_SHARED + k]
        c_new = ch[k, COS] * turn_c - ch[k, SIN] * turn_s
        ch[k, COS_NEW] = c_new
        ch[k, MASS] = ch[k, DENSITY] * ch[k, VOLUME]
        # torque arm and volume rate as they are in the middle of the step
        tilt = area_R * (1.0 + t * t) * 0.5 * (ch[k, COS] + c_new)
        ch[k, ROTATION] = area_R * t * (c_new - ch[k, COS]) * per_dt
        since = delayed if delayed < math.pi else delayed - math.pi
        if since < busy and n_sub > 1:
            ch[k, FILLS] = 1.0
            place = Place(clearances[k, OF_PISTON], clearances[k, OF_SLIPPER], delayed, tilt, P)
            fill(piston, plate, leaks, around, place, ch[k])
            b_d += ch[k, TO_D]
            A_dd -= ch[k, TO_D + BY_D]
            A_dc -= ch[k, TO_D + BY_C]
            A_dw -= ch[k, TO_D + BY_W]
            b_c += ch[k, TO_C]
            A_cd -= ch[k, TO_C + BY_D]
            A_cc -= ch[k, TO_C + BY_C]
            A_cw -= ch[k, TO_C + BY_W]
            b_w += tilt * ch[k, MEAN]
            A_wd -= tilt * ch[k, MEAN + BY_D]
            A_wc -= tilt * (ch[k, MEAN + BY_C] - 1.0)
            A_ww -= tilt * ch[k, MEAN + BY_W]
        else:
            ch[k, FILLS] = 0.0
            G_l, drag = ch[k, G_L], ch[k, DRAG]
            C = ch[k, CAPACITY] * ch[k, VOLUME] * per_dt
            # the port as it stands in the middle of the step (``port``), with the elimination by one division
            angle = delayed + 0.5 * turn
            angle = angle - 2.0 * math.pi if angle >= 2.0 * math.pi else angle
            delivers = angle < math.pi
            open_port = wide_open * opened_share(angle if delivers else angle - math.pi, plate.phi_seal, per_ramp)
            over = max(P, P_FLOOR) - (P_d if delivers else P_s)
            root = math.sqrt(math.sqrt(over * over + laminar))
            through = (C + G_l) * root + open_port
            per = 1.0 / (root * through)
            D, G = root * root * per, open_port * through * per
            G_d, G_s = (G, 0.0) if delivers else (0.0, G)
            ch[k, G_D], ch[k, G_S] = G_d, G_s
            grow = ch[k, DENSITY] * tilt
            forced = C * P + G_s * P_s - drag - ch[k, DENSITY] * ch[k, ROTATION]
            a_0, a_d, a_c, a_w = forced * D, G_d * D, G_l * D, -grow * D
            if a_0 + a_d * P_d + a_c * P_c + a_w * w_old < P_FLOOR:
                # a cavity: passages see the floor, the state counts what is missing
                a_0, a_d, a_c, a_w = P_FLOOR, 0.0, 0.0, 0.0
            ch[k, P_END], ch[k, P_END + BY_D], ch[k, P_END + BY_C], ch[k, P_END + BY_W] = a_0, a_d, a_c, a_w
            A_dd += G_d * (1.0 - a_d)
            A_dc -= G_d * a_c
            A_dw -= G_d * a_w
            b_d += G_d * a_0
            A_cd -= G_l * a_d
            A_cc += G_l * (1.0 - a_c)
            A_cw -= G_l * a_w
            b_c += G_l * a_0 + drag
            A_wd -= tilt * a_d
            A_wc += tilt * (1.0 - a_c)
            A_ww -= tilt * a_w
            b_w += tilt * a_0
        delayed += pitch
        if delayed >= 2.0 * math.pi:
            delayed -= 2.0 * math.pi
    A[P_D, P_D] += A_dd
    A[P_D, P_C] += A_dc
    A[P_D, TILT_RATE] += A_dw
    A[P_C, P_D] += A_cd
    A[P_C, P_C] += A_cc
    A[P_C, TILT_RATE] += A_cw
    A[TILT_RATE, P_D] += A_wd
    A[TILT_RATE, P_C] += A_wc
    A[TILT_RATE, TILT_RATE] += A_ww
    b[P_D] += b_d
    b[P_C] += b_c
    b[TILT_RATE] += b_w


@inlined
def update(
    pump: Pump, scene: Scene, y: Vector, step: Step, ch: Matrix, b: Vector, t_new: float, flows: Vector
) -> tuple[float, float]:
    """New pressures by the masses that the solved flows move; returns flow to discharge and into the case [m3/s].

    ``y`` still holds the tilt of before; ``b`` is the solution of the shared system.
    """
    P_d, P_c, w_new = b[P_D], b[P_C], b[TILT_RATE]
    n, dt = step.n, step.dt
    to_discharge = leaked = torque = drawn = slipped = 0.0
    for k in range(n):
        P = ch[k, P_END] + ch[k, P_END + BY_D] * P_d + ch[k, P_END + BY_C] * P_c + ch[k, P_END + BY_W] * w_new
        if ch[k, FILLS] > 0.5:
            q_d = ch[k, TO_D] + ch[k, TO_D + BY_D] * P_d + ch[k, TO_D + BY_C] * P_c + ch[k, TO_D + BY_W] * w_new
            q_s = ch[k, FROM_S] + ch[k, FROM_S + BY_D] * P_d + ch[k, FROM_S + BY_C] * P_c + ch[k, FROM_S + BY_W] * w_new
            q_l = ch[k, TO_C] + ch[k, TO_C + BY_D] * P_d + ch[k, TO_C + BY_C] * P_c + ch[k, TO_C + BY_W] * w_new
            over = ch[k, MEAN] + ch[k, MEAN + BY_D] * P_d + ch[k, MEAN + BY_C] * P_c + ch[k, MEAN + BY_W] * w_new - P_c
            slipped += ch[k, SLIPPED]
        else:
            over = P - P_c
            q_d, q_s = ch[k, G_D] * (P - P_d), ch[k, G_S] * (scene.P_s - P)
            q_l = ch[k, G_L] * over + ch[k, DRAG]
            slipped += ch[k, G_LAND] * over
        mass = ch[k, MASS] + dt * (q_s - q_d - q_l)
        ch[k, MASS] = mass
        if step.settled:
            P = pressure_of(scene.medium, mass, chamber_volume(pump.piston, scene.t_max, t_new, ch[k, COS_NEW]), P)
        y[N_SHARED + k] = P
        to_discharge += q_d
        leaked += q_l
        drawn += q_s
        torque -= over * ch[k, ROTATION]
    flows[Q_SUCTION], flows[TORQUE], flows[Q_SLIPPER] = drawn, torque / y[OMEGA], slipped
    return to_discharge, leaked


@inlined
def set_pressures(pump: Pump, scene: Scene, pose: Pose, held: Vector, y: Vector, n: int) -> None:
    """Pressures of the chambers by the fluid that they hold, behind N_VOLUMES, into ``y``, which holds guesses."""
    t, c, s = pose
    for k in range(n):
        volume = chamber_volume(pump.piston, scene.t_max, t, c)
        y[N_SHARED + k] = pressure_of(scene.medium, held[N_VOLUMES + k], volume, y[N_SHARED + k])
        c, s = c * scene.pitch_c - s * scene.pitch_s, s * scene.pitch_c + c * scene.pitch_s
