"""Compressibility of the fluid with entrained air (section 2.4.1, equations 2-1 and 2-2).

Pressure follows from mass, never the other way: ``relative_density`` says how much fluid, counted as volume at
ambient pressure, a unit of volume holds. Its slope over itself is the compressibility of equation 2-1, and a balance
of it over a volume is equation 2-2 without the error of a constant modulus. Air is free (undissolved) and polytropic.
"""

import math
from typing import NamedTuple

import numpy as np

from twin.compiled import compiled
from twin.laws.fluid import P_ATMOSPHERE, Fluid, bulk_modulus

P_FLOOR = 1.0e3
"""Lowest absolute pressure that a fluid shows [Pa]: below it a cavity opens, and further loss of mass widens it."""
_HALVED = 0x3FE6A09E667F3BCD
"""Bits of the root of one half: what lies between it and the root of two has no exponent."""
_LN_2 = math.log(2.0)
_ROUNDS = 60
_CLOSE = 1.0e-4
"""Share of the pressure that the last step of its search may move: what is left is its cube."""


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
def power(x: float, exponent: float) -> float:
    """X to the power of the exponent for positive x, within 1e-9: a third of the price of the library's, which is exact."""
    bits = np.float64(x).view(np.int64)
    whole = (bits - np.int64(_HALVED)) >> 52
    part = np.int64(bits - (whole << 52)).view(np.float64)
    # the logarithm by its series about one, the power of two by that of the exponential about a whole number
    s = (part - 1.0) / (part + 1.0)
    q = s * s
    log = s * (2.0 + q * (2.0 / 3.0 + q * (0.4 + q * (2.0 / 7.0 + q * (2.0 / 9.0)))))
    z = exponent * (whole + log * (1.0 / _LN_2))
    times = math.floor(z + 0.5)
    f = (z - times) * _LN_2
    e = 1.0 + f * (1.0 / 6.0) * (1.0 + f * (1.0 / 7.0) * (1.0 + f * 0.125))
    e = 1.0 + f * (1.0 + f * 0.5 * (1.0 + f * (1.0 / 3.0) * (1.0 + f * 0.25 * (1.0 + f * 0.2 * e))))
    return float(e * np.int64((np.int64(times) + 1023) << 52).view(np.float64))


@compiled
def _bubble(m: Medium, P: float) -> tuple[float, float]:
    """Volume of air per volume of liquid at ambient pressure [-], and how fast it falls with pressure [1/Pa]."""
    if P <= P_FLOOR:
        return m.air * power(P_ATMOSPHERE / P_FLOOR, m.inverse_exponent), 0.0
    per_P = 1.0 / P
    bubble = m.air * power(P_ATMOSPHERE * per_P, m.inverse_exponent)
    return bubble, bubble * m.inverse_exponent * per_P


@compiled
def density_and_slope(m: Medium, P: float) -> tuple[float, float]:
    """``relative_density`` and ``relative_compressibility`` at once: without air one division instead of three."""
    p = P - P_ATMOSPHERE
    B = m.B_0 + m.gain * p
    if m.air != 0.0:
        bubble, fall = _bubble(m, P)
        # specific volume is B / L and the bubble's; B / L falls with pressure by B_0 / L^2
        L = B + p
        per = 1.0 / (B + bubble * L)
        return (1.0 + m.air) * L * per, (1.0 + m.air) * (m.B_0 + fall * L * L) * per * per
    per_B = 1.0 / B
    return 1.0 + p * per_B, m.B_0 * per_B * per_B


@compiled
def relative_density(m: Medium, P: float) -> float:
    """Density over its value at ambient pressure [-]; below ``P_FLOOR`` it goes on as the liquid alone would."""
    if m.air != 0.0:
        return density_and_slope(m, P)[0]
    p = P - P_ATMOSPHERE
    return 1.0 + p / (m.B_0 + m.gain * p)


@compiled
def relative_compressibility(m: Medium, P: float) -> float:
    """Slope of ``relative_density`` by pressure [1/Pa]: the modulus of 2-1 is relative density over it."""
    if m.air != 0.0:
        return density_and_slope(m, P)[1]
    B = m.B_0 + m.gain * (P - P_ATMOSPHERE)
    return m.B_0 / (B * B)


@compiled
def pressure(m: Medium, w: float, guess: float) -> float:
    """Inverse of ``relative_density`` [Pa absolute]; ``guess`` is only used with air, by Halley's method.

    Not called by the pump yet: it asks by mass and volume (``pressure_of``).
    """
    if m.air == 0.0:
        return P_ATMOSPHERE + (w - 1.0) * m.B_0 / (1.0 - m.gain * (w - 1.0))
    return _pressure_with_air(m, (1.0 + m.air) / w, guess)


@compiled
def _pressure_with_air(m: Medium, asked: float, guess: float) -> float:
    """Pressure at which liquid and air take ``asked`` times the liquid's volume at ambient pressure [Pa absolute]."""
    P = max(guess, P_FLOOR)
    for _ in range(_ROUNDS):
        p = P - P_ATMOSPHERE
        B = m.B_0 + m.gain * p
        bubble, fall = _bubble(m, P)
        per_L = 1.0 / (B + p)
        slope = m.B_0 * per_L * per_L
        # half of the curvature: specific volume is convex in P
        bend = slope * (m.gain + 1.0) * per_L
        if P > P_FLOOR:
            bend += 0.5 * fall * (m.inverse_exponent + 1.0) / P
        slope += fall
        step = (B * per_L + bubble - asked) / slope
        step /= max(1.0 - step * bend / slope, 0.5)
        following = P + step
        # from the right it may leap below zero
        if P > P_FLOOR and following < 0.2 * P:
            following = 0.2 * P
        P = following
        if abs(step) < _CLOSE * abs(P):
            break
    return P


@compiled
def pressure_of(m: Medium, mass: float, volume: float, guess: float) -> float:
    """``pressure`` of a mass [m3 at ambient density] in a volume [m3]: without air one division."""
    if m.air != 0.0:
        return _pressure_with_air(m, (1.0 + m.air) * volume / mass, guess)
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
