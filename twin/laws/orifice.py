"""Turbulent and transitional flow through orifices (section 2.4.2, equations 2-3 to 2-8)."""

import math

from twin.compiled import compiled


@compiled
def viersma_coefficient(Re: float, delta_Re: float, C_d_inf: float) -> float:
    """Discharge coefficient by Viersma [-]: ``delta_Re sqrt(Re)`` up to the transition, then constant (2-4, 2-5).

    Not called by the pump yet: its orifices are turbulent but for a secant near zero.
    """
    return min(delta_Re * math.sqrt(max(Re, 0.0)), C_d_inf)


@compiled
def flow_number(P_0: float, P_1: float, d_h: float, rho: float, nu: float) -> float:
    """Flow number lambda of an orifice of hydraulic diameter d_h [-] (2-8).

    Not called by the pump yet: only ``orifice_flow`` asks for it.
    """
    return d_h / nu * math.sqrt(2.0 / rho * abs(P_0 - P_1))


@compiled
def tanh_coefficient(flow_number_: float, lambda_crit: float, C_q_inf: float) -> float:
    """Flow coefficient [-] (2-7), with the tanh kept above lambda_crit too.

    As printed the coefficient jumps by 3.6 % at lambda_crit; without the switch it is smooth everywhere.

    Not called by the pump yet: only ``orifice_flow`` asks for it.
    """
    return C_q_inf * math.tanh(2.0 * flow_number_ / lambda_crit)


@compiled
def orifice_flow(
    P_0: float, P_1: float, area: float, d_h: float, rho: float, nu: float, C_q_inf: float, lambda_crit: float
) -> float:
    """Flow through an orifice [m3/s] (2-6 at one density), odd in the pressure difference and smooth at zero.

    Not called by the pump yet: it takes ``smooth_orifice_conductance``.
    """
    C_q = tanh_coefficient(flow_number(P_0, P_1, d_h, rho, nu), lambda_crit, C_q_inf)
    flow = C_q * area * math.sqrt(2.0 / rho * abs(P_0 - P_1))
    return flow if P_0 >= P_1 else -flow


@compiled
def smooth_orifice_conductance(dP: float, C_q_area: float, rho: float, dP_laminar: float) -> float:
    """Secant conductance Q / dP of an orifice [m3/s/Pa], laminar below ``dP_laminar`` and turbulent above.

    ``C_q A sqrt(2/rho) / (dP^2 + dP_laminar^2)^(1/4)``: the limits of 2-6 with 2-7 in one square root of a root,
    without the tanh; for ports that a simulation evaluates by the million.
    """
    return C_q_area * math.sqrt(2.0 / (rho * math.sqrt(dP * dP + dP_laminar * dP_laminar)))


@compiled
def turbulent_flow(P_0: float, P_1: float, C_q_area: float, rho: float) -> float:
    """Fully turbulent flow [m3/s] (2-3 made odd), ``C_q_area`` being flow coefficient times area [m2].

    Not called by the pump yet: it takes ``smooth_orifice_conductance``.
    """
    flow = C_q_area * math.sqrt(2.0 / rho * abs(P_0 - P_1))
    return flow if P_0 >= P_1 else -flow
