"""Passages and forces of one slipper with a variable gap and of its piston, at one state."""

import math
from typing import NamedTuple

from twin.compiled import compiled
from twin.laws.fluid import film_viscosity
from twin.laws.friction import gap_drag
from twin.laws.orifice import smooth_orifice_conductance
from twin.parameters import Piston, Pump
from twin.parts.servo import contact_damping
from twin.parts.slipper import contact, lever
from twin.simulation.scene import Scene

_DP_LAMINAR = 1.0e3
"""Pressure difference below which the throttle counts as laminar [Pa]."""


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


class Stance(NamedTuple):
    """How a slipper stands: factors on the gaps of its piston and of its land, tan and cos of the tilt, cosine of the
    piston's angle.
    """

    clearance: float
    wear: float
    t: float
    cos_alpha: float
    cos_phi: float


class Motion(NamedTuple):
    """State of a slipper and its piston: pressures of chamber, pocket and case [Pa], gap [m], speed of the piston along
    its bore and rate of the gap [m/s].
    """

    P: float
    P_p: float
    P_c: float
    h: float
    u: float
    h_dot: float


@compiled
def film(pump: Pump, scene: Scene, stance: Stance, motion: Motion) -> Film:
    """Passages and forces of a slipper and its piston.

    Wear of the land widens the gap through which it leaks; a land in contact still leaks through its roughness.
    """
    b, wear, t, cos_alpha, c = stance
    P, P_p, P_c, h, u, h_dot = motion
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
