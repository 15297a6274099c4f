"""The steady pump written a second time, in plain Python and slowly: what the compiled residuals must equal.

Averages over a revolution are sums over angles here and closed forms there; pocket pressures are found by bisection;
nothing is taken from the twin but its numbers. Equations are those of Mkadara 2020 with what ``twin.laws`` says was
mended; flows count volume at ambient density.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from twin.condition import Condition, Health
from twin.parameters import Circuit, Drive, Pump

P_ATM = 101_325.0
LPM, BAR, RPM = 1.0 / 60_000.0, 1.0e5, math.pi / 30.0
P_COUNTED = 175.0e5
TURBULENT_FROM = 1.0e3
"""Pressure difference below which valve edges, the bleed and leaks of the circuit count as laminar [Pa]."""


@dataclass(frozen=True)
class Change:
    """Commutation: mean angles past dead centre of the rise and the fall [rad], ripple [Pa], fluid drawn beyond [m3]."""

    rising: float
    falling: float
    ripple: float
    drawn: float


@dataclass(frozen=True)
class Answer:
    """Residuals by name (m3/s, Pa, N) and outputs by their names in edge units."""

    residuals: dict[str, float]
    outputs: dict[str, float]


class Fluid:
    """Properties at one temperature [K]."""

    def __init__(self, pump: Pump, T: float) -> None:
        self.f, self.T = pump.fluid, T
        f = pump.fluid
        self.rho = self.ambient_density(T)
        self.nu = self.kinematic(T)
        self.mu = self.rho * self.nu
        self.B = f.B_ref + f.B_slope * (T - f.T_ref)
        # the logarithm of the gap's viscosity as a straight line through no pressure difference and 175 bar
        warm = T + 0.5 * P_COUNTED / (self.rho * f.c_p)
        at_175 = self.ambient_density(warm) * self.kinematic(warm) * math.exp(f.alpha_p * 0.5 * P_COUNTED)
        self.slope = math.log(at_175 / self.mu) / P_COUNTED

    def ambient_density(self, T: float) -> float:
        return self.f.rho_ref + self.f.rho_slope * (T - self.f.T_ref)

    def kinematic(self, T: float) -> float:
        """ASTM D341."""
        return (10.0 ** (10.0 ** (self.f.astm_a - self.f.astm_b * math.log10(T))) - 0.7) * 1.0e-6

    def gap(self, P_0: float, P_1: float) -> float:
        """Viscosity in a gap from P_0 to P_1 [Pa s]."""
        return self.mu * math.exp(self.slope * max(P_0 - P_1, 0.0) + self.f.alpha_p * (P_1 - P_ATM))

    def held(self, P: float) -> float:
        """Density over that at ambient pressure (2-1, 2-2) [-]."""
        liquid = 1.0 + (P - P_ATM) / (self.B + self.f.B_pressure_gain * (P - P_ATM))
        air = self.f.air / (1.0 - self.f.air)
        return (1.0 + air) / (1.0 / liquid + air * (P_ATM / P) ** (1.0 / self.f.air_exponent))

    def heating(self, T: float, dP: float) -> float:
        return dP / (self.ambient_density(T) * self.f.c_p)

    def warmed(self, drive: Drive, T: float, friction: float, Q_c: float) -> float:
        """What the shaft's friction [W] adds to the case's temperature [K]: to its flow, and to the housing."""
        flow = self.ambient_density(T) * self.f.c_p * max(Q_c, 0.0)
        return drive.heat_share * friction / (flow + drive.case_conductance)

    def drag(self, pump: Pump, omega: float) -> float:
        """Viscous torque [N m] of films that their own friction warms; the warming by bisection."""
        drive, full = pump.drive, 4600.0 * RPM

        def torque(warming: float) -> float:
            bench = self.viscosity(323.15 + drive.torque_viscous_ref * full / drive.film_conductance)
            return drive.torque_viscous_ref * omega / full * self.viscosity(self.T + warming) / bench

        low, high = 0.0, torque(0.0) * omega / drive.film_conductance
        for _ in range(200):
            middle = 0.5 * (low + high)
            if middle < torque(middle) * omega / drive.film_conductance:
                low = middle
            else:
                high = middle
        return torque(low)

    def viscosity(self, T: float) -> float:
        """Dynamic, at ambient pressure [Pa s]."""
        return self.ambient_density(T) * self.kinematic(T)


def mean_over(turn: Callable[[float], float], start: float, end: float, n: int = 40) -> float:
    """Integral of a function of the angle by Gauss and Legendre."""
    nodes, weights = np.polynomial.legendre.leggauss(n)
    half = 0.5 * (end - start)
    return half * sum(w * turn(start + half * (x + 1.0)) for x, w in zip(nodes.tolist(), weights.tolist(), strict=True))


def ring_flow(dP: float, mu: float, d: float, b: float, e_rel: float, per_length: float) -> float:
    """Annular gap (2-9) without its Couette term, ``per_length`` being the mean of 1/length [m3/s]."""
    return dP * math.pi * d * b**3 / (12.0 * mu) * (1.0 + 1.5 * e_rel**2) * per_length


def slipper_flow(P: float, P_c: float, G: float, C_A: float, rho: float) -> float:
    """Throttle (2-3) and land (2-26) in series; the pocket's pressure by bisection [m3/s]."""
    drop = abs(P - P_c)
    low, high = 0.0, drop
    for _ in range(200):
        pocket = 0.5 * (low + high)
        if G * pocket < C_A * math.sqrt(2.0 / rho * (drop - pocket)):
            low = pocket
        else:
            high = pocket
    return math.copysign(G * 0.5 * (low + high), P - P_c)


def opening(X: float, rounded: float) -> float:
    """Smooth opening of a rounded edge [m]: the root of o^2 - X o - rounded^2 / 4 that is positive."""
    return 0.5 * (X + math.hypot(X, rounded)) if X > 0.0 else 0.5 * rounded**2 / (math.hypot(X, rounded) - X)


def secant(dP: float) -> float:
    """Root of a pressure difference that is straight near zero: dP over the fourth root of dP^2 + limit^2."""
    return dP / (dP * dP + TURBULENT_FROM**2) ** 0.25


class Valve:
    """Compensator with edges that erosion has rounded by ``rounding`` [m]: smooth law (code 0) or Mare's (code 1)."""

    def __init__(self, pump: Pump, fluid: Fluid, rounding: float) -> None:
        self.c, self.fluid = pump.compensator, fluid
        self.law = int(pump.compensator.edge_law)
        self.rounding = rounding if self.law == 0 else pump.compensator.edge_radius + rounding
        self.clearance = self.c.c_edge if self.law == 0 else self.c.c_spool

    def edge(self, X: float, dP: float) -> float:
        c, rho = self.c, self.fluid.rho
        if self.law == 0:
            width = opening(X, self.clearance + self.rounding)
            return c.C_q * c.w_edge * width * math.sqrt(2.0 / rho) * secant(dP)
        notch, speed = c.w_edge / c.n_edge, math.sqrt(2.0 / rho * abs(dP))
        if X <= 0.0:
            # (2-16), overlapped, with the length that makes it meet the open edge at X = 0
            K_g = self.clearance * (notch + self.clearance) / (48.0 * c.delta_lambda * notch)
            return c.n_edge * notch * self.clearance**3 / (12.0 * rho * self.fluid.nu * (K_g - X)) * dP
        X_s = math.hypot(X, self.rounding + self.clearance) - self.rounding
        S = c.n_edge * notch * X_s
        number = 2.0 * S / (c.n_edge * self.fluid.nu * (notch + X_s)) * speed
        return math.copysign(min(c.delta_lambda * number, c.C_q) * S * speed, dP)

    def seal(self, dP: float, mu: float, length: float) -> float:
        """Clearance beside the slots (2-9): the smooth law only, Mare's holds its own."""
        return 0.0 if self.law else ring_flow(dP, mu, self.c.d_spool, self.c.c_spool, self.c.e_rel, 1.0 / length)

    def inflow(self, x: float, P_d: float, P_x: float) -> float:
        dP = P_d - P_x
        return self.edge(x - self.c.x_overlap, dP) + self.seal(dP, self.fluid.gap(P_d, P_x), self.c.l_seal_discharge)

    def outflow(self, x: float, P_x: float, P_c: float) -> float:
        dP = P_x - P_c
        bleed = self.c.C_q * 0.25 * math.pi * self.c.d_bleed**2 * math.sqrt(2.0 / self.fluid.rho) * secant(dP)
        return (
            self.edge(-x - self.c.x_overlap, dP) + self.seal(dP, self.fluid.gap(P_x, P_c), self.c.l_seal_case) + bleed
        )

    def jet(self, x: float, dP: float) -> float:
        """Steady jet force (2-21) [N]."""
        width = opening(x - self.c.x_overlap, self.clearance + self.rounding)
        return 2.0 * self.c.C_q * self.c.cos_jet * self.c.w_edge * dP * width


def control_pressure(pump: Pump, s: float, omega: float, P_d: float, P_c: float, P_s: float, change: Change) -> float:
    """Pressure on the stroking piston that holds the plate [Pa]: the torques of springs, pistons and pressures."""
    piston, servo, top = pump.piston, pump.servo, pump.swashplate.alpha_max
    t = math.tan(min(s, top))
    per_tilt = 1.0 + t * t
    area = 0.25 * math.pi * piston.d_p**2
    per_angle = piston.n / (2.0 * math.pi)

    def arm(phi: float) -> float:
        return piston.R * per_tilt * math.cos(phi)

    def inertia(phi: float) -> float:
        return piston.m * omega**2 * piston.R * t * math.cos(phi) * arm(phi)

    pressed = per_angle * area * (P_d - P_s) * mean_over(arm, change.rising, math.pi + change.falling)
    thrown = per_angle * mean_over(inertia, 0.0, 2.0 * math.pi)
    spring = (servo.F_rate + servo.k_rate * servo.L_rate * (math.tan(top) - t)) * servo.L_rate * per_tilt
    fed = servo.rate_fed * servo.A_rate * servo.L_rate * per_tilt * (P_d - P_s)
    stroke = servo.A_stroke * servo.L_stroke
    held = (pressed + thrown + spring + fed) / (stroke * per_tilt)
    if s > top:
        # beyond the stop the pressure falls off, with the slope of the spring at the stop
        held *= math.exp(-(s - top) * servo.k_rate * servo.L_rate**2 * per_tilt / (stroke * held))
    return P_c + held


def drops(
    circuit: Circuit, pump: Pump, fluid: Fluid, health: Health, flows: tuple[float, float], heated: float
) -> tuple[float, float]:
    """Pressure drops of the return line (3-4) at the first flow and of the drain (3-3) at the second [Pa]."""
    warmer = fluid.T - circuit.T_ref
    k_inf, K = circuit.k_inf * (1.0 + circuit.k_inf_slope * warmer), circuit.K * (1.0 + circuit.K_slope * warmer)
    Q, Q_c = flows
    ratio = abs(Q) ** circuit.gamma / K
    back = k_inf * K * Q * (ratio / math.tanh(ratio) if ratio > 1.0e-6 else 1.0)
    w_nu = circuit.w_nu + health.drain_viscosity_weight_change
    w_Q = circuit.w_Q + health.drain_flow_weight_change
    drive = pump.drive
    full = (drive.torque_viscous_ref + drive.torque_pressure * P_COUNTED) * 4600.0 * RPM
    bench = 323.15 + fluid.heating(323.15, P_COUNTED) + fluid.warmed(drive, 323.15, full, circuit.Q_ref)
    share = w_nu * fluid.kinematic(heated) / fluid.kinematic(bench) + w_Q * abs(Q_c) / circuit.Q_ref + 1.0 - w_nu - w_Q
    k_c = circuit.k_c * (1.0 + circuit.k_c_slope * warmer) * health.drain_resistance_scale
    return back, k_c * Q_c * share


def steady(
    pump: Pump, circuit: Circuit, condition: Condition, health: Health, k_d: float, u: tuple[float, ...], change: Change
) -> Answer:
    """Residuals and outputs at P_d, P_c, tilt coordinate, spool position and load flow ``u``."""
    P_d, P_c, s, x, Q_L = u
    piston, slipper, plate, comp, servo = pump.piston, pump.slipper, pump.port_plate, pump.compensator, pump.servo
    fluid = Fluid(pump, condition.fluid_temperature_degc + 273.15)
    omega = condition.speed_rpm * RPM
    P_amb = condition.ambient_pressure_bar * BAR
    P_s = condition.reservoir_pressure_bar * BAR + P_amb
    alpha = min(s, pump.swashplate.alpha_max)
    t, t_max = math.tan(alpha), math.tan(pump.swashplate.alpha_max)
    area = 0.25 * math.pi * piston.d_p**2
    per_angle = piston.n / (2.0 * math.pi)

    V_min = piston.V_dead + area * piston.R * (t_max - t)
    V_max = piston.V_dead + area * piston.R * (t_max + t)
    Q_pump = per_angle * omega * (fluid.held(P_s) * V_max - fluid.held(P_d) * V_min + change.drawn)

    per_length = mean_over(lambda phi: 1.0 / (piston.l_mean - piston.R * t * math.cos(phi)), 0.0, 2.0 * math.pi, 60)
    per_length /= 2.0 * math.pi
    mu_d, mu_s = fluid.gap(P_d, P_c), fluid.gap(P_s, P_c)
    C_A = slipper.C_q * 0.25 * math.pi * slipper.d_throttle**2

    def ring(P: float, mu: float) -> float:
        scale = health.pump_leakage_scale * health.piston_leakage_scale
        return scale * ring_flow(P - P_c, mu, piston.d_p, piston.b, piston.e_rel, per_length)

    def land(P: float, mu: float) -> float:
        G = math.pi * slipper.h**3 / (6.0 * mu * math.log(slipper.diameter_ratio))
        return health.pump_leakage_scale * health.slipper_leakage_scale * slipper_flow(P, P_c, G, C_A, fluid.rho)

    def gap(P: float, mu: float) -> float:
        scale = health.pump_leakage_scale * health.port_plate_leakage_scale
        return scale * (P - P_c) * plate.h**3 / (12.0 * mu) * plate.shape

    under = per_angle * (math.pi + change.falling - change.rising)
    dragged = per_angle * mean_over(lambda phi: 0.5 * piston.R * t * omega * math.sin(phi), 0.0, math.pi)
    dragged *= piston.b * math.pi * piston.d_p
    late = per_angle * (change.falling - (plate.phi_commutation - plate.phi_seal)) * (ring(P_d, mu_d) + land(P_d, mu_d))
    pistons = under * ring(P_d, mu_d), (piston.n - under) * ring(P_s, mu_s)
    slippers = under * land(P_d, mu_d), (piston.n - under) * land(P_s, mu_s)
    gaps = gap(P_d, mu_d), gap(P_s, mu_s)
    throttled = health.throttled_leakage_lpm * LPM * math.sqrt(max(P_d - P_c, 0.0) / P_COUNTED)

    P_x = control_pressure(pump, s, omega, P_d, P_c, P_s, change)
    valve = Valve(pump, fluid, health.edge_rounding_um * 1.0e-6)
    d_stroke, d_rate = math.sqrt(4.0 * servo.A_stroke / math.pi), math.sqrt(4.0 * servo.A_rate / math.pi)
    inflow = outflow = 0.0
    for P in (P_x - change.ripple, P_x + change.ripple):
        inflow += 0.5 * valve.inflow(x, P_d, P)
        stroking = ring_flow(
            P - P_c, fluid.gap(P, P_c), d_stroke, servo.b_stroke, servo.e_rel_stroke, 1.0 / servo.l_stroke
        )
        bled = health.control_bleed_lpm * LPM * math.tanh((P - P_c) / (0.05 * servo.F_rate / servo.A_stroke))
        outflow += 0.5 * (valve.outflow(x, P, P_c) + stroking + bled)
    rate = servo.rate_fed * ring_flow(P_d - P_c, mu_d, d_rate, servo.b_rate, servo.e_rel_rate, 1.0 / servo.l_rate)

    from_d = pistons[0] + slippers[0] - dragged - late + gaps[0] + throttled + rate
    from_s = pistons[1] + slippers[1] + dragged + late + gaps[1]
    Q_c = from_d + from_s + outflow
    Q_sys = health.system_leakage_lpm * LPM / math.sqrt(P_COUNTED) * secant(P_d - P_s)
    drag = fluid.drag(pump, omega) + pump.drive.torque_pressure * (P_d - P_c)
    heated = fluid.T + fluid.heating(fluid.T, P_d - P_c) + fluid.warmed(pump.drive, fluid.T, drag * omega, Q_c)
    shared = circuit.shared > 0.5
    back, drop = drops(circuit, pump, fluid, health, (Q_L + Q_sys + (Q_c if shared else 0.0), Q_c), heated)
    P_i = P_s + back

    # the shaft's work: pressure times volume rate over a revolution, the ports' own losses on both sides
    reach = area * piston.R * t
    indicated = (P_d - P_s) * mean_over(math.sin, change.rising, math.pi + change.falling)

    def lost(phi: float) -> float:
        return 0.5 * fluid.rho * (reach * omega * math.sin(phi) / (plate.C_q * plate.A_port)) ** 2

    indicated += 2.0 * mean_over(lambda phi: lost(phi) * math.sin(phi), 0.0, math.pi)
    worked = per_angle * reach * indicated

    softened = comp.F_preload * (1.0 - comp.spring_softening * (fluid.T - 323.15))
    spring = softened + health.pressure_setting_change_bar * BAR * comp.A_spool
    spring += comp.k_spool * (comp.x_zero + health.droop_scale * (x - comp.x_zero))
    stopped = comp.k_stop * (max(comp.x_low - x, 0.0) - max(x - comp.x_high, 0.0))
    demand = P_d - P_i - k_d * Q_L * abs(Q_L) if k_d > 0.0 else Q_L - condition.discharge_flow_lpm * LPM
    residuals = {
        "delivery": Q_pump - from_d - inflow - Q_L - Q_sys,
        "drain": P_c - (P_i if shared else P_s) - drop,
        "balance": (P_d - P_c) * comp.A_spool - spring - valve.jet(x, P_d - P_x) + stopped,
        "control": inflow - outflow,
        "demand": demand,
    }
    outputs = {
        "discharge_pressure_bar": (P_d - P_amb) / BAR,
        "case_pressure_bar": (P_c - P_amb) / BAR,
        "return_pressure_bar": (P_i - P_amb) / BAR,
        "control_pressure_bar": (P_x - P_amb) / BAR,
        "swashplate_angle_deg": math.degrees(alpha),
        "discharge_flow_lpm": Q_L / LPM,
        "case_flow_lpm": Q_c / LPM,
        "shaft_torque_nm": worked + drag,
        "piston_leakage_lpm": sum(pistons) / LPM,
        "slipper_leakage_lpm": (sum(slippers) + throttled) / LPM,
        "port_plate_leakage_lpm": sum(gaps) / LPM,
        "compensator_leakage_lpm": (outflow + rate) / LPM,
        "suction_flow_lpm": (Q_pump + from_s) / LPM,
        "case_temperature_degc": heated - 273.15,
    }
    return Answer(residuals, outputs)
