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
from twin.laws.compressibility import medium_of, relative_density
from twin.laws.fluid import (
    P_ATMOSPHERE,
    Fluid,
    density,
    dynamic_viscosity,
    gap_viscosity,
    kinematic_viscosity,
    throttling_heating,
)
from twin.laws.gap import annular_gap_flow, land_conductance, port_plate_gap_flow, throttled_land_flow
from twin.parameters import Circuit, Pump
from twin.parts.circuit import P_COUNTED, counted_conductance
from twin.parts.compensator import bleed_conductance, edge_of, inlet, jet_stiffness, outlet
from twin.parts.drive import friction_torque
from twin.parts.piston import chamber_volume, volume_by_tilt
from twin.parts.port_plate import commutation_angle
from twin.parts.servo import carried_inertia, rate_arm, rate_leakage, spring_torque, stroking_arm, stroking_leakage
from twin.parts.swashplate import inertia_torque, vibration
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

_LPM = M3_PER_S_PER_LPM
_BAR = PA_PER_BAR
_T_0 = KELVIN_AT_0_DEGC
_RPM = RAD_PER_S_PER_RPM
_DEG = RAD_PER_DEG

Vector = NDArray[np.float64]


@compiled
def drain_viscosity_ratio(fluid: Fluid, T_c: float) -> float:
    """Viscosity of the case's fluid over that of the reference bench: 50 degC plus the heating from 175 bar [-]."""
    return kinematic_viscosity(fluid, T_c) / kinematic_viscosity(
        fluid, T_50 + throttling_heating(fluid, T_50, P_COUNTED, 0.0)
    )


@compiled
def control_pressure_difference(pump: Pump, s: float, omega: float, dP: float, delays: float) -> float:
    """Control minus case pressure that the plate's torque balance asks for at tilt coordinate s [Pa].

    Rate spring and piston inertia drive the tilt up; the commutation delay and the stroking piston down.
    ``delays`` is the sum of the sines of the commutation angles at both dead centres: the pressure of a chamber is
    up from one to the other, and the mean of the piston's torque arm over that half turn is minus their sum.
    Beyond the stop the difference falls off exponentially, continuous in value and slope, and never negative.
    """
    servo, piston = pump.servo, pump.piston
    alpha_max = pump.swashplate.alpha_max
    alpha = min(s, alpha_max)
    t = math.tan(alpha)
    commutation = piston.n / (2.0 * math.pi) * delays * volume_by_tilt(piston, t, 1.0) * dP
    torque = spring_torque(servo, math.tan(alpha_max), t) + inertia_torque(piston, t, omega) - commutation
    torque += rate_arm(servo, t) * dP
    held = torque / stroking_arm(servo, t)
    beyond = s - alpha_max
    if beyond <= 0.0:
        return held
    slope = servo.k_rate * servo.L_rate**2 * (1.0 + t * t) / (servo.A_stroke * servo.L_stroke)
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
    servo, medium = pump.servo, medium_of(pump.fluid, T)
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
    r_d, r_s = relative_density(medium, P_d), relative_density(medium, P_s)
    Q_pump = piston.n * omega / (2.0 * math.pi) * (r_s * V_max - r_d * V_min)

    half = 0.5 * piston.n
    scale = row[5]
    l_mean = math.sqrt(piston.l_mean**2 - (piston.R * t) ** 2)
    k_piston, e = scale * row[7], piston.e_rel * piston.b
    C_A = slipper.C_q * 0.25 * math.pi * slipper.d_throttle**2
    k_slipper = scale * row[6]
    G_d = land_conductance(mu_d, slipper.h, slipper.diameter_ratio)
    G_s = land_conductance(mu_s, slipper.h, slipper.diameter_ratio)
    # leaks of one chamber at either pressure
    ring_d = k_piston * annular_gap_flow(P_d, P_c, mu_d, piston.d_p, piston.b, l_mean, e, 0.0)
    ring_s = k_piston * annular_gap_flow(P_s, P_c, mu_s, piston.d_p, piston.b, l_mean, e, 0.0)
    land_d = k_slipper * throttled_land_flow(P_d, P_c, G_d, C_A, rho)
    land_s = k_slipper * throttled_land_flow(P_s, P_c, G_s, C_A, rho)
    v_mean = 2.0 * piston.R * t * omega / math.pi
    drag = half * 0.5 * v_mean * piston.b * math.pi * piston.d_p
    k_plate = scale * row[8]
    plate_d = k_plate * port_plate_gap_flow(P_d, P_c, mu_d, plate.h, plate.shape)
    throttled = row[16] * _LPM * math.sqrt(max(P_d - P_c, 0.0) / P_COUNTED)
    plate_s = k_plate * port_plate_gap_flow(P_s, P_c, mu_s, plate.h, plate.shape)

    swing = 0.5 * (V_max - V_min)
    # the plate vibrates in step with the commutations: it comes down on the chamber that is about to be filled, and
    # each chamber that has changed over throws it back
    arm = volume_by_tilt(piston, t, 1.0)
    stiffness = stroking_arm(servo, t) ** 2 * medium.B_0 / pump.volumes.control
    step = arm * (P_d - P_s)
    J = pump.swashplate.J + carried_inertia(servo, t)
    shaking = vibration(piston.n, J, pump.swashplate.damping, stiffness, step, omega)
    leaking = ring_d + land_d
    v_0 = math.sqrt(2.0 * max(P_d - P_s, 1.0) / rho)
    strain = max(r_d - r_s, 1.0e-9)
    rising = commutation_angle(plate, V_max * strain, swing, leaking, 0.0, arm, shaking, v_0, omega)
    falling = commutation_angle(plate, V_min * strain, swing, leaking, 1.0, arm, shaking, v_0, omega)
    # a chamber is under pressure from one commutation to the other
    high = half + piston.n / (2.0 * math.pi) * (falling - rising)
    piston_d, piston_s = high * ring_d, (piston.n - high) * ring_s
    slipper_d, slipper_s = high * land_d, (piston.n - high) * land_s
    delays = math.sin(rising) + math.sin(falling)
    dP_ctrl = control_pressure_difference(pump, s, omega, P_d - P_s, delays)
    P_ctrl = P_c + dP_ctrl
    nu = kinematic_viscosity(fluid, T)
    edge = edge_of(comp, row[17] * 1.0e-6)
    mu_in, mu_out = gap_viscosity(fluid, T, P_d, P_ctrl), gap_viscosity(fluid, T, P_ctrl, P_c)
    inflow = inlet(comp, edge, x, P_d - P_ctrl, rho, mu_in, nu)[0] * (P_d - P_ctrl)
    out_spool = outlet(comp, edge, x, dP_ctrl, rho, mu_out, nu)[0] * dP_ctrl
    out_stroke = (stroking_leakage(servo, mu_out) + bleed_conductance(comp, dP_ctrl, rho)) * dP_ctrl
    # a bleed is counted in L/min at the control pressure of the zero-flow point and fades with it
    bleed_extra = row[9] * _LPM * math.tanh(dP_ctrl / (0.05 * servo.F_rate / servo.A_stroke))
    rate_leak = rate_leakage(servo, mu_d) * (P_d - P_c)
    Q_comp = out_spool + out_stroke + bleed_extra + rate_leak

    leak_d = piston_d - drag + slipper_d + plate_d + throttled + rate_leak
    leak_s = piston_s + drag + slipper_s + plate_s
    Q_c = leak_d + leak_s + Q_comp - rate_leak
    k_c = circuit.k_c * (1.0 + circuit.k_c_slope * (T - circuit.T_ref)) * row[12]
    k_inf = circuit.k_inf * (1.0 + circuit.k_inf_slope * (T - circuit.T_ref))
    K = circuit.K * (1.0 + circuit.K_slope * (T - circuit.T_ref))
    # the leak of the circuit, counted at 175 bar, ends in the return line, whose pressure hardly matters to it
    Q_sys = counted_conductance(P_d - P_r, row[10] * _LPM) * (P_d - P_r)
    P_i = P_r + return_pressure_drop(Q_L + Q_sys + circuit.shared * Q_c, k_inf, K, circuit.gamma)
    P_down = P_i if circuit.shared > 0.5 else P_r
    T_c = T + throttling_heating(fluid, T, P_d, P_c)
    nu_ratio = drain_viscosity_ratio(pump.fluid, T_c) if circuit.w_nu + row[13] != 0.0 else 1.0
    drop = drain_pressure_drop(Q_c, k_c, circuit.w_nu + row[13], circuit.w_Q + row[14], nu_ratio, circuit.Q_ref)

    jet = jet_stiffness(comp, edge, x, P_d - P_ctrl)[0]
    preload = comp.F_preload * (1.0 - comp.spring_softening * (T - T_50)) + row[11] * _BAR * comp.A_spool
    spring = preload + comp.k_spool * comp.x_zero + comp.k_spool * row[15] * (x - comp.x_zero)

    F[0] = Q_pump - leak_d - inflow - Q_L - Q_sys
    F[1] = P_c - P_down - drop
    F[2] = (P_d - P_c) * comp.A_spool - spring - jet
    F[3] = inflow - out_spool - out_stroke - bleed_extra
    F[4] = P_d - P_i - k_d * Q_L * abs(Q_L) if k_d > 0.0 else Q_L - row[3] * _LPM

    mu_ratio = dynamic_viscosity(fluid, T, P_ATMOSPHERE) / dynamic_viscosity(fluid, T_50, P_ATMOSPHERE)
    torque = Q_pump * (P_d - P_s) / omega + friction_torque(pump.drive, mu_ratio, omega / OMEGA_REF, P_d - P_c)

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
    Y[13] = T_c - _T_0
