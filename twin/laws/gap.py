"""Laminar flow through the pump's gaps (section 2.4.3, table 2-6, equations 2-9 and 2-26)."""

import math

from twin.compiled import compiled


@compiled
def annular_gap_flow(
    P_0: float, P_1: float, mu: float, d_b: float, b: float, length: float, e: float, v_sum: float
) -> float:
    """Flow through the annular gap round a piston [m3/s] (2-9, table 2-6 row 1).

    Positive from port 0 to port 1 for P_0 > P_1; ``v_sum = v_b + v_p`` counts positive in the same direction
    (the printed pressure term carries the opposite sign). ``b`` is the radial clearance, ``e`` the
    eccentricity (0 centred, b touching) [m].
    """
    poiseuille = (P_0 - P_1) / (12.0 * mu * length) * b**3 * math.pi * d_b * (1.0 + 1.5 * (e / b) ** 2)
    return poiseuille + 0.5 * v_sum * b * math.pi * d_b


@compiled
def land_conductance(mu: float, h: float, diameter_ratio: float) -> float:
    """Conductance of the hydrostatic land of a slipper [m3/s/Pa] (2-26, table 2-6 row 2)."""
    return math.pi * h**3 / (6.0 * mu * math.log(diameter_ratio))


@compiled
def land_flow(P_0: float, P_1: float, mu: float, h: float, diameter_ratio: float) -> float:
    """Flow out of a slipper pocket over its land of outer to inner diameter ``diameter_ratio`` [m3/s] (2-26).

    Not called by the pump yet: it takes ``land_conductance``; the bench of the slipper does.
    """
    return land_conductance(mu, h, diameter_ratio) * (P_0 - P_1)


@compiled
def throttled_land_flow(P_0: float, P_1: float, G_land: float, C_q_area: float, rho: float) -> float:
    """Flow through a turbulent throttle in series with a laminar land, pocket pressure eliminated [m3/s].

    Solves ``G (P_p - P_1) = C_q A sqrt(2 (P_0 - P_p) / rho)`` in closed form; odd in P_0 - P_1.
    """
    dP = abs(P_0 - P_1)
    K = C_q_area * math.sqrt(2.0 / rho)
    # root of G y^2 + K y - G dP = 0 for y = sqrt(P_0 - P_p), written without cancellation
    y = 2.0 * G_land * dP / (K + math.sqrt(K * K + 4.0 * G_land * G_land * dP))
    flow = K * y
    return flow if P_0 >= P_1 else -flow


@compiled
def port_plate_gap_flow(P_0: float, P_1: float, mu: float, h: float, shape: float) -> float:
    """Flow from a kidney port to the case between barrel and port plate [m3/s] (table 2-6 row 3).

    ``shape`` is the integral of arc length over land width [-]. The printed pi is dropped: with gamma as arc
    length the plane-gap law h^3/(12 mu) has none.
    """
    return (P_0 - P_1) * h**3 / (12.0 * mu) * shape
