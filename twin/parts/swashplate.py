"""Swashplate. Ports: slippers, stroking and rate pistons, bearings; torques count positive when they increase tilt."""

import math
from typing import NamedTuple

from twin.compiled import compiled
from twin.parameters import Piston, Swashplate


@compiled
def inertia_torque(piston: Piston, t: float, omega: float) -> float:
    """Mean torque of the reciprocating pistons' inertia at tangent of tilt t [N m]: it drives the tilt up."""
    return 0.5 * piston.n * piston.m * (piston.R * omega) ** 2 * t * (1.0 + t * t)


@compiled
def stop(plate: Swashplate, alpha: float, alpha_dot: float) -> tuple[float, float, float]:
    """Torque of the end stops [N m], its slope by tilt and by tilt rate; never pulling (equation 2-14 with n = 1)."""
    if alpha > plate.alpha_max:
        elastic = -plate.k_stop * (alpha - plate.alpha_max)
    elif alpha < plate.alpha_min:
        elastic = plate.k_stop * (plate.alpha_min - alpha)
    else:
        return 0.0, 0.0, 0.0
    speed = abs(alpha_dot)
    damping = plate.d_stop if plate.d_stop * speed <= abs(elastic) else abs(elastic) / speed
    return elastic - damping * alpha_dot, -plate.k_stop, -damping


class Vibration(NamedTuple):
    """Tilt rate of the vibrating plate over the angle from a commutation [rad/s]: cosines and sines of its harmonics.

    ``teeth`` is the number of commutation events in a radian of shaft times 2 pi: the first harmonic's order.
    """

    teeth: float
    c_1: float
    s_1: float
    c_2: float
    s_2: float
    c_3: float
    s_3: float
    c_4: float
    s_4: float


@compiled
def _answer(J: float, damping: float, stiffness: float, tooth: float, w: float, m: float) -> tuple[float, float]:
    elastic = stiffness - J * w * w
    scale = tooth / (math.pi * m) * w / (elastic * elastic + (damping * w) ** 2)
    return scale * elastic, scale * w * damping


@compiled
def vibration(n: float, J: float, damping: float, stiffness: float, torque_step: float, omega: float) -> Vibration:
    """Vibration of the plate in step with the commutations.

    Every chamber that changes over, at either dead centre, adds ``torque_step`` at once; between, the torque falls
    back linearly: a sawtooth with 2 n teeth a revolution for an odd number of pistons, n teeth twice as high for an
    even one, ``T / (pi m) sin(m x)``. The plate stands on the fluid of the control volume (``stiffness`` [N m/rad])
    and answers each harmonic with ``j w / (k - J w^2 + j w d)``.
    """
    odd = n % 2.0 > 0.5
    teeth = 2.0 * n if odd else n
    tooth = torque_step if odd else 2.0 * torque_step
    w = teeth * omega
    c_1, s_1 = _answer(J, damping, stiffness, tooth, w, 1.0)
    c_2, s_2 = _answer(J, damping, stiffness, tooth, 2.0 * w, 2.0)
    c_3, s_3 = _answer(J, damping, stiffness, tooth, 3.0 * w, 3.0)
    c_4, s_4 = _answer(J, damping, stiffness, tooth, 4.0 * w, 4.0)
    return Vibration(teeth, c_1, s_1, c_2, s_2, c_3, s_3, c_4, s_4)


@compiled
def vibration_rate(v: Vibration, c: float, s: float) -> float:
    """Tilt rate where cosine and sine of ``teeth`` times the angle from the commutation are c and s [rad/s]."""
    c_2, s_2 = c * c - s * s, 2.0 * s * c
    c_3, s_3 = c * c_2 - s * s_2, s * c_2 + c * s_2
    c_4, s_4 = c_2 * c_2 - s_2 * s_2, 2.0 * s_2 * c_2
    rate = v.c_1 * c + v.s_1 * s + v.c_2 * c_2 + v.s_2 * s_2
    return rate + v.c_3 * c_3 + v.s_3 * s_3 + v.c_4 * c_4 + v.s_4 * s_4
