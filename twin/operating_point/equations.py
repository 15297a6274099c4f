"""Kernel of the operating point: residuals and outputs of the cycle-averaged steady pump in its circuit.

Five unknowns: discharge pressure P_d, case pressure P_c, tilt coordinate s, spool position x, load flow Q_L.
Up to the tilt stop s is the tilt alpha itself; beyond it alpha stays at the stop and s measures how far the
control pressure has fallen below what would hold the plate there, so that the regulated and the fully tilted
pump are one smooth problem.

Averages over a revolution, all derived: half of the pistons see P_d and half the suction pressure, changing over
at the commutation angles of ``commutation``; the flows of the control volume are means over the ripple of
its pressure, which comes from there too; the mean of
1/length over a stroke is ``1/sqrt(l^2 - (R tan alpha)^2)``; the drag (Couette) flow of a piston has no mean
over a revolution but carries fluid from the discharge to the suction half. Flows count volume at ambient
density, so that mass is conserved although the fluid is compressible.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin import columns as at
from twin.compiled import compiled
from twin.laws.compressibility import P_FLOOR, Medium, medium_of, relative_compressibility, relative_density
from twin.laws.fluid import (
    P_ATMOSPHERE,
    Film,
    Fluid,
    density,
    film_of,
    film_viscosity,
    kinematic_viscosity,
)
from twin.laws.gap import annular_gap_flow, land_conductance, port_plate_gap_flow, throttled_land_flow
from twin.laws.lines import drain_pressure_drop, return_pressure_drop
from twin.laws.metering_edge import Edge
from twin.operating_point.commutation import Change, Commutations, Support, commutations
from twin.parameters import Circuit, Drive, Pump, Slipper
from twin.parts.circuit import P_COUNTED, counted_conductance
from twin.parts.compensator import (
    bleed_conductance,
    edge_of,
    inlet,
    jet_stiffness,
    outlet,
    seal_conductance,
    spool_stop,
)
from twin.parts.drive import OMEGA_REF, case_temperature, friction_torque, viscous_torque
from twin.parts.drive import T_REF as T_50
from twin.parts.piston import chamber_volume, indicated_torque, volume_by_tilt
from twin.parts.servo import (
    bleed_flow,
    carried_inertia,
    rate_arm,
    rate_leakage,
    spring_torque,
    stroking_arm,
    stroking_leakage,
)
from twin.parts.slipper_map import (
    N_AXES,
    NO_SLIPPERS,
    OVER_CASE,
    OVER_SUCTION,
    SPEED,
    SUCTION,
    TEMPERATURE,
    TILT,
    WEAR,
    SlipperMap,
    Slippers,
    mapped,
)
from twin.parts.swashplate import inertia_torque
from twin.units import (
    KELVIN_AT_0_DEGC,
    M3_PER_S_PER_LPM,
    PA_PER_BAR,
    RAD_PER_DEG,
    RAD_PER_S_PER_RPM,
)

U_P_D, U_P_C, U_TILT, U_SPOOL, U_LOAD = range(5)
"""Unknowns: discharge and case pressure [Pa], tilt coordinate s [rad], spool position [m], flow of the load [m3/s]."""
N_UNKNOWNS = 5
DELIVERY, DRAIN, BALANCE, CONTROL, DEMAND = range(5)
"""Residuals: flow of the discharge node [m3/s], pressure at the drain [Pa], force on the spool [N], flow of the control
volume [m3/s], what the load asks for [m3/s, or Pa where it is a resistance]."""

_LPM = M3_PER_S_PER_LPM
_BAR = PA_PER_BAR
_T_0 = KELVIN_AT_0_DEGC
_RPM = RAD_PER_S_PER_RPM
_DEG = RAD_PER_DEG

Vector = NDArray[np.float64]


@compiled
def drain_viscosity_ratio(drive: Drive, fluid: Fluid, Q_ref: float, T_c: float) -> float:
    """Viscosity of the case's fluid over that of the reference bench [-].

    The bench: 50 degC, 4600 rpm, 175 bar, case flow ``Q_ref`` [m3/s]; its case is warmed as any other.
    """
    friction = friction_torque(drive, drive.torque_viscous_ref, P_COUNTED) * OMEGA_REF
    T_bench = case_temperature(drive, fluid, T_50, P_COUNTED, Q_ref, friction)
    return kinematic_viscosity(fluid, T_c) / kinematic_viscosity(fluid, T_bench)


class Warmth(NamedTuple):
    """Properties of the fluid at one temperature, SI, and the viscous drag of the shaft at one speed [N m]."""

    T: float
    rho: float
    nu: float
    medium: Medium
    film: Film
    viscous: float


@compiled
def warmth_of(pump: Pump, row: Vector) -> Warmth:
    """Properties at the temperature and speed of a row of inputs."""
    fluid = pump.fluid
    T = row[at.TEMPERATURE] + _T_0
    viscous = viscous_torque(pump.drive, fluid, T, row[at.SPEED] * _RPM)
    rho, nu = density(fluid, T, P_ATMOSPHERE), kinematic_viscosity(fluid, T)
    return Warmth(T, rho, nu, medium_of(fluid, T), film_of(fluid, T), viscous)


class Passing(NamedTuple):
    """What a revolution adds to the mean state: commutations, and slippers whose gap follows from the forces."""

    changes: Commutations
    slippers: Slippers


@compiled
def control_pressure_difference(
    pump: Pump, s: float, omega: float, dP: float, delays: float, pushed: float
) -> tuple[float, float]:
    """Control minus case pressure that the plate's torque balance asks for at tilt coordinate s [Pa], and its share.

    Rate spring and piston inertia drive the tilt up; the commutation delay and the stroking piston down.
    ``delays`` is the sum of the sines of the commutation angles at both dead centres: the pressure of a chamber is
    up from one to the other, and the mean of the piston's torque arm over that half turn is minus their sum.
    ``pushed`` is what slippers of a variable gap add [N m].
    Beyond the stop the difference falls off exponentially, continuous in value and slope, and never negative: the
    share of the torque that it still holds, 1 up to the stop.
    """
    servo, piston = pump.servo, pump.piston
    alpha_max = pump.swashplate.alpha_max
    alpha = min(s, alpha_max)
    t = math.tan(alpha)
    commutation = piston.n / (2.0 * math.pi) * delays * volume_by_tilt(piston, t, 1.0) * dP
    torque = spring_torque(servo, math.tan(alpha_max), t) + inertia_torque(piston, t, omega) - commutation + pushed
    torque += rate_arm(servo, t) * dP
    held = torque / stroking_arm(servo, t)
    beyond = s - alpha_max
    if beyond <= 0.0:
        return held, 1.0
    slope = servo.k_rate * servo.L_rate**2 * (1.0 + t * t) / (servo.A_stroke * servo.L_stroke)
    share = math.exp(-beyond * slope / held)
    return held * share, share


@compiled
def _land_flow(slipper: Slipper, warmth: Warmth, mu: float, P: float, P_c: float) -> float:
    """Leakage of one slipper at chamber pressure P [m3/s]."""
    C_A = slipper.C_q * 0.25 * math.pi * slipper.d_throttle**2
    return throttled_land_flow(P, P_c, land_conductance(mu, slipper.h, slipper.diameter_ratio), C_A, warmth.rho)


@compiled
def slippers_at(pump: Pump, model: SlipperMap, row: Vector, u: Vector) -> Slippers:
    """What slippers of a variable gap add at unknowns u (5,) by their metamodel; without one, nothing."""
    if model.nodes.shape[0] == 0:
        return NO_SLIPPERS
    P_amb = row[at.AMBIENT] * _BAR
    P_s = row[at.RESERVOIR] * _BAR + P_amb
    axes = np.empty(N_AXES)
    axes[TILT] = min(u[U_TILT], pump.swashplate.alpha_max) / _DEG
    axes[SPEED], axes[TEMPERATURE], axes[SUCTION] = row[at.SPEED], row[at.TEMPERATURE], row[at.RESERVOIR]
    axes[OVER_CASE], axes[OVER_SUCTION] = (u[U_P_D] - u[U_P_C]) / _BAR, (u[U_P_C] - P_s) / _BAR
    axes[WEAR] = math.log(row[at.PUMP_SCALE] * row[at.SLIPPER_SCALE])
    return mapped(pump, model, axes, P_amb)


@compiled
def commute(pump: Pump, model: SlipperMap, warmth: Warmth, row: Vector, u: Vector) -> Passing:
    """Commutations and slippers at unknowns u (5,): they depend on P_d, P_c and s, on speed, fluid, pressures of reservoir
    and ambient, and leakage only.
    """
    piston, servo, medium = pump.piston, pump.servo, warmth.medium
    omega = row[at.SPEED] * _RPM
    P_d, P_c, s = u[U_P_D], u[U_P_C], u[U_TILT]
    P_s = (row[at.RESERVOIR] + row[at.AMBIENT]) * _BAR
    t = math.tan(min(s, pump.swashplate.alpha_max))
    t_max = math.tan(pump.swashplate.alpha_max)
    V_min = chamber_volume(piston, t_max, t, -1.0)
    V_max = chamber_volume(piston, t_max, t, 1.0)
    strain = max(relative_density(medium, P_d) - relative_density(medium, P_s), 1.0e-9)
    dP = P_d - P_s
    v_0 = math.sqrt(2.0 * max(dP, 1.0) / warmth.rho)

    mu = film_viscosity(warmth.film, P_d, P_c)
    slippers = slippers_at(pump, model, row, u)
    land = 0.0
    if model.nodes.shape[0] == 0:
        land = row[at.PUMP_SCALE] * row[at.SLIPPER_SCALE] * _land_flow(pump.slipper, warmth, mu, P_d, P_c)
    reach = piston.R * t
    ring = (
        row[at.PUMP_SCALE]
        * row[at.PISTON_SCALE]
        * annular_gap_flow(P_d, P_c, mu, piston.d_p, piston.b, 1.0, piston.e_rel * piston.b, 0.0)
    )
    # share of the fluid that half of the pressure takes, from either end
    middle = (relative_density(medium, 0.5 * (P_d + P_s)) - relative_density(medium, P_s)) / strain
    bend = (2.0 * middle - 1.0) / (1.0 - middle)
    rise = Change(V_max * strain, land + ring / (piston.l_mean - reach), 0.0, bend, (P_FLOOR - P_s) / dP)
    fall = Change(V_min * strain, land + ring / (piston.l_mean + reach), 1.0, -bend / (1.0 + bend), -1.0)

    # the control volume as the plate feels it: what leaves it over bleed and stroking piston enters over the spool
    port = pump.port_plate
    delays = 2.0 * (port.phi_commutation + port.phi_seal)
    dP_ctrl, share = control_pressure_difference(pump, s, omega, dP, delays, slippers.plate_torque)
    dP_in = max(P_d - P_c - dP_ctrl, dP_ctrl)
    mu_in, mu_out = film_viscosity(warmth.film, P_d, P_d - dP_in), film_viscosity(warmth.film, P_c + dP_ctrl, P_c)
    seal_in = seal_conductance(pump.compensator, mu_in, pump.compensator.l_seal_discharge)
    seal_out = seal_conductance(pump.compensator, mu_out, pump.compensator.l_seal_case)
    turbulent = bleed_conductance(pump.compensator, dP_ctrl, warmth.rho)
    laminar = stroking_leakage(servo, mu_out) + seal_out
    fed = (laminar + turbulent) * dP_ctrl + row[at.CONTROL_BLEED] * _LPM
    # laminar passages give way in proportion, turbulent ones by half
    conductance = laminar + 0.5 * turbulent + 0.5 * (fed / dP_in + seal_in)
    capacity = relative_compressibility(medium, P_c + dP_ctrl) * pump.volumes.control
    J = pump.swashplate.J + carried_inertia(servo, t)
    stiffness = servo.k_rate * servo.L_rate**2 * (1.0 + t * t) ** 2
    support = Support(J, pump.swashplate.damping, stiffness, stroking_arm(servo, t), capacity, conductance, share)
    swing, arm = 0.5 * (V_max - V_min), volume_by_tilt(piston, t, 1.0)
    return Passing(commutations(port, support, rise, fall, piston.n, swing, arm, dP, v_0, omega), slippers)


@compiled
def _control_flows(
    pump: Pump, warmth: Warmth, edge: Edge, x: float, P_d: float, P_c: float, P_ctrl: float, bleed: float
) -> tuple[float, float]:
    """Flow into the control volume and flow out of it into the case [m3/s] at one pressure of it."""
    comp, servo, rho, nu = pump.compensator, pump.servo, warmth.rho, warmth.nu
    mu_in, mu_out = film_viscosity(warmth.film, P_d, P_ctrl), film_viscosity(warmth.film, P_ctrl, P_c)
    dP = P_ctrl - P_c
    inflow = inlet(comp, edge, x, P_d - P_ctrl, rho, mu_in, nu)[0] * (P_d - P_ctrl)
    passages = outlet(comp, edge, x, dP, rho, mu_out, nu)[0] + stroking_leakage(servo, mu_out)
    outflow = (passages + bleed_conductance(comp, dP, rho)) * dP
    if bleed > 0.0:
        outflow += bleed_flow(servo, bleed, dP)
    return inflow, outflow


@compiled
def evaluate(
    pump: Pump,
    circuit: Circuit,
    warmth: Warmth,
    passing: Passing,
    row: Vector,
    k_d: float,
    u: Vector,
    F: Vector,
    Y: Vector,
) -> None:
    """Residuals F (5,) and outputs Y (len(OUTPUTS),) at unknowns u (5,).

    ``row`` is one row of inputs in the order of ``twin.condition.INPUTS`` (edge units), ``warmth`` and ``passing`` are
    ``warmth_of`` and ``commute`` there; ``k_d`` > 0 sets the load by equation 3-2 [Pa/(m3/s)^2], else the discharge
    flow of the row is imposed. F is in flow, Pa and N.
    """
    omega = row[at.SPEED] * _RPM
    changes, slippers = passing.changes, passing.slippers
    T, medium, film = warmth.T, warmth.medium, warmth.film
    P_amb = row[at.AMBIENT] * _BAR
    P_r = row[at.RESERVOIR] * _BAR + P_amb
    P_d, P_c, s, x, Q_L = u[U_P_D], u[U_P_C], u[U_TILT], u[U_SPOOL], u[U_LOAD]
    piston, slipper, plate, comp, fluid = pump.piston, pump.slipper, pump.port_plate, pump.compensator, pump.fluid
    servo = pump.servo
    P_s = P_r
    alpha = min(s, pump.swashplate.alpha_max)
    t = math.tan(alpha)
    t_max = math.tan(pump.swashplate.alpha_max)
    mu_d = film_viscosity(film, P_d, P_c)
    mu_s = film_viscosity(film, P_s, P_c)

    # delivery: what the chambers take in at P_s minus what they carry back at P_d
    V_min = chamber_volume(piston, t_max, t, -1.0)
    V_max = chamber_volume(piston, t_max, t, 1.0)
    r_d, r_s = relative_density(medium, P_d), relative_density(medium, P_s)
    Q_pump = piston.n * omega / (2.0 * math.pi) * (r_s * V_max - r_d * V_min + changes.drawn)

    half = 0.5 * piston.n
    scale = row[at.PUMP_SCALE]
    l_mean = math.sqrt(piston.l_mean**2 - (piston.R * t) ** 2)
    k_piston, e = scale * row[at.PISTON_SCALE], piston.e_rel * piston.b
    k_slipper = scale * row[at.SLIPPER_SCALE]
    # leaks of one chamber at either pressure
    ring_d = k_piston * annular_gap_flow(P_d, P_c, mu_d, piston.d_p, piston.b, l_mean, e, 0.0)
    ring_s = k_piston * annular_gap_flow(P_s, P_c, mu_s, piston.d_p, piston.b, l_mean, e, 0.0)
    land_d = land_s = 0.0
    if slippers.mapped < 0.5:
        land_d = k_slipper * _land_flow(slipper, warmth, mu_d, P_d, P_c)
        land_s = k_slipper * _land_flow(slipper, warmth, mu_s, P_s, P_c)
    v_mean = 2.0 * piston.R * t * omega / math.pi
    drag = half * 0.5 * v_mean * piston.b * math.pi * piston.d_p
    k_plate = scale * row[at.PORT_PLATE_SCALE]
    plate_d = k_plate * port_plate_gap_flow(P_d, P_c, mu_d, plate.h, plate.shape)
    throttled = row[at.THROTTLED_LEAKAGE] * _LPM * math.sqrt(max(P_d - P_c, 0.0) / P_COUNTED)
    plate_s = k_plate * port_plate_gap_flow(P_s, P_c, mu_s, plate.h, plate.shape)

    # a chamber is under pressure from one commutation to the other
    high = half + piston.n / (2.0 * math.pi) * (changes.falling - changes.rising)
    piston_d, piston_s = high * ring_d, (piston.n - high) * ring_s
    slipper_d = high * land_d + slippers.from_discharge
    slipper_s = (piston.n - high) * land_s + slippers.from_suction
    delays = math.sin(changes.rising) + math.sin(changes.falling)
    P_ctrl = P_c + control_pressure_difference(pump, s, omega, P_d - P_s, delays, slippers.plate_torque)[0]
    edge = edge_of(comp, row[at.EDGE_ROUNDING] * 1.0e-6)
    # means over a ripple: for a sine the two ends of its standard deviation are Gauss and Chebyshev's points
    bleed = row[at.CONTROL_BLEED] * _LPM
    in_1, out_1 = _control_flows(pump, warmth, edge, x, P_d, P_c, max(P_ctrl - changes.ripple, P_FLOOR), bleed)
    in_2, out_2 = _control_flows(pump, warmth, edge, x, P_d, P_c, P_ctrl + changes.ripple, bleed)
    inflow, outflow = 0.5 * (in_1 + in_2), 0.5 * (out_1 + out_2)
    rate_leak = rate_leakage(servo, mu_d) * (P_d - P_c)
    Q_comp = outflow + rate_leak

    # what a chamber still leaks after its discharge port has shut, its suction replaces
    shut = plate.phi_commutation - plate.phi_seal
    carried = piston.n / (2.0 * math.pi) * (changes.falling - shut) * (ring_d + land_d)
    leak_d = piston_d - drag + slipper_d - carried + plate_d + throttled + rate_leak
    leak_s = piston_s + drag + slipper_s + carried + plate_s
    Q_c = leak_d + leak_s + Q_comp - rate_leak
    k_c = circuit.k_c * (1.0 + circuit.k_c_slope * (T - circuit.T_ref)) * row[at.DRAIN_SCALE]
    k_inf = circuit.k_inf * (1.0 + circuit.k_inf_slope * (T - circuit.T_ref))
    K = circuit.K * (1.0 + circuit.K_slope * (T - circuit.T_ref))
    # the leak of the circuit, counted at 175 bar, ends in the return line, whose pressure hardly matters to it
    Q_sys = counted_conductance(P_d - P_r, row[at.SYSTEM_LEAKAGE] * _LPM) * (P_d - P_r)
    P_i = P_r + return_pressure_drop(Q_L + Q_sys + circuit.shared * Q_c, k_inf, K, circuit.gamma)
    P_down = P_i if circuit.shared > 0.5 else P_r
    friction = friction_torque(pump.drive, warmth.viscous, P_d - P_c)
    T_c = case_temperature(pump.drive, fluid, T, P_d - P_c, Q_c, friction * omega)
    nu_ratio = 1.0
    if circuit.w_nu + row[at.DRAIN_VISCOSITY_CHANGE] != 0.0:
        nu_ratio = drain_viscosity_ratio(pump.drive, fluid, circuit.Q_ref, T_c)
    drop = drain_pressure_drop(
        Q_c,
        k_c,
        circuit.w_nu + row[at.DRAIN_VISCOSITY_CHANGE],
        circuit.w_Q + row[at.DRAIN_FLOW_CHANGE],
        nu_ratio,
        circuit.Q_ref,
    )

    jet = jet_stiffness(comp, edge, x, P_d - P_ctrl)[0]
    preload = comp.F_preload * (1.0 - comp.spring_softening * (T - T_50)) + row[at.SETTING_CHANGE] * _BAR * comp.A_spool
    spring = preload + comp.k_spool * comp.x_zero + comp.k_spool * row[at.DROOP_SCALE] * (x - comp.x_zero)

    F[DELIVERY] = Q_pump - leak_d - inflow - Q_L - Q_sys
    F[DRAIN] = P_c - P_down - drop
    F[BALANCE] = (P_d - P_c) * comp.A_spool - spring - jet + spool_stop(comp, x)[0]
    F[CONTROL] = inflow - outflow
    F[DEMAND] = P_d - P_i - k_d * Q_L * abs(Q_L) if k_d > 0.0 else Q_L - row[at.ASKED_FLOW] * _LPM

    indicated = indicated_torque(piston, plate, t, omega, P_d - P_s, warmth.rho, changes.rising, changes.falling)
    torque = indicated + slippers.shaft_torque + friction

    Y[at.DISCHARGE_PRESSURE] = (P_d - P_amb) / _BAR
    Y[at.CASE_PRESSURE] = (P_c - P_amb) / _BAR
    Y[at.RETURN_PRESSURE] = (P_i - P_amb) / _BAR
    Y[at.CONTROL_PRESSURE] = (P_ctrl - P_amb) / _BAR
    Y[at.SWASHPLATE_ANGLE] = alpha / _DEG
    Y[at.DISCHARGE_FLOW] = Q_L / _LPM
    Y[at.CASE_FLOW] = Q_c / _LPM
    Y[at.SHAFT_TORQUE] = torque
    Y[at.PISTON_LEAKAGE] = (piston_d + piston_s) / _LPM
    Y[at.SLIPPER_LEAKAGE] = (slipper_d + slipper_s + throttled) / _LPM
    Y[at.PORT_PLATE_LEAKAGE] = (plate_d + plate_s) / _LPM
    Y[at.COMPENSATOR_LEAKAGE] = Q_comp / _LPM
    Y[at.SUCTION_FLOW] = (Q_pump + leak_s) / _LPM
    Y[at.CASE_TEMPERATURE] = T_c - _T_0
