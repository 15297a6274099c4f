"""Piston and chamber: kinematics under a tilted plate. Angle 0 is outer dead centre: the largest chamber."""

import math

from twin.compiled import compiled
from twin.parameters import Piston, PortPlate


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


@compiled
def indicated_torque(
    piston: Piston, plate: PortPlate, t: float, omega: float, dP: float, rho: float, rising: float, falling: float
) -> float:
    """Mean torque of the chambers' pressures on the shaft [N m]: the work of a revolution, the integral of V dP.

    A chamber's pressure changes by ``dP`` [Pa] at the mean angles ``rising`` and ``falling`` past the dead centres [rad], at
    the volume that it has there: what compresses its dead volume through a port is lost. Between the changes the ports
    throttle (2-3) at the piston's speed, whose square weighs 4/3 over a stroke.
    """
    swing = piston_area(piston) * piston.R * t
    through = swing * omega / (plate.C_q * plate.A_port)
    throttled = 8.0 / 3.0 * 0.5 * rho * through * through * abs(swing)
    return piston.n / (2.0 * math.pi) * (swing * dP * (math.cos(rising) + math.cos(falling)) + throttled)
