"""Compressibility of the fluid with entrained air (section 2.4.1, equations 2-1 and 2-2).

Pressure follows from mass, never the other way: ``relative_density`` says how much fluid, counted as volume at
ambient pressure, a unit of volume holds. Its slope over itself is the compressibility of equation 2-1, and a balance
of it over a volume is equation 2-2 without the error of a constant modulus. Air is free (undissolved) and polytropic.
"""

import math
from typing import NamedTuple

from twin.compiled import compiled
from twin.laws.fluid import P_ATMOSPHERE, Fluid, bulk_modulus

P_FLOOR = 1.0e3
"""Lowest absolute pressure that a fluid shows [Pa]: below it a cavity opens, and further loss of mass widens it."""


class Medium(NamedTuple):
    """What compresses: tangent modulus at ambient pressure [Pa], its gain with pressure, volume of free air per volume
    of liquid at ambient pressure [-], one over the polytropic exponent of the air.
    """

    B_0: float
    gain: float
    air: float
    inverse_exponent: float


@compiled
def medium_of(fluid: Fluid, T: float) -> Medium:
    """Medium of a fluid at temperature T [K]."""
    air = fluid.air / (1.0 - fluid.air)
    return Medium(bulk_modulus(fluid, T, P_ATMOSPHERE), fluid.B_pressure_gain, air, 1.0 / fluid.air_exponent)


@compiled
def relative_density(m: Medium, P: float) -> float:
    """Density over its value at ambient pressure [-]; below ``P_FLOOR`` it goes on as the liquid alone would."""
    p = P - P_ATMOSPHERE
    liquid = 1.0 + p / (m.B_0 + m.gain * p)
    if m.air == 0.0:
        return liquid
    return (1.0 + m.air) / (1.0 / liquid + m.air * math.pow(P_ATMOSPHERE / max(P, P_FLOOR), m.inverse_exponent))


@compiled
def relative_compressibility(m: Medium, P: float) -> float:
    """Slope of ``relative_density`` by pressure [1/Pa]: the modulus of 2-1 is relative density over it."""
    p = P - P_ATMOSPHERE
    B = m.B_0 + m.gain * p
    liquid_slope = m.B_0 / (B * B)
    if m.air == 0.0:
        return liquid_slope
    liquid = 1.0 + p / B
    bubble = m.air * math.pow(P_ATMOSPHERE / max(P, P_FLOOR), m.inverse_exponent)
    slope = liquid_slope / (liquid * liquid)
    if P > P_FLOOR:
        slope += bubble * m.inverse_exponent / P
    w = (1.0 + m.air) / (1.0 / liquid + bubble)
    return w * w * slope / (1.0 + m.air)


@compiled
def density_and_slope(m: Medium, P: float) -> tuple[float, float]:
    """``relative_density`` and ``relative_compressibility`` at once: without air one division instead of three."""
    if m.air != 0.0:
        return relative_density(m, P), relative_compressibility(m, P)
    p = P - P_ATMOSPHERE
    per_B = 1.0 / (m.B_0 + m.gain * p)
    return 1.0 + p * per_B, m.B_0 * per_B * per_B


@compiled
def pressure(m: Medium, w: float, guess: float) -> float:
    """Inverse of ``relative_density`` [Pa absolute]; ``guess`` is only used with air, by Newton's method."""
    if m.air == 0.0:
        return P_ATMOSPHERE + (w - 1.0) * m.B_0 / (1.0 - m.gain * (w - 1.0))
    P = max(guess, P_FLOOR)
    for _ in range(60):
        error = relative_density(m, P) / w - 1.0
        step = -error * w / relative_compressibility(m, P)
        # specific volume is convex in P: Newton comes from the left; from the right it may leap below zero
        following = P + step
        if P > P_FLOOR and following < 0.2 * P:
            following = 0.2 * P
        if abs(error) < 1.0e-14:
            break
        P = following
    return P


@compiled
def pressure_of(m: Medium, mass: float, volume: float, guess: float) -> float:
    """``pressure`` of a mass [m3 at ambient density] in a volume [m3]: without air one division."""
    if m.air != 0.0:
        return pressure(m, mass / volume, guess)
    excess = mass - volume
    return P_ATMOSPHERE + excess * m.B_0 / (volume - m.gain * excess)


@compiled
def elastic_head(m: Medium, P: float) -> float:
    """Work to bring fluid from ambient pressure to P, per volume at ambient pressure [J/m3]: integral of dP / w.

    What a flow counted at ambient density carries as power per flow; air is left out (exact without).
    """
    p = P - P_ATMOSPHERE
    c = m.gain + 1.0
    return m.gain / c * p + m.B_0 / c * (1.0 - m.gain / c) * math.log(1.0 + c * p / m.B_0)
