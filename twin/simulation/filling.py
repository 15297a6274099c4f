"""A chamber whose port has just opened: it fills within three degrees and takes substeps of its own."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled, inlined
from twin.laws.compressibility import P_FLOOR, Medium, density_and_slope
from twin.laws.fluid import Film, film_fluidity
from twin.laws.orifice import smooth_orifice_conductance
from twin.parameters import Piston, PortPlate
from twin.parts.port_plate import window
from twin.parts.slipper import throttled_conductance
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
    land, throttle and ring as of ``Scene``.
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


@compiled
def fill(piston: Piston, plate: PortPlate, leaks: Leaks, around: Surroundings, place: Place, row: Vector) -> None:
    """A chamber through its substeps, the shared states standing at the step's end: affine results into ``row``."""
    P_s, P_d, P_c, w_old, t, area_R, turn, dt, n_sub = around
    gap_b, gap_h, angle, tilt, P = place
    rho = leaks.rho
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
        density, capacity = density_and_slope(leaks.medium, guess)
        dP = max(guess - P_c, 0.0)
        fluidity = film_fluidity(leaks.film, guess, P_c)
        land = leaks.land * gap_h * gap_h * gap_h * fluidity
        G_h = leaks.slipper_scale * throttled_conductance(dP, leaks.throttle, land)
        G_l = G_h + leaks.ring * gap_b * gap_b * gap_b * fluidity / (piston.l_mean - piston.R * t * c)
    row[P_END], row[P_END + BY_D], row[P_END + BY_C], row[P_END + BY_W] = p_0, p_d, p_c, p_w
    row[TO_D], row[TO_D + BY_D], row[TO_D + BY_C], row[TO_D + BY_W] = d_0 * per, d_d * per, d_c * per, d_w * per
    row[FROM_S], row[FROM_S + BY_D], row[FROM_S + BY_C], row[FROM_S + BY_W] = (
        s_0 * per,
        s_d * per,
        s_c * per,
        s_w * per,
    )
    row[TO_C], row[TO_C + BY_D], row[TO_C + BY_C], row[TO_C + BY_W] = (
        l_0 * per + drag,
        l_d * per,
        l_c * per,
        l_w * per,
    )
    row[MEAN], row[MEAN + BY_D], row[MEAN + BY_C], row[MEAN + BY_W] = m_0 * per, m_d * per, m_c * per, m_w * per
    row[SLIPPED] = h_0 * per
