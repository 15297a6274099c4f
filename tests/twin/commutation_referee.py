"""Commutation written a second time: both changing chambers in fine steps, the plate's vibration until it repeats itself.

What the compiled balance does in eight substeps and three rounds is done here in nine hundred and forty, in plain Python.
"""

import cmath
import math
from dataclasses import dataclass

from tests.twin.steady_referee import (
    BAR,
    LPM,
    RPM,
    TURBULENT_FROM,
    Change,
    Fluid,
    Valve,
    control_pressure,
    ring_flow,
    slipper_flow,
)
from twin.condition import Condition, Health
from twin.parameters import Pump

P_CAVITY = 1.0e3
FINE, ROUNDS, SHARE = 300, 40, 0.5
"""Steps of each stretch, rounds of the balance, share of a round's news."""


@dataclass(frozen=True)
class Chamber:
    """A chamber about to change over: fluid [m3] that the change needs, leak [m3/s] at its start and by its share done."""

    needed: float
    leak: float
    starts_full: bool
    bend: float
    low: float

    def fluid(self, p: float) -> float:
        """Share of the fluid at a share p of the pressure."""
        return (1.0 + self.bend) * p / (1.0 + self.bend * p)

    def per_fluid(self, p: float) -> float:
        """Slope of the pressure's share by the fluid's."""
        return (1.0 + self.bend * p) ** 2 / (1.0 + self.bend)


class Commutation:
    """One pump at one state ``u`` of the operating point."""

    def __init__(self, pump: Pump, condition: Condition, health: Health, u: tuple[float, ...]) -> None:
        P_d, P_c, s = u[:3]
        piston, slipper, servo, comp = pump.piston, pump.slipper, pump.servo, pump.compensator
        fluid = Fluid(pump, condition.fluid_temperature_degc + 273.15)
        self.pump, self.omega, self.n = pump, condition.speed_rpm * RPM, int(piston.n)
        P_s = (condition.reservoir_pressure_bar + condition.ambient_pressure_bar) * BAR
        t, t_max = math.tan(min(s, pump.swashplate.alpha_max)), math.tan(pump.swashplate.alpha_max)
        area = 0.25 * math.pi * piston.d_p**2
        V_max, V_min = (piston.V_dead + area * piston.R * (t_max + sign * t) for sign in (1.0, -1.0))
        self.swing, self.arm = 0.5 * (V_max - V_min), area * piston.R * (1.0 + t * t)
        self.dP, self.jet = P_d - P_s, math.sqrt(2.0 * (P_d - P_s) / fluid.rho)

        mu = fluid.gap(P_d, P_c)
        G = math.pi * slipper.h**3 / (6.0 * mu * math.log(slipper.diameter_ratio))
        C_A = slipper.C_q * 0.25 * math.pi * slipper.d_throttle**2
        land = health.pump_leakage_scale * health.slipper_leakage_scale * slipper_flow(P_d, P_c, G, C_A, fluid.rho)
        scale = health.pump_leakage_scale * health.piston_leakage_scale
        rings = [
            scale
            * ring_flow(P_d - P_c, mu, piston.d_p, piston.b, piston.e_rel, 1.0 / (piston.l_mean - sign * piston.R * t))
            for sign in (1.0, -1.0)
        ]
        strain = fluid.held(P_d) - fluid.held(P_s)
        half = (fluid.held(0.5 * (P_d + P_s)) - fluid.held(P_s)) / strain
        bend = (2.0 * half - 1.0) / (1.0 - half)
        self.rise = Chamber(V_max * strain, land + rings[0], False, bend, (P_CAVITY - P_s) / self.dP)
        self.fall = Chamber(V_min * strain, land + rings[1], True, -bend / (1.0 + bend), -1.0)

        # the control volume and the plate on it, at the delays that the angles of the ports alone would give
        delay = pump.port_plate.phi_commutation + pump.port_plate.phi_seal
        flat = math.asin(min(delay, 1.0))
        P_x = control_pressure(pump, s, self.omega, P_d, P_c, P_s, Change(flat, flat, 0.0, 0.0))
        held = control_pressure(
            pump, min(s, pump.swashplate.alpha_max), self.omega, P_d, P_c, P_s, Change(flat, flat, 0, 0)
        )
        self.share = (P_x - P_c) / (held - P_c)
        dP_x = P_x - P_c
        dP_in = max(P_d - P_x, dP_x)
        valve = Valve(pump, fluid, 0.0)
        d = math.sqrt(4.0 * servo.A_stroke / math.pi)
        mu_out = fluid.gap(P_x, P_c)
        stroking = ring_flow(dP_x, mu_out, d, servo.b_stroke, servo.e_rel_stroke, 1.0 / servo.l_stroke)
        laminar = (stroking + valve.seal(dP_x, mu_out, comp.l_seal_case)) / dP_x
        turbulent = comp.C_q * 0.25 * math.pi * comp.d_bleed**2 * math.sqrt(2.0 / fluid.rho)
        turbulent /= (dP_x * dP_x + TURBULENT_FROM**2) ** 0.25
        fed = (laminar + turbulent) * dP_x + health.control_bleed_lpm * LPM
        seal_in = valve.seal(1.0, fluid.gap(P_d, P_d - dP_in), comp.l_seal_discharge)
        self.conductance = laminar + 0.5 * turbulent + 0.5 * (fed / dP_in + seal_in)
        step = 1.0e4
        self.capacity = (fluid.held(P_x + step) - fluid.held(P_x - step)) / (2.0 * step) * pump.volumes.control
        self.stroke = servo.A_stroke * servo.L_stroke * (1.0 + t * t)
        self.J = (
            pump.swashplate.J
            + (servo.m_stroke * servo.L_stroke**2 + servo.m_rate * servo.L_rate**2) * (1.0 + t * t) ** 2
        )
        self.stiffness = servo.k_rate * servo.L_rate**2 * (1.0 + t * t) ** 2

    def control(self, m: int) -> complex:
        """Control pressure per tilt rate at m n times the shaft's speed [Pa s/rad]."""
        return self.stroke / complex(self.conductance, m * self.n * self.omega * self.capacity)

    def rate(self, m: int, moments: complex) -> complex:
        """Tilt rate at m n times the shaft's speed [rad/s] under a torque that jumps with both changes."""
        q = m * self.n
        w = q * self.omega
        resistance = complex(
            self.pump.swashplate.damping, self.J * w - self.stiffness / w
        ) + self.stroke * self.control(m)
        torque = -1j * self.n / math.pi * self.share * self.arm * self.dP * q / (q * q - 1.0) * moments
        return torque / resistance

    def parity(self, m: int) -> float:
        """How a harmonic looks from the other dead centre: half a turn is m n half periods."""
        return -1.0 if m * self.n % 2 else 1.0

    def change(self, chamber: Chamber, w: list[complex], outer: bool) -> tuple[float, float, list[complex]]:
        """Mean angle of a change, share done when the old port has shut, moments of the change of pressure."""
        plate = self.pump.port_plate
        first, last = plate.phi_commutation - plate.phi_seal, plate.phi_commutation + plate.phi_seal
        bounds = (first - plate.phi_seal, first, last, last + 0.6 * plate.phi_ramp)
        per = 1.0 / (chamber.needed * self.omega)
        full = plate.C_q * plate.A_port * self.jet * per
        signs = [1.0 if outer else self.parity(m) for m in range(1, 5)]
        p = angle = shut = 0.0
        moments = [0j] * 4
        for stretch in range(3):
            d = (bounds[stretch + 1] - bounds[stretch]) / FINE
            for k in range(FINE):
                phi = bounds[stretch] + (k + 0.5) * d
                tilting = sum(
                    (s * a * cmath.exp(1j * m * self.n * phi)).real
                    for m, (s, a) in enumerate(zip(signs, w, strict=True), 1)
                )
                leak = chamber.leak * ((1.0 if chamber.starts_full else 0.0) - p)
                moved = (
                    d
                    * per
                    * (self.swing * self.omega * math.sin(phi) + leak - self.arm * tilting)
                    * chamber.per_fluid(p)
                )
                before = p
                u = ((first - phi) if stretch == 0 else (phi - last)) / plate.phi_ramp
                through = d * full * u * u * (3.0 - 2.0 * u) * chamber.per_fluid(p) if stretch != 1 else 0.0
                if stretch == 0:
                    # p' + through sqrt(p') = p + moved, odd
                    left = p + moved
                    p = math.copysign((math.sqrt(0.25 * through**2 + abs(left)) - 0.5 * through) ** 2, left)
                else:
                    p += moved
                    if stretch == 2:
                        root = max(math.sqrt(max(1.0 - p, 0.0)) - 0.5 * through, 0.0)
                        p = 1.0 - root * root
                p = min(max(p, chamber.low), 1.0)
                angle += (p - before) * phi
                for m in range(4):
                    moments[m] += (p - before) * cmath.exp(-1j * (m + 1) * self.n * phi)
            if stretch == 0:
                shut = p
        rest = 1.0 - p
        angle += rest * bounds[3]
        return angle, shut, [e + rest * cmath.exp(-1j * (m + 1) * self.n * bounds[3]) for m, e in enumerate(moments)]

    def solve(self) -> Change:
        """Both mean angles, ripple of the control pressure and fluid drawn beyond the mean stroke."""
        w = [0j] * 4
        rising = falling = shut_r = shut_f = 0.0
        for _ in range(ROUNDS):
            rising, shut_r, E_r = self.change(self.rise, w, True)
            falling, shut_f, E_f = self.change(self.fall, w, False)
            news = [self.rate(m, E_r[m - 1] + self.parity(m) * E_f[m - 1]) for m in range(1, 5)]
            w = [a + SHARE * (b - a) for a, b in zip(w, news, strict=True)]
        ripple = math.sqrt(0.5 * sum(abs(a * self.control(m)) ** 2 for m, a in enumerate(w, 1)))
        shut = self.pump.port_plate.phi_commutation - self.pump.port_plate.phi_seal
        off = sum(
            (1.0 + self.parity(m)) * (a * cmath.exp(1j * m * self.n * shut)).imag / (m * self.n * self.omega)
            for m, a in enumerate(w, 1)
        )
        drawn = self.rise.needed * self.rise.fluid(shut_r) + self.fall.needed * self.fall.fluid(shut_f) + self.arm * off
        return Change(rising, falling, ripple, drawn)
