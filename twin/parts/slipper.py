"""Slipper: throttle, pocket and land. Ports: chamber, case; ball joint of the piston; plate.

Constant gap: throttle and land in series, the pocket without memory. Variable gap (section 2.6.2, equations 2-27 to
2-44): piston and slipper are one body between plate and retainer. With the ball's centre on the plate's axis plane,
``h = cos(alpha) (z + R tan(alpha) cos(phi))``, z being the piston's place along its bore, positive into the barrel.
"""

import math

from twin.compiled import compiled
from twin.parameters import Piston, Slipper


@compiled
def throttle_coefficient(slipper: Slipper, rho: float) -> float:
    """Flow through the throttle per root of pressure difference [m3/s/Pa^0.5]."""
    return slipper.C_q * 0.25 * math.pi * slipper.d_throttle**2 * math.sqrt(2.0 / rho)


@compiled
def land_coefficient(slipper: Slipper) -> float:
    """Conductance of the land times viscosity over the gap's cube [-] (2-26)."""
    return math.pi / (6.0 * math.log(slipper.diameter_ratio))


@compiled
def throttled_conductance(dP: float, K: float, G: float) -> float:
    """Secant conductance of throttle K and land G in series, the pocket eliminated [m3/s/Pa].

    Not called by the pump yet: its steps divide once by ``throttled_sum`` and by what else they divide by.
    """
    return 2.0 * K * G / throttled_sum(dP, K, G)


@compiled
def throttled_sum(dP: float, K: float, G: float) -> float:
    """What ``2 K G`` is divided by in ``throttled_conductance`` [m3/s/Pa^0.5]."""
    return K + math.sqrt(K * K + 4.0 * G * G * abs(dP))


@compiled
def land_area(piston: Piston, slipper: Slipper) -> float:
    """Area S_eq on which the pocket's pressure acts [m2] (2-37)."""
    return slipper.balance * 0.25 * math.pi * piston.d_p**2


@compiled
def outer_area(piston: Piston, slipper: Slipper) -> float:
    """Area within the land's outer diameter [m2], from S_eq and the diameter ratio (2-37)."""
    ratio = slipper.diameter_ratio
    return land_area(piston, slipper) * 2.0 * math.log(ratio) / (1.0 - 1.0 / (ratio * ratio))


@compiled
def squeeze_coefficient(piston: Piston, slipper: Slipper) -> float:
    """Damping of the film on the land times h^3 over viscosity [m4]: Reynolds' equation on a parallel ring.

    ``3 pi/2 (r_e^4 - r_i^4 - (r_e^2 - r_i^2)^2 / ln(r_e/r_i))``, beside what the pocket's own pressure does.
    """
    r_e2 = outer_area(piston, slipper) / math.pi
    r_i2 = r_e2 / slipper.diameter_ratio**2
    ring = r_e2 * r_e2 - r_i2 * r_i2 - (r_e2 - r_i2) ** 2 / math.log(slipper.diameter_ratio)
    return slipper.squeeze * 1.5 * math.pi * ring


@compiled
def lever(piston: Piston, h: float, cos_alpha: float, t: float, cos_phi: float) -> float:
    """Torque arm dh/dalpha of a slipper on the plate [m] (2-40), signed: positive where a push increases tilt."""
    return piston.R * cos_phi / cos_alpha - h * t


@compiled
def contact(slipper: Slipper, h: float) -> tuple[float, float]:
    """Elastic force of plate (positive) or retainer (negative) on the slipper [N], and its stiffness [N/m]."""
    if h < slipper.h_min:
        return slipper.k_contact * (slipper.h_min - h), slipper.k_contact
    if h > slipper.h_retainer:
        return -slipper.k_contact * (h - slipper.h_retainer), slipper.k_contact
    return 0.0, 0.0
