"""Kernel of the operating point: residuals and outputs of the cycle-averaged steady pump in its circuit.

Five unknowns: discharge pressure P_d, case pressure P_c, tilt coordinate s, spool position x, load flow Q_L.
Up to the tilt stop s is the tilt alpha itself; beyond it alpha stays at the stop and s measures how far the
control pressure has fallen below what would hold the plate there, so that the regulated and the fully tilted
pump are one smooth problem.

Averages over a revolution, all derived: half of the pistons see P_d and half the suction pressure, changing over
at the commutation angles of ``twin.parts.port_plate``; the mean of
1/length over a stroke is ``1/sqrt(l^2 - (R tan alpha)^2)``; the drag (Couette) flow of a piston has no mean
over a revolution but carries fluid from the discharge to the suction half. Flows count volume at ambient
density, so that mass is conserved although the fluid is compressible.
"""

import math

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled
from twin.laws.bench import drain_pressure_drop, return_pressure_drop
from twin.laws.fluid import P_ATMOSPHERE, bulk_modulus, density, dynamic_viscosity, gap_viscosity, kinematic_viscosity
from twin.laws.gap import annular_gap_flow, land_conductance, port_plate_gap_flow, throttled_land_flow
from twin.laws.orifice import turbulent_flow
from twin.parameters import Circuit, Compensator, Pump
from twin.parts.piston import chamber_volume, volume_by_tilt
from twin.parts.port_plate import commutation_angle
from twin.parts.swashplate import commutation_tilt_rate, inertia_torque, spring_torque, stroking_arm
from twin.units import (
    KELVIN_AT_0_DEGC,
    M3_PER_S_PER_LPM,
    PA_PER_BAR,
    RAD_PER_DEG,
    RAD_PER_S_PER_RPM,
)

N_UNKNOWNS = 5
T_50 = KELVIN_AT_0_DEGC + 50.0
OMEGA_REF = 4600.0 * RAD_PER_S_PER_RPM
P_THROTTLED = 175.0 * PA_PER_BAR

_LPM = M3_PER_S_PER_LPM
_BAR = PA_PER_BAR
_T_0 = KELVIN_AT_0_DEGC
_RPM = RAD_PER_S_PER_RPM
_DEG = RAD_PER_DEG

Vector = NDArray[np.float64]


@compiled
def edge_opening(y: float, c: float) -> tuple[float, float]:
    """Opening of a metering edge at underlap y with rounding c [m], and its slope: y when open, c^2/(4|y|) closed."""
    root = math.sqrt(y * y + c * c)
    opening = 0.5 * (y + root) if y > 0.0 else 0.5 * c * c / (root - y)
    return opening, opening / root


@compiled
def control_flows(
    comp: Compensator, P_d: float, P_ctrl: float, P_c: float, x: float, rho: float, mu_in: float, mu_out: float
) -> tuple[float, float, float]:
    """Flows at the control volume [m3/s]: in from discharge, out over the spool, out past the stroking piston."""
    w = comp.C_q * comp.w_edge
    inflow = turbulent_flow(P_d, P_ctrl, w * edge_opening(x - comp.x_overlap, comp.c_edge)[0], rho)
    inflow += annular_gap_flow(P_d, P_ctrl, mu_in, comp.d_spool, comp.c_spool, comp.l_seal_discharge, 0.0, 0.0)
    out_spool = turbulent_flow(P_ctrl, P_c, w * edge_opening(-x - comp.x_overlap, comp.c_edge)[0], rho)
    out_spool += annular_gap_flow(P_ctrl, P_c, mu_out, comp.d_spool, comp.c_spool, comp.l_seal_case, 0.0, 0.0)
    bleed = turbulent_flow(P_ctrl, P_c, comp.C_q * 0.25 * math.pi * comp.d_bleed**2, rho)
    d_stroke = math.sqrt(4.0 * comp.A_stroke / math.pi)
    stroke = annular_gap_flow(P_ctrl, P_c, mu_out, d_stroke, comp.b_stroke, comp.l_stroke, 0.0, 0.0)
    return inflow, out_spool, bleed + stroke


@compiled
def control_pressure_difference(pump: Pump, s: float, omega: float, dP: float, delays: float) -> float:
    """Control minus case pressure that the plate's torque balance asks for at tilt coordinate s [Pa].

    Rate spring and piston inertia drive the tilt up; the commutation delay and the stroking piston down.
    ``delays`` is the sum of the sines of the commutation angles at both dead centres: the pressure of a chamber is
    up from one to the other, and the mean of the piston's torque arm over that half turn is minus their sum.
    Beyond the stop the difference falls off exponentially, continuous in value and slope, and never negative.
    """
    comp, piston = pump.compensator, pump.piston
    alpha_max = pump.swashplate.alpha_max
    alpha = min(s, alpha_max)
    t = math.tan(alpha)
    commutation = piston.n / (2.0 * math.pi) * delays * volume_by_tilt(piston, t, 1.0) * dP
    torque = spring_torque(comp, alpha_max, alpha) + inertia_torque(piston, alpha, omega) - commutation
    held = torque / stroking_arm(comp, alpha)
    beyond = s - alpha_max
    if beyond <= 0.0:
        return held
    slope = comp.k_rate * comp.L_rate**2 * (1.0 + t * t) / (comp.A_stroke * comp.L_stroke)
    return held * math.exp(-beyond * slope / held)


@compiled
def evaluate(pump: Pump, circuit: Circuit, row: Vector, k_d: float, u: Vector, F: Vector, Y: Vector) -> None:
    """Residuals F (5,) and outputs Y (len(OUTPUTS),) at unknowns u (5,).

    ``row`` is one row of inputs in the order of ``twin.condition.INPUTS`` (edge units); ``k_d`` > 0 sets the
    load by equation 3-2 [Pa/(m3/s)^2], else the discharge flow of the row is imposed. F is in flow, Pa and N.
    """
    omega = row[0] * _RPM
    T = row[1] + _T_0
    P_amb = row[4] * _BAR
    P_r = row[2] * _BAR + P_amb
    P_d, P_c, s, x, Q_L = u[0], u[1], u[2], u[3], u[4]
    piston, slipper, plate, comp, fluid = pump.piston, pump.slipper, pump.port_plate, pump.compensator, pump.fluid
    P_s = P_r
    alpha = min(s, pump.swashplate.alpha_max)
    t = math.tan(alpha)
    t_max = math.tan(pump.swashplate.alpha_max)
    rho = density(fluid, T, P_ATMOSPHERE)
    mu_d = gap_viscosity(fluid, T, P_d, P_c)
    mu_s = gap_viscosity(fluid, T, P_s, P_c)

    # delivery: what the chambers take in at P_s minus what they carry back at P_d
    V_min = chamber_volume(piston, t_max, t, -1.0)
    V_max = chamber_volume(piston, t_max, t, 1.0)
    r_d = density(fluid, T, P_d) / rho
    r_s = density(fluid, T, P_s) / rho
    Q_pump = piston.n * omega / (2.0 * math.pi) * (r_s * V_max - r_d * V_min)

    half = 0.5 * piston.n
    scale = row[5]
    l_mean = math.sqrt(piston.l_mean**2 - (piston.R * t) ** 2)
    k_piston = scale * row[7]
    piston_d = k_piston * half * annular_gap_flow(P_d, P_c, mu_d, piston.d_p, piston.b, l_mean, 0.0, 0.0)
    piston_s = k_piston * half * annular_gap_flow(P_s, P_c, mu_s, piston.d_p, piston.b, l_mean, 0.0, 0.0)
    v_mean = 2.0 * piston.R * t * omega / math.pi
    drag = half * 0.5 * v_mean * piston.b * math.pi * piston.d_p
    C_A = slipper.C_q * 0.25 * math.pi * slipper.d_throttle**2
    k_slipper = scale * row[6]
    G_d = land_conductance(mu_d, slipper.h, slipper.diameter_ratio)
    G_s = land_conductance(mu_s, slipper.h, slipper.diameter_ratio)
    slipper_d = k_slipper * half * throttled_land_flow(P_d, P_c, G_d, C_A, rho)
    slipper_s = k_slipper * half * throttled_land_flow(P_s, P_c, G_s, C_A, rho)
    k_plate = scale * row[8]
    plate_d = k_plate * port_plate_gap_flow(P_d, P_c, mu_d, plate.h, plate.shape)
    throttled = row[16] * _LPM * math.sqrt(max(P_d - P_c, 0.0) / P_THROTTLED)
    plate_s = k_plate * port_plate_gap_flow(P_s, P_c, mu_s, plate.h, plate.shape)

    B = bulk_modulus(fluid, T, P_ATMOSPHERE)
    swing = 0.5 * (V_max - V_min)
    # the plate vibrates in step with the commutations: it comes down on the chamber that is about to be filled
    arm = volume_by_tilt(piston, t, 1.0)
    stiffness = stroking_arm(comp, alpha) ** 2 * B / pump.volumes.control
    step = arm * (P_d - P_s)
    coming = commutation_tilt_rate(piston.n, pump.swashplate.J, pump.swashplate.damping, stiffness, step, omega)
    stroked = -arm * coming
    leaking = (piston_d + slipper_d) / half
    rising = commutation_angle(plate, V_max, swing, stroked, P_d - P_s, B, rho, omega)
    falling = commutation_angle(plate, V_min, swing, stroked + leaking, P_d - P_s, B, rho, omega)
    delays = math.sin(rising) + math.sin(falling)
    dP_ctrl = control_pressure_difference(pump, s, omega, P_d - P_s, delays)
    P_ctrl = P_c + dP_ctrl
    inflow, out_spool, out_stroke = control_flows(
        comp, P_d, P_ctrl, P_c, x, rho, gap_viscosity(fluid, T, P_d, P_ctrl), gap_viscosity(fluid, T, P_ctrl, P_c)
    )
    # a bleed is counted in L/min at the control pressure of the zero-flow point and fades with it
    bleed_extra = row[9] * _LPM * math.tanh(dP_ctrl / (0.05 * comp.F_rate / comp.A_stroke))
    Q_comp = out_spool + out_stroke + bleed_extra

    leak_d = piston_d - drag + slipper_d + plate_d + throttled
    leak_s = piston_s + drag + slipper_s + plate_s
    Q_c = leak_d + leak_s + Q_comp
    Q_sys = row[10] * _LPM
    k_c = circuit.k_c * (1.0 + circuit.k_c_slope * (T - circuit.T_ref)) * row[12]
    k_inf = circuit.k_inf * (1.0 + circuit.k_inf_slope * (T - circuit.T_ref))
    K = circuit.K * (1.0 + circuit.K_slope * (T - circuit.T_ref))
    P_i = P_r + return_pressure_drop(Q_L + Q_sys + circuit.shared * Q_c, k_inf, K, circuit.gamma)
    P_down = P_i if circuit.shared > 0.5 else P_r
    nu_ratio = kinematic_viscosity(fluid, T) / kinematic_viscosity(fluid, T_50)
    drop = drain_pressure_drop(Q_c, k_c, circuit.w_nu + row[13], circuit.w_Q + row[14], nu_ratio, circuit.Q_ref)

    jet = (
        2.0 * comp.C_q * comp.cos_jet * comp.w_edge * edge_opening(x - comp.x_overlap, comp.c_edge)[0] * (P_d - P_ctrl)
    )
    preload = comp.F_preload * (1.0 - comp.spring_softening * (T - T_50)) + row[11] * _BAR * comp.A_spool
    spring = preload + comp.k_spool * comp.x_zero + comp.k_spool * row[15] * (x - comp.x_zero)

    F[0] = Q_pump - leak_d - inflow - Q_L - Q_sys
    F[1] = P_c - P_down - drop
    F[2] = (P_d - P_c) * comp.A_spool - spring - jet
    F[3] = inflow - out_spool - out_stroke - bleed_extra
    F[4] = P_d - P_i - k_d * Q_L * abs(Q_L) if k_d > 0.0 else Q_L - row[3] * _LPM

    mu_ref = dynamic_viscosity(fluid, T_50, P_ATMOSPHERE)
    viscous = pump.friction.torque_viscous_ref * dynamic_viscosity(fluid, T, P_ATMOSPHERE) / mu_ref * omega / OMEGA_REF
    torque = Q_pump * (P_d - P_s) / omega + viscous + pump.friction.torque_pressure * (P_d - P_c)

    Y[0] = (P_d - P_amb) / _BAR
    Y[1] = (P_c - P_amb) / _BAR
    Y[2] = (P_i - P_amb) / _BAR
    Y[3] = (P_ctrl - P_amb) / _BAR
    Y[4] = alpha / _DEG
    Y[5] = Q_L / _LPM
    Y[6] = Q_c / _LPM
    Y[7] = torque
    Y[8] = (piston_d + piston_s) / _LPM
    Y[9] = (slipper_d + slipper_s + throttled) / _LPM
    Y[10] = (plate_d + plate_s) / _LPM
    Y[11] = Q_comp / _LPM
    Y[12] = (Q_pump + leak_s) / _LPM
