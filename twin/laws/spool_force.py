"""Forces on a spool besides pressure and spring: jet (2-21 to 2-23), jamming (2-24, 2-25), gap drag (2-10, 2-11)."""

import math

from twin.compiled import compiled


@compiled
def steady_jet_force(C_d: float, C_v: float, S: float, dP: float, cos_theta: float) -> float:
    """Axial force of the steady jet [N] (2-21), in the direction that closes the orifice.

    Not called by the pump yet: ``parts.compensator.jet_stiffness`` writes it with its slope.
    """
    return 2.0 * C_d * C_v * S * abs(dP) * cos_theta


@compiled
def transient_jet_force(L: float, C_d: float, w: float, rho: float, dP: float, v: float) -> float:
    """Damping part of the transient jet force [N] (2-22, first term; the pressure-rate term is usually neglected).

    ``L`` is the damping length, ``w`` the area gradient [m2/m], ``v`` the spool's speed.

    Not called by the pump yet: ``parts.compensator.transient_jet_damping`` writes it over speed.
    """
    return L * C_d * w * math.sqrt(2.0 * rho * abs(dP)) * v


@compiled
def fading_jet_share(X: float, x_min: float) -> float:
    """Share of the steady jet force that acts near closing [-] (2-23): 1/2 at X = x_min, 0 when overlapped.

    Not called by the pump yet: its jet fades as the rounded edge closes.
    """
    return 0.5 * (math.tanh(2.0 * (X - x_min) / x_min) + 1.0)


@compiled
def jamming_force(zeta: float, intensity: float, v: float, v_0: float) -> float:
    """Friction of a jammed spool against its speed v [N] (2-24, 2-25); v_0 at least 1e4 times below its top speed.

    Not called by the pump yet: ``laws.friction.friction_damping`` writes it over speed.
    """
    return zeta * intensity * math.tanh(2.0 * v / v_0)


@compiled
def annular_drag(P_0: float, P_1: float, mu: float, d_p: float, b: float, length: float, e: float, v: float) -> float:
    """Force of the fluid in an annular gap on the piston, positive from port 0 to port 1 [N] (2-10, 2-11).

    Mended: on the piston the pressure term is positive and the viscous one opposes its speed ``v`` relative to
    the housing; the eccentricity enters as (e/b)^2.

    Not called by the pump yet: ``laws.friction.gap_drag`` is its viscous part over speed.
    """
    viscous = mu * length * math.pi * d_p / (b * math.sqrt(1.0 - (e / b) ** 2)) * v
    return math.pi * b * 0.5 * d_p * (P_0 - P_1) - viscous
