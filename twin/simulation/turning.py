"""Angles that move a little in a step: sines, cosines and tangents from those before, without the library's functions."""

import math
from typing import NamedTuple

from twin.compiled import inlined

_SMALL_TURN, _SMALL_TILT = 0.1, 0.01
"""Largest angles that the series are asked for [rad]: their errors stay below rounding."""


class Pose(NamedTuple):
    """Where swashplate and shaft stand: tangent of the tilt, cosine and sine of the shaft's angle."""

    t: float
    c: float
    s: float


@inlined
def small_turn(x: float) -> tuple[float, float]:
    """Cosine and sine of an angle [rad], by their series where it is small."""
    q = x * x
    c = 1.0 - 0.5 * q * (1.0 - q * (1.0 / 12.0) * (1.0 - q * (1.0 / 30.0) * (1.0 - q * (1.0 / 56.0))))
    s = x * (1.0 - q * (1.0 / 6.0) * (1.0 - q * 0.05 * (1.0 - q * (1.0 / 42.0) * (1.0 - q * (1.0 / 72.0)))))
    if abs(x) > _SMALL_TURN:
        c, s = math.cos(x), math.sin(x)
    return c, s


@inlined
def tangent_after(t: float, x: float) -> float:
    """Tangent of an angle that was that of ``t`` and has grown by x [rad]."""
    q = x * x
    grown = x * (1.0 + q * (1.0 / 3.0 + q * (2.0 / 15.0 + q * (17.0 / 315.0))))
    if abs(x) > _SMALL_TILT:
        grown = math.tan(x)
    return (t + grown) / (1.0 - t * grown)


@inlined
def past_dead_centre(theta: float, phi: float) -> float:
    """Angle between 0 and a whole turn past the dead centre, which the port plate delays by ``phi`` [rad]."""
    delayed = theta - phi
    if abs(delayed) > 2.0 * math.pi:
        delayed = delayed % (2.0 * math.pi)
    if delayed < 0.0:
        delayed += 2.0 * math.pi
    if delayed >= 2.0 * math.pi:
        delayed -= 2.0 * math.pi
    return delayed
