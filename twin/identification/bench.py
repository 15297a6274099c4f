"""Numbers of a test bench from measured ports: the three steps of figure 3-21 (equations 3-10 to 3-14), or all at once.

Pressures in bar, flows in L/min, resistances in their powers, as table 3-4 prints them. gamma of equation 3-4 is fitted where
asked for; its exponent makes K and k_inf incomparable between values of gamma, so that 1 is the usual choice.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, least_squares

Vector = NDArray[np.float64]


class BenchPoint(NamedTuple):
    """What a bench measures at the ports of a steady pump: pressures [bar], flows [L/min], kinematic viscosity [cSt]."""

    discharge_pressure_bar: float
    case_pressure_bar: float
    reservoir_pressure_bar: float
    discharge_flow_lpm: float
    case_flow_lpm: float
    viscosity_cst: float = 10.0


class Bench(NamedTuple):
    """Resistances found.

    Attributes
    ----------
    k_cr, k_c
        Case to reservoir at zero flow (3-10), and case to junction [bar/(L/min)].
    k_inf, K, gamma
        Return line (3-4) [bar/(L/min)^(1+gamma), (L/min)^gamma, -].
    k_d
        Load of each point [bar/(L/min)^2], 0 at zero flow (3-14).
    """

    k_cr: float
    k_c: float
    k_inf: float
    K: float
    gamma: float
    k_d: tuple[float, ...]


class Drain(NamedTuple):
    """Law of the drain, ``a nu Q + b Q^2 + c Q``: a [bar/(L/min)/cSt], b [bar/(L/min)^2], c [bar/(L/min)].

    ``c`` alone is equation 3-3; ``a`` and ``b`` are a laminar pipe with fittings.
    """

    a: float
    b: float
    c: float

    def drop(self, Q: float, viscosity_cst: float) -> float:
        """Pressure drop [bar] at Q [L/min]."""
        return (self.a * viscosity_cst + self.b * abs(Q) + self.c) * Q

    def flow(self, drop: float, viscosity_cst: float) -> float:
        """Flow [L/min] at a pressure drop [bar]."""
        linear = self.a * viscosity_cst + self.c
        size = 2.0 * abs(drop) / (linear + np.sqrt(linear**2 + 4.0 * self.b * abs(drop)))
        return float(np.copysign(size, drop))


def return_line(Q: Vector, k_inf: float, K: float, gamma: float) -> Vector:
    """Pressure drop of the return line [bar] (3-4) at Q [L/min], shape (m,)."""
    ratio = np.maximum(np.abs(Q), 1e-12) ** gamma / K
    drop: Vector = k_inf * K * Q * ratio / np.tanh(ratio)
    return drop


def in_three_steps(points: Sequence[BenchPoint], free_gamma: bool = False) -> Bench:
    """Figure 3-21: k_cr from zero flow (3-12), the return line with k_c = k_cr - k_inf K (3-13), then each load (3-14).

    Raises
    ------
    ValueError
        without a point at zero flow, or with fewer points with flow than numbers to find.
    """
    P, Q_d, Q_c = _columns(points)
    still = Q_d <= 0.01
    if not still.any() or (~still).sum() < 2 + free_gamma:
        raise ValueError("the three steps need a point at zero flow and, with flow, as many points as numbers to find")
    drop = P[:, 1] - P[:, 2]
    k_cr = float(drop[still] @ Q_c[still] / (Q_c[still] @ Q_c[still]))

    def misfit(x: Vector) -> Vector:
        k_inf, K = np.exp(x[:2])
        gamma = float(x[2]) if free_gamma else 1.0
        line = return_line((Q_d + Q_c)[~still], float(k_inf), float(K), gamma)
        return np.asarray((k_cr - k_inf * K) * Q_c[~still] + line - drop[~still], dtype=np.float64)

    start = [np.log(0.002), np.log(20.0), *([1.0] if free_gamma else [])]
    x = least_squares(misfit, start).x
    k_inf, K = (float(v) for v in np.exp(x[:2]))
    gamma = float(x[2]) if free_gamma else 1.0
    return Bench(k_cr, k_cr - k_inf * K, k_inf, K, gamma, _loads(points, (k_inf, K, gamma)))


def at_once(points: Sequence[BenchPoint], free_gamma: bool = False) -> Bench:
    """All resistances from all points together: every case pressure weighs the same, zero flow or not (J of 3-11).

    The loads drop out: one measured delivery decides each. Raises ``ValueError`` with fewer points than numbers to find.
    """
    P, Q_d, Q_c = _columns(points)
    if len(points) < 3 + free_gamma:
        raise ValueError("needs as many points as numbers to find")
    drop = P[:, 1] - P[:, 2]

    def misfit(x: Vector) -> Vector:
        k_c, k_inf, K = np.exp(x[:3])
        line = return_line(Q_d + Q_c, float(k_inf), float(K), float(x[3]) if free_gamma else 1.0)
        return np.asarray(k_c * Q_c + line - drop, dtype=np.float64)

    start = [np.log(0.3), np.log(0.002), np.log(20.0), *([1.0] if free_gamma else [])]
    x = least_squares(misfit, start).x
    k_c, k_inf, K = (float(v) for v in np.exp(x[:3]))
    gamma = float(x[3]) if free_gamma else 1.0
    limit = k_inf * K if gamma > 0.0 else 0.0
    return Bench(k_c + limit, k_c, k_inf, K, gamma, _loads(points, (k_inf, K, gamma)))


def drain_and_lines(campaigns: Sequence[Sequence[BenchPoint]]) -> tuple[Drain, tuple[Bench, ...]]:
    """One laminar-turbulent drain for campaigns of several temperatures, each with a return line of its own (gamma 1).

    All pressures are fitted at once; a and b are not negative. ``k_c`` and ``k_cr`` of the benches are NaN: the drain has no
    constant resistance. Raises ``ValueError`` where a campaign has fewer than four points.
    """
    if any(len(points) < 4 for points in campaigns):
        raise ValueError("needs four points of each temperature: two numbers of the drain, two of the return line")
    tables = [(*_columns(points), np.array([p.viscosity_cst for p in points])) for points in campaigns]

    def misfit(x: Vector) -> Vector:
        a, b = np.exp(x[:2])
        found = []
        for (P, Q_d, Q_c, nu), (log_k, log_K) in zip(tables, x[2:].reshape(-1, 2), strict=True):
            line = return_line(Q_d + Q_c, float(np.exp(log_k)), float(np.exp(log_K)), 1.0)
            found.append((a * nu + b * np.abs(Q_c)) * Q_c + line - (P[:, 1] - P[:, 2]))
        return np.concatenate(found)

    start = [np.log(0.01), np.log(0.2), *([np.log(0.002), np.log(20.0)] * len(campaigns))]
    x = least_squares(misfit, start).x
    lines = []
    for points, (log_k, log_K) in zip(campaigns, x[2:].reshape(-1, 2), strict=True):
        line = (float(np.exp(log_k)), float(np.exp(log_K)), 1.0)
        lines.append(Bench(np.nan, np.nan, *line, _loads(points, line)))
    return Drain(float(np.exp(x[0])), float(np.exp(x[1])), 0.0), tuple(lines)


def case_flows(points: Sequence[BenchPoint], bench: Bench, drain: Drain | None = None) -> Vector:
    """Case flow [L/min] that a bench gives at the measured pressures and deliveries, shape (m,); ``bench.k_c`` by default."""
    law = Drain(0.0, 0.0, bench.k_c) if drain is None else drain

    def flow(p: BenchPoint) -> float:
        def excess(Q: float) -> float:
            P_i = p.reservoir_pressure_bar + float(
                return_line(np.array([p.discharge_flow_lpm + Q]), bench.k_inf, bench.K, bench.gamma)[0]
            )
            return law.flow(p.case_pressure_bar - P_i, p.viscosity_cst) - Q

        return float(brentq(excess, -50.0, 50.0))

    return np.array([flow(p) for p in points])


def _columns(points: Sequence[BenchPoint]) -> tuple[Vector, Vector, Vector]:
    """Pressures (m, 3), deliveries (m,), case flows (m,)."""
    table = np.array(points, dtype=np.float64).reshape(len(points), len(BenchPoint._fields))
    return table[:, :3], table[:, 3], table[:, 4]


def _loads(points: Sequence[BenchPoint], line: tuple[float, float, float]) -> tuple[float, ...]:
    P, Q_d, Q_c = _columns(points)
    across = P[:, 0] - P[:, 2] - return_line(Q_d + Q_c, *line)
    return tuple(float(dP / Q**2) if Q > 0.01 else 0.0 for dP, Q in zip(across, Q_d, strict=True))
