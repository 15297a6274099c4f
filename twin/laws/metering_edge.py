"""Flow across a metering edge of a spool, open or overlapped (section 2.5.1.1.1): three rival laws, and a smooth one.

``X`` is the underlap [m] (2-15): positive when open, negative when overlapped. All laws are odd in the pressure
difference and continuous at X = 0. ``c`` is the radial clearance of the spool.
"""

import math
from typing import NamedTuple

from twin.compiled import compiled


class Edge(NamedTuple):
    """Geometry and coefficients of one metering edge.

    ``n`` notches of length ``l`` (Mare, Attar) or ``n`` holes of diameter ``l`` (AMESim); ``X_0`` is the rounding
    of the edges, which erosion increases (2-17); ``delta_lambda`` the laminar constant, ``lambda_crit`` and
    ``K_rec`` those of Attar's law.
    """

    n: float
    l: float  # noqa: E741 - the field's symbol
    c: float
    X_0: float
    C_q: float
    delta_lambda: float
    lambda_crit: float
    K_rec: float


SMOOTH, MARE, AMESIM, ATTAR = 0, 1, 2, 3
"""Codes of the rival laws."""
_DX = 1.0e-8
"""Half of the difference over which a published law's slope by the underlap is taken [m]."""
_DP_LAMINAR = 1.0e3
"""Pressure difference below which a turbulent edge counts as laminar [Pa]."""


@compiled
def _speed(dP: float, rho: float) -> float:
    return math.sqrt(2.0 / rho * abs(dP))


@compiled
def _odd(flow: float, dP: float) -> float:
    return flow if dP >= 0.0 else -flow


@compiled
def generating_length(X: float, X_0: float, c: float) -> float:
    """Length X_s of the opening between rounded edges [m] (2-17); c at X = 0."""
    return math.sqrt(X * X + (X_0 + c) ** 2) - X_0


@compiled
def continuity_length(edge: Edge) -> float:
    """Length K_g that makes open and overlapped flow meet at X = 0 [m].

    Exactly c (l + c) / (48 delta_lambda l); the printed c / (48 delta_lambda) is its limit for wide notches.
    """
    return edge.c * (edge.l + edge.c) / (48.0 * edge.delta_lambda * edge.l)


@compiled
def mare_flow(edge: Edge, X: float, dP: float, rho: float, nu: float) -> float:
    """Notched sleeve (2-16, 2-17; Mare 1993) [m3/s].

    Mended: the sign of dP stands outside the root and not in lambda at all; K_g is a length.
    """
    if X <= 0.0:
        return edge.n * edge.l * edge.c**3 / (12.0 * rho * nu * (continuity_length(edge) - X)) * dP
    X_s = generating_length(X, edge.X_0, edge.c)
    S = edge.n * edge.l * X_s
    lam = 2.0 * S / (edge.n * nu * (edge.l + X_s)) * _speed(dP, rho)
    C_q = min(edge.delta_lambda * lam, edge.C_q)
    return _odd(C_q * S * _speed(dP, rho), dP)


@compiled
def hole_opening(x: float, d: float) -> float:
    """Open area of a round hole uncovered by x [m2]: a circular segment, the whole disc from x = d on."""
    if x <= 0.0:
        return 0.0
    if x >= d:
        return 0.25 * math.pi * d * d
    r = 0.5 * d
    return r * r * math.acos(1.0 - x / r) - (r - x) * math.sqrt(x * (d - x))


@compiled
def hole_overlap_length(overlap: float, d: float) -> float:
    """Mean leakage length X of an overlapped round hole [m] (2-19), 0 at the edge and negative beyond.

    Printed with ``delta`` in the denominator; it is the same overlap delta_p.
    """
    if overlap <= 0.0:
        return 0.0
    return -math.sqrt(overlap * (overlap + d)) / math.atan(math.sqrt((overlap + d) / overlap))


@compiled
def amesim_flow(edge: Edge, X: float, dP: float, rho: float, nu: float) -> float:
    """Round holes (2-18, 2-19; Simcenter AMESim) [m3/s].

    Mended: K_g - X in the denominator (the printed sum is singular). Open, the clearance flow at X = 0 goes on
    beside the orifice's, so that the law is continuous.
    """
    overlap_length = hole_overlap_length(-X, edge.l) if X < 0.0 else 0.0
    gap = edge.n * 2.0 * edge.l * edge.c**3 / (12.0 * rho * nu * (continuity_length(edge) - overlap_length)) * dP
    if X <= 0.0:
        return gap
    S = edge.n * hole_opening(X, edge.l)
    d_h = min(X, edge.l)
    C_q = edge.C_q * math.tanh(2.0 * d_h / nu * _speed(dP, rho) / edge.lambda_crit)
    return gap + _odd(C_q * S * _speed(dP, rho), dP)


@compiled
def attar_flow(edge: Edge, X: float, dP: float, rho: float, nu: float) -> float:
    """One law for open and overlapped edges (2-20; Attar 2008) [m3/s], K_rec in 1/m."""
    X_s = generating_length(max(X, 0.0), edge.X_0, edge.c)
    S = edge.n * edge.l * X_s
    lam = 2.0 * S / (edge.n * nu * (edge.l + X_s)) * _speed(dP, rho)
    C_q = edge.C_q * math.tanh(lam / edge.lambda_crit / (1.0 + 0.5 * edge.K_rec * (abs(X) - X)))
    return _odd(C_q * S * _speed(dP, rho), dP)


@compiled
def smooth_opening(X: float, c: float) -> tuple[float, float]:
    """Opening of a rounded edge [m] and its slope: X when open, c^2/(4|X|) when overlapped, smooth in between.

    Our own law: the opening of 2-17 without its kink at X = 0, for solvers that differentiate.
    """
    root = math.sqrt(X * X + c * c)
    opening = 0.5 * (X + root) if X > 0.0 else 0.5 * c * c / (root - X)
    return opening, opening / root


@compiled
def edge_flow(law: float, edge: Edge, X: float, dP: float, rho: float, nu: float) -> float:
    """Flow by the law of the given code [m3/s]; the smooth law is turbulent throughout."""
    if law == SMOOTH:
        return _odd(edge.C_q * edge.n * edge.l * smooth_opening(X, edge.c + edge.X_0)[0] * _speed(dP, rho), dP)
    if law == MARE:
        return mare_flow(edge, X, dP, rho, nu)
    if law == AMESIM:
        return amesim_flow(edge, X, dP, rho, nu)
    return attar_flow(edge, X, dP, rho, nu)


@compiled
def edge_conductance(law: float, edge: Edge, X: float, dP: float, rho: float, nu: float) -> tuple[float, float]:
    """Secant conductance Q / dP [m3/s/Pa] and slope of the flow by the underlap dQ/dX [m2/s]."""
    if law == SMOOTH:
        opening, slope = smooth_opening(X, edge.c + edge.X_0)
        root = math.sqrt(dP * dP + _DP_LAMINAR * _DP_LAMINAR)
        per_opening = edge.C_q * edge.n * edge.l * math.sqrt(2.0 / (rho * root))
        return per_opening * opening, per_opening * slope * dP
    span = dP if abs(dP) > _DP_LAMINAR else _DP_LAMINAR
    G = edge_flow(law, edge, X, span, rho, nu) / span
    rise = edge_flow(law, edge, X + _DX, dP, rho, nu) - edge_flow(law, edge, X - _DX, dP, rho, nu)
    return G, rise / (2.0 * _DX)
