"""Contact between bodies that may separate: the three published forms (section 2.4.4, equations 2-12 to 2-14).

``delta`` is the deformation [m], positive in contact; ``delta_dot`` its rate [m/s]. Forces push apart when positive.
"""

import math

from twin.compiled import compiled


@compiled
def kelvin_voigt_force(delta: float, delta_dot: float, k: float, d: float) -> float:
    """Spring and damper in parallel [N] (2-12): jumps at first touch and may pull; kept as the reference form.

    Not called by the pump yet: no contact of it jumps.
    """
    return k * delta + d * delta_dot if delta > 0.0 else 0.0


@compiled
def asymptotic_damping_force(delta: float, delta_dot: float, k: float, d_max: float, delta_0: float) -> float:
    """Damping that grows with the deformation [N] (2-13).

    ``delta_0`` is the deformation at which damping reaches 95 % of ``d_max``: that takes exp(-3 delta/delta_0);
    the printed exp(-delta/delta_0) reaches 63 % there.

    Not called by the pump yet: its contacts are of equation 2-14.
    """
    if delta <= 0.0:
        return 0.0
    return k * delta + d_max * (1.0 - math.exp(-3.0 * delta / delta_0)) * delta_dot


@compiled
def bounded_damping_force(delta: float, delta_dot: float, k: float, d: float, n: float) -> float:
    """Hertzian spring with damping bounded by the elastic force [N] (2-14): continuous, and never pulls.

    The damping magnitude is min(F_e, |d delta_dot|) (printed without the magnitude); ``n`` is 1 for planes and
    3/2 for a sphere on a plane (printed 2/3).

    Not called by the pump yet: ``parts.servo.contact_damping`` and ``parts.swashplate.stop`` write
    it as a secant with n = 1.
    """
    if delta <= 0.0:
        return 0.0
    elastic = k * math.pow(delta, n)
    damping = min(elastic, abs(d * delta_dot))
    return elastic + damping if delta_dot >= 0.0 else elastic - damping
