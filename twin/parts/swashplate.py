"""Swashplate. Ports: slippers, stroking and rate pistons, bearings; torques count positive when they increase tilt."""

import math

from twin.compiled import compiled
from twin.parameters import Piston, Swashplate

_HARMONICS = 8
"""The sawtooth's answer falls with the square of the harmonic: eight leave 1 % of it out."""


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


@compiled
def commutation_tilt_rate(
    n: float, J: float, damping: float, stiffness: float, torque_step: float, omega: float
) -> float:
    """Rate of tilt with which the plate meets each commutation [rad/s], negative above its resonance.

    Every chamber that changes over, at either dead centre, adds ``torque_step`` at once; between, the torque falls
    back linearly: a sawtooth with 2 n teeth a revolution for an odd number of pistons, n teeth twice as high for an
    even one. The plate stands on the fluid of the control volume (``stiffness`` [N m/rad]) and answers every
    harmonic m with ``T / (pi m) Im(j w / (k - J w^2 + j d w))`` at the step; -T tau / (12 J) for a free plate.
    """
    odd = n % 2.0 > 0.5
    first = 2.0 * n * omega if odd else n * omega
    tooth = torque_step if odd else 2.0 * torque_step
    total = 0.0
    for m in range(1, _HARMONICS + 1):
        w = m * first
        elastic = stiffness - J * w * w
        total += w * elastic / (elastic * elastic + (damping * w) ** 2) / m
    return tooth / math.pi * total
