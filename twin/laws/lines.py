"""Resistances of the circuit: load, drain line, shared return line (section 3.3.1, equations 3-2 to 3-10)."""

import math

from twin.compiled import compiled


@compiled
def load_flow(P_d: float, P_i: float, k_d: float) -> float:
    """Flow through the load of coefficient k_d [Pa/(m3/s)^2] (3-2, mended: the root spans the pressure too).

    Not called by the pump yet: ``parts.circuit.turbulent_conductance`` writes it as a secant.
    """
    flow = math.sqrt(abs(P_d - P_i) / k_d)
    return flow if P_d >= P_i else -flow


@compiled
def drain_pressure_drop(Q: float, k_c: float, w_nu: float, w_Q: float, nu_ratio: float, Q_ref: float) -> float:
    """Pressure drop of the drain line at flow Q [Pa]: ``k_c Q (w_nu nu/nu_50 + w_Q |Q|/Q_ref + 1 - w_nu - w_Q)``.

    The weights say how much of the resistance is laminar pipe (goes with viscosity) and how much is fittings
    (goes with flow); both 0 is equation 3-3, ``w_nu + w_Q = 1`` is the law ``a nu Q + b Q^2``.
    """
    return k_c * Q * (w_nu * nu_ratio + w_Q * abs(Q) / Q_ref + 1.0 - w_nu - w_Q)


@compiled
def return_pressure_drop_with_slope(Q: float, k_inf: float, K: float, gamma: float) -> tuple[float, float]:
    """``return_pressure_drop`` and its derivative by the flow [Pa, Pa/(m3/s)]."""
    ratio = math.pow(abs(Q), gamma) / K
    # ratio / tanh(ratio) -> 1 + ratio^2 / 3
    if ratio < 1.0e-4:
        quotient, by_ratio = 1.0 + ratio * ratio / 3.0, 2.0 * ratio / 3.0
    else:
        tangent = math.tanh(ratio)
        quotient = ratio / tangent
        by_ratio = 1.0 / tangent - ratio * (1.0 - tangent * tangent) / (tangent * tangent)
    return k_inf * K * Q * quotient, k_inf * K * (quotient + gamma * ratio * by_ratio)


@compiled
def return_pressure_drop(Q: float, k_inf: float, K: float, gamma: float) -> float:
    """Pressure drop of the shared return line [Pa] (3-4), odd in Q, with its limit ``k_inf K Q`` at zero flow.

    ``k_inf`` in Pa/(m3/s)^(1+gamma), ``K`` in (m3/s)^gamma.
    """
    drop, _ = return_pressure_drop_with_slope(Q, k_inf, K, gamma)
    return drop
