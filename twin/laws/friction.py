"""Friction of sliding parts as a secant damping F / v, which an implicit step can take without an algebraic loop."""

import math

from twin.compiled import compiled

_STRIBECK = 10.0
"""Speed, in thresholds, over which static friction fades to Coulomb friction (our choice; the thesis has none)."""


@compiled
def friction_damping(F_coulomb: float, F_static: float, v: float, v_0: float) -> float:
    """Friction over speed [N s/m], for forces and m/s or torques and rad/s alike.

    ``(F_C + (F_S - F_C) exp(-(v / 10 v_0)^2)) tanh(2 |v| / v_0) / |v|``: equation 2-25 with a static share; at rest
    it is ``2 F / v_0``, a creep below ``v_0`` instead of sticking.
    """
    speed = abs(v)
    F = F_coulomb
    if F_static > F_coulomb:
        F += (F_static - F_coulomb) * math.exp(-((speed / (_STRIBECK * v_0)) ** 2))
    if F == 0.0:
        return 0.0
    x = 2.0 * speed / v_0
    return 2.0 * F / v_0 if x < 1.0e-6 else F * math.tanh(x) / speed


@compiled
def friction_damping_ahead(F_coulomb: float, F_static: float, v_0: float, drive: float, inertia: float) -> float:
    """Friction over speed at the speed that a step will end with [N s/m], for a body that friction alone may hold.

    ``drive`` is what pushes the body over the step, its momentum included [N], ``inertia`` what it pushes against per
    speed [N s/m]. Taken at the speed before, a secant would let a body break free over many steps instead of one.
    """
    push = abs(drive)
    v = max((push - F_coulomb) / inertia, push / (inertia + 2.0 * F_coulomb / v_0))
    return friction_damping(F_coulomb, F_static, v, v_0)


@compiled
def gap_drag(mu: float, d: float, b: float, e_rel: float, length: float) -> float:
    """Viscous drag of an annular gap over speed [N s/m] (2-11, mended: the eccentricity enters as e/b)."""
    return mu * length * math.pi * d / (b * math.sqrt(1.0 - e_rel * e_rel))
