"""Swashplate: torques of spring, inertia of the pistons, damping and stops; positive when they increase tilt."""

import math

from twin.compiled import compiled
from twin.parameters import Compensator, Piston, Swashplate


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
def stroking_arm(comp: Compensator, alpha: float) -> float:
    """Volume that the stroking piston displaces per tilt, and the torque per control pressure [m3/rad]."""
    t = math.tan(alpha)
    return comp.A_stroke * comp.L_stroke * (1.0 + t * t)
