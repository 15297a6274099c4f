"""Swashplate: torques of spring, inertia of the pistons, damping and stops; positive when they increase tilt."""

import math

from twin.compiled import compiled
from twin.parameters import Compensator, Piston, Swashplate

_HARMONICS = 8
"""The sawtooth's answer falls with the square of the harmonic: eight leave 1 % of it out."""


@compiled
def spring_torque(comp: Compensator, alpha_max: float, alpha: float) -> float:
    """Torque of the rate piston's spring [N m]."""
    t = math.tan(alpha)
    force = comp.F_rate + comp.k_rate * comp.L_rate * (math.tan(alpha_max) - t)
    return force * comp.L_rate * (1.0 + t * t)


@compiled
def inertia_torque(piston: Piston, alpha: float, omega: float) -> float:
    """Mean torque of the reciprocating pistons' inertia [N m]: it drives the tilt up."""
    t = math.tan(alpha)
    return 0.5 * piston.n * piston.m * (piston.R * omega) ** 2 * t * (1.0 + t * t)


@compiled
def stop_torque(plate: Swashplate, alpha: float, alpha_dot: float) -> float:
    """Torque of the stop at full tilt [N m], never pulling (the form of equation 2-14 with n = 1)."""
    depth = alpha - plate.alpha_max
    if depth <= 0.0:
        return 0.0
    elastic = plate.k_stop * depth
    damping = min(elastic, abs(plate.d_stop * alpha_dot))
    return -(elastic + damping) if alpha_dot >= 0.0 else -(elastic - damping)


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


@compiled
def stroking_arm(comp: Compensator, alpha: float) -> float:
    """Volume that the stroking piston displaces per tilt, and the torque per control pressure [m3/rad]."""
    t = math.tan(alpha)
    return comp.A_stroke * comp.L_stroke * (1.0 + t * t)
