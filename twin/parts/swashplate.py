"""Swashplate. Ports: slippers, stroking and rate pistons, bearings; torques count positive when they increase tilt."""

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
