"""A chamber whose port has just opened: it fills within three degrees and takes substeps of its own."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled, inlined
from twin.laws.compressibility import P_FLOOR, Medium, density_and_slope
from twin.laws.fluid import Film, relative_fluidity
from twin.laws.orifice import smooth_orifice_conductance
from twin.parameters import Piston, PortPlate
from twin.parts.port_plate import opened_share, window
from twin.parts.slipper import throttled_sum
from twin.simulation.layout import (
    BY_C,
    BY_D,
    BY_W,
    CAPACITY,
    COS,
    DENSITY,
    DRAG,
    FIRST_SCRATCH,
    G_L,
    G_LAND,
    SIN,
    VOLUME,
)
from twin.simulation.turning import small_turn

Vector = NDArray[np.float64]

P_END, TO_D, FROM_S, TO_C, MEAN = range(FIRST_SCRATCH, FIRST_SCRATCH + 20, 4)
"""Affine results of a step: pressure at its end, means of the flows to discharge, from suction, to the case and of the
pressure."""
COS_NEW = FIRST_SCRATCH + 20
SLIPPED = FIRST_SCRATCH + 21
FILLS = FIRST_SCRATCH + 22
"""Cosine at the step's end, mean flow of the slipper, and whether the chamber took substeps."""


class Leaks(NamedTuple):
    """What a chamber is filled with and leaks through: density [kg/m3], scale on the slippers' leakage, coefficients of
    land and ring over the film's viscosity without load, and of the throttle.
    """

    medium: Medium
    film: Film
    rho: float
    slipper_scale: float
    land: float
    throttle: float
    ring: float


class Surroundings(NamedTuple):
    """What every chamber meets in one step: pressures and tilt rate before it, tan(alpha), piston area times pitch radius
    [m3], angle that the shaft turns [rad], length [s] and number of substeps.
    """

    P_s: float
    P_d: float
    P_c: float
    w: float
    t: float
    area_R: float
    turn: float
    dt: float
    n_sub: int


class Place(NamedTuple):
    """What is a chamber's own: factors on the gaps of piston and slipper, angle past the delayed dead centre [rad], torque
    arm in the middle of the step [m3/rad], pressure before it.
    """

    clearance: float
    wear: float
    angle: float
    tilt: float
    P: float


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
def port_coefficient(plate: PortPlate, rho: float) -> float:
    """What a wide open port lets through by the root of a pressure difference [m3/s/Pa^0.5]."""
    return plate.C_q * plate.A_port * math.sqrt(2.0 / rho)


@compiled
def fill(piston: Piston, plate: PortPlate, leaks: Leaks, around: Surroundings, place: Place, row: Vector) -> None:
    """A chamber through its substeps, the shared states standing at the step's end: affine results into ``row``."""
    P_s, P_d, P_c, w_old, t, area_R, turn, dt, n_sub = around
    gap_b, gap_h, angle, tilt, P = place
    rho = leaks.rho
    t_max = (row[VOLUME] - piston.V_dead) / area_R - t * row[COS]
    drag, G_l, G_h = row[DRAG], row[G_L], row[G_LAND]
    p_0, p_d, p_c, p_w = P, 0.0, 0.0, 0.0
    g = g_0 = g_d = g_c = g_w = l_0 = l_d = l_c = l_w = m_0 = m_d = m_c = m_w = h_0 = 0.0
    per, per_h = 1.0 / n_sub, n_sub / dt
    step_c, step_s = small_turn(turn * per)
    # the port has opened a little while ago: no substep leaves its kidney
    delivers = angle < math.pi
    if not delivers:
        angle -= math.pi
    P_port, of_d = (P_d, 1.0) if delivers else (P_s, 0.0)
    from_s = P_s - of_d * P_s
    wide_open, per_ramp = port_coefficient(plate, rho), 1.0 / plate.phi_ramp
    laminar = plate.dP_laminar * plate.dP_laminar
    land_0 = leaks.land * gap_h * gap_h * gap_h
    ring, K_scaled = leaks.ring * gap_b * gap_b * gap_b, 2.0 * leaks.throttle * leaks.slipper_scale
    guess, c, sn, volume = P, row[COS], row[SIN], row[VOLUME]
    density, capacity = row[DENSITY], row[CAPACITY]
    angle += 0.5 * turn * per
    for _ in range(n_sub):
        open_port = wide_open * opened_share(angle, plate.phi_seal, per_ramp)
        dP = max(guess, P_FLOOR) - P_port
        root = math.sqrt(math.sqrt(dP * dP + laminar))
        angle += turn * per
        c, sn = c * step_c - sn * step_s, sn * step_c + c * step_s
        turned = piston.V_dead + area_R * (t_max + t * c)
        C = capacity * volume * per_h
        through = (C + G_l) * root + open_port
        inverse = 1.0 / (root * through)
        D, G = root * root * inverse, open_port * through * inverse
        forced = G * from_s - drag - density * (turned - volume) * per_h
        if (C * guess + forced + of_d * G * P_d + G_l * P_c - density * tilt * w_old) * D >= P_FLOOR:
            p_0, p_d, p_c, p_w = (
                (C * p_0 + forced) * D,
                (C * p_d + of_d * G) * D,
                (C * p_c + G_l) * D,
                (C * p_w - density * tilt) * D,
            )
            e_0, e_d, e_c, e_w = p_0, p_d, p_c, p_w
        else:
            e_0, e_d, e_c, e_w = P_FLOOR, 0.0, 0.0, 0.0
            p_0 += (forced - (G + G_l) * P_FLOOR) / C
            p_d += of_d * G / C
            p_c += G_l / C
            p_w -= density * tilt / C
        guess = p_0 + p_d * P_d + p_c * P_c + p_w * w_old
        g += G
        g_0 += G * e_0
        g_d += G * e_d
        g_c += G * e_c
        g_w += G * e_w
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
        density, capacity = density_and_slope(leaks.medium, guess)
        fluidity = relative_fluidity(leaks.film, guess, P_c)
        land = land_0 * fluidity
        # throttle and land in series (``throttled_conductance``), and the ring, by one division
        series = throttled_sum(max(guess - P_c, 0.0), leaks.throttle, land)
        length = piston.l_mean - piston.R * t * c
        inverse = 1.0 / (length * series)
        G_h = K_scaled * land * length * inverse
        G_l = G_h + ring * fluidity * series * inverse
    row[P_END], row[P_END + BY_D], row[P_END + BY_C], row[P_END + BY_W] = p_0, p_d, p_c, p_w
    to_d, to_s = of_d * per, per - of_d * per
    row[TO_D], row[TO_D + BY_D], row[TO_D + BY_C], row[TO_D + BY_W] = (
        g_0 * to_d,
        (g_d - g) * to_d,
        g_c * to_d,
        g_w * to_d,
    )
    row[FROM_S], row[FROM_S + BY_D], row[FROM_S + BY_C], row[FROM_S + BY_W] = (
        (g * P_s - g_0) * to_s,
        -g_d * to_s,
        -g_c * to_s,
        -g_w * to_s,
    )
    row[TO_C], row[TO_C + BY_D], row[TO_C + BY_C], row[TO_C + BY_W] = (
        l_0 * per + drag,
        l_d * per,
        l_c * per,
        l_w * per,
    )
    row[MEAN], row[MEAN + BY_D], row[MEAN + BY_C], row[MEAN + BY_W] = m_0 * per, m_d * per, m_c * per, m_w * per
    row[SLIPPED] = h_0 * per
