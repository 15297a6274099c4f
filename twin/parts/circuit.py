"""The circuit at the pump's ports as secant conductances Q / dP: load, leaks, drain line, return line."""

import math

from twin.compiled import compiled
from twin.laws.lines import return_pressure_drop
from twin.numbers import ZERO_FLOW_PRESSURE

DP_LAMINAR = 1.0e3
"""Pressure difference below which turbulent passages of the circuit count as laminar [Pa]."""
P_COUNTED = ZERO_FLOW_PRESSURE
"""Pressure difference at which leaks with the law of an orifice are counted [Pa]."""


@compiled
def turbulent_conductance(dP: float, per_root: float) -> float:
    """Conductance of a turbulent passage of ``per_root`` [m3/s/Pa^0.5] (3-2), laminar near zero [m3/s/Pa]."""
    return per_root / math.sqrt(math.sqrt(dP * dP + DP_LAMINAR * DP_LAMINAR))


@compiled
def counted_conductance(dP: float, Q: float) -> float:
    """Conductance of a leak that lets ``Q`` through at 175 bar [m3/s/Pa]."""
    return turbulent_conductance(dP, Q / math.sqrt(P_COUNTED))


@compiled
def drain_conductance(dP: float, k_c: float, k_cQ: float) -> float:
    """Conductance of the drain line [m3/s/Pa]: ``k_c Q + k_cQ Q |Q| = dP`` solved for Q / dP (3-3 with fittings)."""
    return 2.0 / (k_c + math.sqrt(k_c * k_c + 4.0 * k_cQ * abs(dP)))


@compiled
def return_conductance(dP: float, k_inf: float, K: float, gamma: float) -> float:
    """Conductance of the shared return line [m3/s/Pa]: equation 3-4 inverted.

    For gamma = 1 one step of Householder's method of third order starts from the closed solution of the near law
    Q sqrt(Q^2 + K^2) and ends within 4e-7; other exponents are solved the long way.
    """
    drop = abs(dP)
    if drop < 1.0e-3:
        return 1.0 / (k_inf * K)
    if gamma != 1.0:
        return _return_conductance_of(drop, k_inf, K, gamma)
    q = drop / (k_inf * K * K)
    # x^2 / tanh(x) = q with x = Q / K
    x = math.sqrt(2.0 * q * q / (1.0 + math.sqrt(1.0 + 4.0 * q * q)))
    if x < 1.0e-3:
        x = q * (1.0 - q * q / 3.0)
    else:
        c = 1.0 / math.tanh(x)
        # derivatives of x^2 c over the first one, c' being k
        k, xc = 1.0 - c * c, x * c
        per_slope = 1.0 / (x * (2.0 * c + x * k))
        h = (q - x * xc) * per_slope
        second = (2.0 * c + 2.0 * x * k * (2.0 - xc)) * per_slope
        third = k * (6.0 - 12.0 * xc - 2.0 * x * x * (k - 2.0 * c * c)) * per_slope
        x += h * (1.0 + 0.5 * second * h) / (1.0 + h * (second + third * h * (1.0 / 6.0)))
    return x * K / drop


@compiled
def _return_conductance_of(drop: float, k_inf: float, K: float, gamma: float) -> float:
    Q = min(drop / (k_inf * K), math.pow(drop / k_inf, 1.0 / (1.0 + gamma)))
    for _ in range(8):
        h = 1.0e-6 * Q
        f = return_pressure_drop(Q, k_inf, K, gamma)
        slope = (return_pressure_drop(Q + h, k_inf, K, gamma) - f) / h
        move = (drop - f) / slope
        Q += move
        if abs(move) < 1.0e-12 * Q:
            break
    return Q / drop
