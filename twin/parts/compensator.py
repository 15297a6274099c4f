"""Compensator valve: spool, metering edges and bleed. Ports: discharge, control volume, case; spring setting.

The spool opens the control volume to discharge for x > 0 and to the case for x < 0; discharge minus case pressure
pushes it up, the spring and the jet push it down.
"""

import math

from twin.compiled import compiled
from twin.laws.metering_edge import SMOOTH, Edge, edge_conductance
from twin.laws.orifice import smooth_orifice_conductance
from twin.parameters import Compensator

_DP_LAMINAR = 1.0e3


@compiled
def edge_of(comp: Compensator, rounding: float) -> Edge:
    """Both metering edges, ``rounding`` [m] being what erosion has added to their radius (section 2.5.2.1)."""
    n = comp.n_edge
    if comp.edge_law == SMOOTH:
        # the smooth law's one length is c + X_0; leakage past the closed edge has seals of its own
        return Edge(n, comp.w_edge / n, comp.c_edge, rounding, comp.C_q, 0.0, 1.0, 0.0)
    radius = comp.edge_radius + rounding
    lambda_crit = comp.C_q / comp.delta_lambda
    return Edge(n, comp.w_edge / n, comp.c_spool, radius, comp.C_q, comp.delta_lambda, lambda_crit, comp.K_rec)


@compiled
def seal_conductance(comp: Compensator, mu: float, length: float) -> float:
    """Leakage of the spool's clearance beside the slots [m3/s/Pa] (2-9): the published edge laws hold their own."""
    if comp.edge_law != SMOOTH:
        return 0.0
    eccentric = 1.0 + 1.5 * comp.e_rel * comp.e_rel
    return math.pi * comp.d_spool * comp.c_spool**3 / (12.0 * mu * length) * eccentric


@compiled
def inlet(comp: Compensator, edge: Edge, x: float, dP: float, rho: float, mu: float, nu: float) -> tuple[float, float]:
    """Passage from discharge to the control volume: conductance [m3/s/Pa] and slope by spool position [m2/s]."""
    G, slope = edge_conductance(comp.edge_law, edge, x - comp.x_overlap, dP, rho, nu)
    return G + seal_conductance(comp, mu, comp.l_seal_discharge), slope


@compiled
def outlet(comp: Compensator, edge: Edge, x: float, dP: float, rho: float, mu: float, nu: float) -> tuple[float, float]:
    """Passage from the control volume to the case over the spool: conductance and slope by spool position."""
    G, slope = edge_conductance(comp.edge_law, edge, -x - comp.x_overlap, dP, rho, nu)
    return G + seal_conductance(comp, mu, comp.l_seal_case), -slope


@compiled
def bleed_conductance(comp: Compensator, dP: float, rho: float) -> float:
    """Fixed orifice from the control volume to the case [m3/s/Pa]."""
    return smooth_orifice_conductance(dP, comp.C_q * 0.25 * math.pi * comp.d_bleed**2, rho, _DP_LAMINAR)


@compiled
def jet_stiffness(comp: Compensator, edge: Edge, x: float, dP: float) -> tuple[float, float]:
    """Steady jet force of the inlet edge against the spool's opening [N] (2-21) and its slope by position [N/m]."""
    X = x - comp.x_overlap
    root = math.sqrt(X * X + (edge.c + edge.X_0) ** 2)
    opening = 0.5 * (X + root) if X > 0.0 else 0.5 * (edge.c + edge.X_0) ** 2 / (root - X)
    per_opening = 2.0 * comp.C_q * comp.cos_jet * comp.w_edge * dP
    return per_opening * opening, per_opening * opening / root


@compiled
def transient_jet_damping(comp: Compensator, x: float, dP: float, rho: float) -> float:
    """Damping of the transient jet force [N s/m] (2-22, first term), only while the inlet edge is open."""
    if comp.L_jet == 0.0 or x <= comp.x_overlap or dP <= 0.0:
        return 0.0
    return comp.L_jet * comp.C_q * comp.w_edge * math.sqrt(2.0 * rho * dP)


@compiled
def spool_stop(comp: Compensator, x: float) -> tuple[float, float]:
    """Force of the spool's stops [N], positive upwards, and its stiffness [N/m]."""
    if x < comp.x_low:
        return comp.k_stop * (comp.x_low - x), comp.k_stop
    if x > comp.x_high:
        return -comp.k_stop * (x - comp.x_high), comp.k_stop
    return 0.0, 0.0
