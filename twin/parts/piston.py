"""Piston and chamber: kinematics under a tilted plate. Angle 0 is outer dead centre: the largest chamber."""

import math

from twin.compiled import compiled
from twin.parameters import Piston


@compiled
def piston_area(piston: Piston) -> float:
    """Area of a piston [m2]."""
    return 0.25 * math.pi * piston.d_p**2


@compiled
def chamber_volume(piston: Piston, t_max: float, t: float, cos_phi: float) -> float:
    """Volume of a chamber [m3] at tangent of tilt ``t`` (``t_max`` at the stop) and cosine of the piston's angle."""
    return piston.V_dead + piston_area(piston) * piston.R * (t_max + t * cos_phi)


@compiled
def volume_rate_by_rotation(piston: Piston, t: float, sin_phi: float, omega: float) -> float:
    """Rate of the chamber's volume by the turning shaft [m3/s]: negative while the piston moves in."""
    return -piston_area(piston) * piston.R * t * sin_phi * omega


@compiled
def volume_by_tilt(piston: Piston, t: float, cos_phi: float) -> float:
    """Slope of the chamber's volume by the tilt angle [m3/rad]; also its pressure's torque arm on the plate."""
    return piston_area(piston) * piston.R * (1.0 + t * t) * cos_phi
