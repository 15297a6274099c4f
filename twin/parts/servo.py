"""Stroking and rate pistons. Ports: control volume, discharge, case; plate.

The stroking piston reaches ``-L tan(alpha)`` towards the plate and pushes the tilt down; the rate piston reaches
``+L tan(alpha)`` and pushes it up. Torques count positive when they increase tilt;
``t`` is the tangent of the tilt throughout.
"""

import math

from twin.compiled import compiled
from twin.laws.friction import gap_drag
from twin.parameters import ServoPistons


@compiled
def stroking_arm(servo: ServoPistons, t: float) -> float:
    """Volume that the stroking piston displaces per tilt, and the torque per control pressure [m3/rad]."""
    return servo.A_stroke * servo.L_stroke * (1.0 + t * t)


@compiled
def rate_arm(servo: ServoPistons, t: float) -> float:
    """Torque of the rate piston per discharge pressure where its bore is fed [m3/rad], else 0."""
    return servo.rate_fed * servo.A_rate * servo.L_rate * (1.0 + t * t)


@compiled
def spring_torque(servo: ServoPistons, t_max: float, t: float) -> float:
    """Torque of the rate piston's spring [N m]."""
    force = servo.F_rate + servo.k_rate * servo.L_rate * (t_max - t)
    return force * servo.L_rate * (1.0 + t * t)


@compiled
def carried_inertia(servo: ServoPistons, t: float) -> float:
    """Inertia of both pistons as the plate feels it while it carries them [kg m2]."""
    return (servo.m_stroke * servo.L_stroke**2 + servo.m_rate * servo.L_rate**2) * (1.0 + t * t) ** 2


@compiled
def stroking_leakage(servo: ServoPistons, mu: float) -> float:
    """Conductance from the control volume past the stroking piston [m3/s/Pa] (2-9)."""
    d = math.sqrt(4.0 * servo.A_stroke / math.pi)
    eccentric = 1.0 + 1.5 * servo.e_rel_stroke**2
    return math.pi * d * servo.b_stroke**3 / (12.0 * mu * servo.l_stroke) * eccentric


@compiled
def faded_pressure(servo: ServoPistons) -> float:
    """Pressure at which a bleed of the control volume has faded to three quarters [Pa] (estimate)."""
    return 0.05 * servo.F_rate / servo.A_stroke


@compiled
def bleed_flow(servo: ServoPistons, Q: float, dP: float) -> float:
    """Bleed of the control volume into the case [m3/s].

    It is counted as ``Q`` [m3/s] at the control pressure of the zero-flow point and fades with the pressure that drives it.
    """
    return Q * math.tanh(dP / faded_pressure(servo))


@compiled
def rate_leakage(servo: ServoPistons, mu: float) -> float:
    """Conductance from discharge past the rate piston [m3/s/Pa] (2-9), 0 where its bore is vented to the case."""
    d = math.sqrt(4.0 * servo.A_rate / math.pi)
    eccentric = 1.0 + 1.5 * servo.e_rel_rate**2
    return servo.rate_fed * math.pi * d * servo.b_rate**3 / (12.0 * mu * servo.l_rate) * eccentric


@compiled
def stroking_drag(servo: ServoPistons, mu: float) -> float:
    """Viscous drag of the stroking piston over its speed [N s/m] (2-11)."""
    d = math.sqrt(4.0 * servo.A_stroke / math.pi)
    return servo.viscous * gap_drag(mu, d, servo.b_stroke, servo.e_rel_stroke, servo.l_stroke)


@compiled
def rate_drag(servo: ServoPistons, mu: float) -> float:
    """Viscous drag of the rate piston over its speed [N s/m] (2-11)."""
    d = math.sqrt(4.0 * servo.A_rate / math.pi)
    return servo.viscous * gap_drag(mu, d, servo.b_rate, servo.e_rel_rate, servo.l_rate)


@compiled
def contact_damping(elastic: float, rate: float, d: float) -> float:
    """Secant damping of the contact of equation 2-14 [N s/m]: bounded by the elastic force, so it never pulls."""
    speed = abs(rate)
    return d if d * speed <= elastic else elastic / speed
