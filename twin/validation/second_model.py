"""A second pump by other hands: NumPy and LSODA alone, written from the equations, to check the first one's means.

Nothing of this project is imported: a parameter set comes in as plain numbers. Pressures are the states and not masses, the
viscosity of a gap is the mean of Barus' and ASTM's laws at its middle, the ports are windows of an angle that runs with time,
and the integrator is SciPy's. Only what the two share as physics can make them agree.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import odeint
from scipy.optimize import brentq

Vector = NDArray[np.float64]
Numbers = Mapping[str, Mapping[str, float]]

P_0 = 101325.0
"""Ambient pressure of the fluid's properties [Pa]."""
FLOOR = 1.0e3
LPM = 1.0 / 60.0e3
BAR = 1.0e5
P_D, P_C, P_I, P_X, X, V, TILT, RATE = range(8)
"""Discharge, case, junction and control pressure [bar], spool [mm, m/s], tilt [rad, rad/s]; then the chambers [bar]."""
N_STATES = 8
_TOLERANCE = 1.0e-5
"""Of states in bar, mm and rad: ten times coarser moves the regulated pressure by 0.5 %."""


@dataclass(frozen=True, slots=True)
class Where:
    """Where the second pump runs: rpm, degC, bar gauge, L/min, and the health that it knows (1 and 0 when healthy)."""

    speed_rpm: float
    fluid_temperature_degc: float
    reservoir_pressure_bar: float
    discharge_flow_lpm: float
    ambient_pressure_bar: float = 1.01325
    pump_leakage_scale: float = 1.0
    slipper_leakage_scale: float = 1.0
    system_leakage_lpm: float = 0.0
    pressure_setting_change_bar: float = 0.0
    drain_resistance_scale: float = 1.0


class SecondPump:
    """One pump in one circuit at one place.

    Parameters
    ----------
    numbers
        By part and name, SI: ``piston``, ``slipper``, ``port_plate``, ``swashplate``, ``compensator``, ``volumes``, ``servo``,
        ``drive``, ``fluid``, ``circuit``. Constant slipper gaps, no air, smooth edges, carried servo pistons with a vented rate piston.
    """

    def __init__(self, numbers: Numbers, where: Where) -> None:
        self.p, self.s, self.pp = numbers["piston"], numbers["slipper"], numbers["port_plate"]
        self.sw, self.c, self.vol = numbers["swashplate"], numbers["compensator"], numbers["volumes"]
        self.sv, self.f, self.ci = numbers["servo"], numbers["fluid"], numbers["circuit"]
        self.drive = numbers["drive"]
        self.at = where
        f, T = self.f, where.fluid_temperature_degc + 273.15
        self.T, self.omega, self.n = T, where.speed_rpm * np.pi / 30.0, int(self.p["n"])
        self.rho = f["rho_ref"] + f["rho_slope"] * (T - f["T_ref"])
        self.nu = self._nu(T)
        self.B = f["B_ref"] + f["B_slope"] * (T - f["T_ref"])
        self.P_amb = where.ambient_pressure_bar * BAR
        self.P_s = self.P_amb + where.reservoir_pressure_bar * BAR
        self.area = 0.25 * np.pi * self.p["d_p"] ** 2
        self.t_max = np.tan(self.sw["alpha_max"])
        self.pistons = 2.0 * np.pi * np.arange(self.n) / self.n
        s, p = self.s, self.p
        self.land = np.pi * s["h"] ** 3 / (6.0 * np.log(s["diameter_ratio"]))
        self.throttle = s["C_q"] * 0.25 * np.pi * s["d_throttle"] ** 2 * np.sqrt(2.0 / self.rho)
        self.ring = np.pi * p["d_p"] * p["b"] ** 3 / 12.0 * (1.0 + 1.5 * p["e_rel"] ** 2) * where.pump_leakage_scale
        self.scale = where.pump_leakage_scale * where.slipper_leakage_scale
        self.plate = where.pump_leakage_scale * self.pp["shape"] * self.pp["h"] ** 3 / 12.0
        warm = T - self.ci["T_ref"]
        self.k_c = self.ci["k_c"] * (1.0 + self.ci["k_c_slope"] * warm) * where.drain_resistance_scale
        self.k_inf = self.ci["k_inf"] * (1.0 + self.ci["k_inf_slope"] * warm)
        self.K = self.ci["K"] * (1.0 + self.ci["K_slope"] * warm)
        c, sv, root = self.c, self.sv, np.sqrt(2.0 / self.rho)
        self._root = root
        self._per_edge = c["C_q"] * c["w_edge"] * root
        self._bleed = c["C_q"] * 0.25 * np.pi * c["d_bleed"] ** 2 * root
        self._seal = np.pi * c["d_spool"] * c["c_spool"] ** 3 / 12.0 * (1.0 + 1.5 * c["e_rel"] ** 2)
        d_s = np.sqrt(4.0 * sv["A_stroke"] / np.pi)
        self._stroke = (
            np.pi * d_s * sv["b_stroke"] ** 3 / (12.0 * sv["l_stroke"]) * (1.0 + 1.5 * sv["e_rel_stroke"] ** 2)
        )
        self._volumes = np.array([self.vol[name] for name in ("discharge", "case", "return_line", "control")])
        # 3-4 is explicit in the flow: its inverse by a table, once
        flows = np.concatenate(([0.0], np.geomspace(1.0e-4, 120.0, 4000))) * LPM
        drops = self.k_inf * flows**2 / np.tanh(np.maximum(flows, 1.0e-12) / self.K)
        drops[0] = 0.0
        self._line = (drops, flows)

    def _nu(self, T: float) -> float:
        return float((10.0 ** (10.0 ** (self.f["astm_a"] - self.f["astm_b"] * np.log10(T))) - 0.7) * 1.0e-6)

    def viscosity(self, high: Vector | float, low: Vector | float) -> Vector:
        """Viscosity in a gap [Pa s]: ASTM at half of the throttling heat, Barus at the mean pressure."""
        fall = np.maximum(np.asarray(high) - low, 0.0)
        T = self.T + 0.5 * fall / (self.rho * self.f["c_p"])
        nu = (10.0 ** (10.0 ** (self.f["astm_a"] - self.f["astm_b"] * np.log10(T))) - 0.7) * 1.0e-6
        rho = self.f["rho_ref"] + self.f["rho_slope"] * (T - self.f["T_ref"])
        mu: Vector = rho * nu * np.exp(self.f["alpha_p"] * (low + 0.5 * fall - P_0))
        return mu

    def fluid(self, P: Vector | float) -> tuple[Vector, Vector]:
        """Density over ambient, and its slope by pressure [1/Pa]: tangent modulus linear in pressure."""
        over = np.asarray(P) - P_0
        B = self.B + self.f["B_pressure_gain"] * over
        return 1.0 + over / B, self.B / B**2

    def windows(self, angle: Vector) -> tuple[Vector, Vector]:
        """Open areas to discharge and to suction [m2] at the pistons' angles [rad], smooth at both ends of a kidney."""
        delayed = np.mod(angle - self.pp["phi_commutation"], 2.0 * np.pi)
        first = delayed < np.pi
        within = np.where(first, delayed, delayed - np.pi)
        nearer = np.minimum(within, np.pi - within)
        open_ = np.clip((nearer - self.pp["phi_seal"]) / self.pp["phi_ramp"], 0.0, 1.0)
        area = self.pp["A_port"] * open_ * open_ * (3.0 - 2.0 * open_)
        return np.where(first, area, 0.0), np.where(first, 0.0, area)

    def opening(self, underlap: Vector) -> Vector:
        """Opening of a rounded metering edge [m]: a hyperbola between the underlap and nothing."""
        found: Vector = 0.5 * (underlap + np.hypot(underlap, self.c["c_edge"]))
        return found

    def _edge(self, underlap: Vector, dP: Vector) -> Vector:
        """Flow over a metering edge [m3/s]: turbulent."""
        found: Vector = self._per_edge * self.opening(underlap) * _signed_root(dP, 1.0e3)
        return found

    def control_flows(self, y: Vector, mu_in: Vector, mu_out: Vector) -> tuple[Vector, Vector]:
        """Flows into the control volume and out of it [m3/s], at the viscosities of both gaps."""
        c, x = self.c, y[..., X] * 1.0e-3
        P_d, P_c, P_x = y[..., P_D] * BAR, y[..., P_C] * BAR, y[..., P_X] * BAR
        inflow = self._edge(x - c["x_overlap"], P_d - P_x) + self._seal / (mu_in * c["l_seal_discharge"]) * (P_d - P_x)
        outflow = self._edge(-x - c["x_overlap"], P_x - P_c) + self._bleed * _signed_root(P_x - P_c, 1.0e3)
        return inflow, outflow + (self._seal / c["l_seal_case"] + self._stroke) / mu_out * (P_x - P_c)

    def _chambers(self, y: Vector, angle: Vector) -> tuple[Vector, ...]:
        """Pressures, flows to discharge, from suction and into the case, volumes, and volume per tilt of all chambers."""
        p, t = self.p, np.tan(y[..., TILT, None])
        P_d, P_c = y[..., P_D, None] * BAR, y[..., P_C, None] * BAR
        cos, sin = np.cos(angle), np.sin(angle)
        P = np.maximum(y[..., N_STATES:] * BAR, FLOOR)
        to_d, from_s = self.windows(angle)
        root = self._root * self.pp["C_q"]
        out = root * to_d * _signed_root(P - P_d, self.pp["dP_laminar"])
        into = root * from_s * _signed_root(self.P_s - P, self.pp["dP_laminar"])
        mu = self.viscosity(P, P_c)
        G, K, over = self.land / mu, self.throttle, P - P_c
        pocket = 2.0 * K * G / (K + np.sqrt(K * K + 4.0 * G * G * np.abs(over))) * over
        ring = self.ring / (mu * (p["l_mean"] - p["R"] * t * cos)) * over
        drag = -0.5 * p["b"] * np.pi * p["d_p"] * p["R"] * t * sin * self.omega
        volume = p["V_dead"] + self.area * p["R"] * (self.t_max + t * cos)
        per_tilt = self.area * p["R"] * (1.0 + t * t) * cos
        turning = -self.area * p["R"] * t * sin * self.omega
        return P, out, into, self.scale * pocket + ring + drag, volume, per_tilt, turning

    def circuit_flows(self, y: Vector) -> tuple[Vector, Vector, Vector]:
        """Leak of the system, drain and return line [m3/s]."""
        P_d, P_c, P_i = y[..., P_D] * BAR, y[..., P_C] * BAR, y[..., P_I] * BAR
        counted = self.at.system_leakage_lpm * LPM / np.sqrt(175.0 * BAR)
        over = P_i - self.P_s
        returned: Vector = np.sign(over) * np.interp(np.abs(over), *self._line)
        return counted * _signed_root(P_d - self.P_s, 1.0e3), (P_c - P_i) / self.k_c, returned

    def rates(self, y: Vector, time: float) -> Vector:
        """dy/dt [scaled states per second], y of shape (..., n_states): a Jacobian is one call."""
        c, sv = self.c, self.sv
        P_d, P_c, P_x = y[..., P_D] * BAR, y[..., P_C] * BAR, y[..., P_X] * BAR
        t, w, x = np.tan(y[..., TILT]), y[..., RATE], y[..., X] * 1.0e-3
        P, out, into, leaked, volume, per_tilt, turning = self._chambers(y, self.omega * time + self.pistons)
        density, slope = self.fluid(y[..., N_STATES:] * BAR)
        mu_in, mu_out, mu_d, mu_s = np.moveaxis(self.viscosity(
            np.stack([P_d, P_x, P_d, P_c], axis=-1), np.stack([P_x, P_c, P_c, P_c], axis=-1)), -1, 0)  # fmt: skip
        inflow, outflow = self.control_flows(y, mu_in, mu_out)
        leak, drain, returned = self.circuit_flows(y)
        plate_d, plate_s = self.plate / mu_d * (P_d - P_c), self.plate / mu_s * (self.P_s - P_c)
        load = self.at.discharge_flow_lpm * LPM
        arm = sv["A_stroke"] * sv["L_stroke"] * (1.0 + t * t)
        swept = -arm * w
        dy = np.empty_like(y)
        dy[..., P_D] = out.sum(axis=-1) - load - leak - inflow - plate_d
        dy[..., P_C] = leaked.sum(axis=-1) + plate_d + plate_s + outflow - drain + swept
        dy[..., P_I] = load + leak + drain - returned
        dy[..., P_X] = inflow - outflow - swept
        dy[..., :4] /= self.fluid(y[..., :4] * BAR)[1] * self._volumes * BAR
        jet = 2.0 * c["C_q"] * c["cos_jet"] * c["w_edge"] * self.opening(x - c["x_overlap"]) * (P_d - P_x)
        preload = c["F_preload"] + self.at.pressure_setting_change_bar * BAR * c["A_spool"]
        dy[..., X] = y[..., V] * 1.0e3
        push = (P_d - P_c) * c["A_spool"] - preload - c["k_spool"] * x - jet
        dy[..., V] = (push - c["damping"] * y[..., V]) / c["m_spool"]
        spring = (sv["F_rate"] + sv["k_rate"] * sv["L_rate"] * (self.t_max - t)) * sv["L_rate"] * (1.0 + t * t)
        inertia = 0.5 * self.n * self.p["m"] * (self.p["R"] * self.omega) ** 2 * t * (1.0 + t * t)
        torque = (per_tilt * (P - P_c[..., None])).sum(axis=-1) + spring + inertia - arm * (P_x - P_c)
        carried = (sv["m_stroke"] * sv["L_stroke"] ** 2 + sv["m_rate"] * sv["L_rate"] ** 2) * (1.0 + t * t) ** 2
        dy[..., TILT], dy[..., RATE] = w, (torque + self._resisting(y, mu_d, t)) / (self.sw["J"] + carried)
        grown = density * (turning + per_tilt * w[..., None])
        dy[..., N_STATES:] = (into - out - leaked - grown) / (slope * volume * BAR)
        return dy

    def slopes(self, y: Vector, time: float) -> Vector:
        """Jacobian of ``rates`` by forward differences, shape (n_states, n_states)."""
        moves = 1.0e-7 * np.maximum(np.abs(y), 1.0e-2)
        both = self.rates(np.vstack([y, y + np.diag(moves)]), time)
        found: Vector = ((both[1:] - both[0]) / moves[:, None]).T
        return found

    def _resisting(self, y: Vector, mu: Vector, t: Vector) -> Vector:
        """Damping of the plate with its carried pistons, and the end stops [N m]."""
        sv, sw, w = self.sv, self.sw, y[..., RATE]
        drag = np.zeros_like(mu)
        for name in ("stroke", "rate"):
            d, b = np.sqrt(4.0 * sv[f"A_{name}"] / np.pi), sv[f"b_{name}"]
            own = sv["viscous"] * np.pi * d * sv[f"l_{name}"] / (b * np.sqrt(1.0 - sv[f"e_rel_{name}"] ** 2))
            drag = drag + own * mu * (sv[f"L_{name}"] * (1.0 + t * t)) ** 2
        beyond = np.maximum(y[..., TILT] - sw["alpha_max"], 0.0) + np.minimum(y[..., TILT] - sw["alpha_min"], 0.0)
        elastic = -sw["k_stop"] * beyond
        damped = np.clip(sw["d_stop"] * w, -np.abs(elastic), np.abs(elastic))
        resisting: Vector = elastic - damped - (sw["damping"] + drag) * w
        return resisting

    def start(self, guess: Mapping[str, float]) -> Vector:
        """State near a steady one: pressures [bar gauge] and tilt [deg] of ``guess``; the spool balances the control flows."""
        gauge = [guess[f"{name}_pressure_bar"] for name in ("discharge", "case", "return", "control")]
        y = np.zeros(N_STATES + self.n)
        y[:4] = np.array(gauge) + self.P_amb / BAR
        y[TILT] = np.deg2rad(guess["swashplate_angle_deg"])

        def surplus(x: float) -> float:
            y[X] = x
            P_d, P_c, P_x = y[P_D] * BAR, y[P_C] * BAR, y[P_X] * BAR
            inflow, outflow = self.control_flows(y, self.viscosity(P_d, P_x), self.viscosity(P_x, P_c))
            return float(inflow - outflow)

        y[X] = brentq(surplus, -1.0, 3.0)
        pressed = np.mod(self.pistons, 2.0 * np.pi) < np.pi
        y[N_STATES:] = np.where(pressed, y[P_D], self.P_s / BAR)
        return y

    def viscous_torque(self) -> float:
        """Drag of the sliding films [N m]: as warm as their own friction makes them before ``film_conductance`` carries it off."""
        d, reference = self.drive, 4600.0 * np.pi / 30.0

        def ambient_viscosity(T: float) -> float:
            return self._nu(T) * (self.f["rho_ref"] + self.f["rho_slope"] * (T - self.f["T_ref"]))

        film = 323.15 + d["torque_viscous_ref"] * reference / d["film_conductance"]
        per = d["torque_viscous_ref"] / reference / ambient_viscosity(film) * self.omega

        def surplus(warmed: float) -> float:
            return d["film_conductance"] * warmed - per * ambient_viscosity(self.T + warmed) * self.omega

        most = per * ambient_viscosity(self.T) * self.omega / d["film_conductance"]
        return per * ambient_viscosity(self.T + brentq(surplus, 0.0, most))

    def means(self, guess: Mapping[str, float], settle: int = 12, per: int = 720) -> dict[str, float]:
        """Means over one revolution after ``settle``: gauge pressures [bar], flows [L/min], shaft torque [N m], tilt [deg].

        ``guess`` as of ``start``. No step is longer than two degrees, so that no opening port is passed over.
        """
        period = 2.0 * np.pi / self.omega
        instants = period * np.concatenate(([0.0], settle + np.arange(1, per + 1) / per))
        states = odeint(
            self.rates, self.start(guess), instants, Dfun=self.slopes, rtol=_TOLERANCE, atol=_TOLERANCE,
            hmax=period / 180.0, mxstep=2_000_000,
        )[1:]  # fmt: skip
        angles = self.omega * instants[1:, None] + self.pistons
        P, *_, turning = self._chambers(states, angles)
        hydraulic = -((P - states[:, P_C, None] * BAR) * turning).sum(axis=1) / self.omega
        friction = self.viscous_torque() + self.drive["torque_pressure"] * (states[:, P_D] - states[:, P_C]) * BAR
        drain = self.circuit_flows(states)[1]
        gauge = states[:, :2].mean(axis=0) - self.P_amb / BAR
        return {
            "discharge_pressure_bar": float(gauge[0]),
            "case_pressure_bar": float(gauge[1]),
            "case_flow_lpm": float(drain.mean()) / LPM,
            "discharge_flow_lpm": self.at.discharge_flow_lpm,
            "shaft_torque_nm": float(np.mean(hydraulic + friction)),
            "swashplate_angle_deg": float(np.rad2deg(states[:, TILT].mean())),
        }


def _signed_root(dP: Vector | float, laminar: float) -> Vector:
    """sgn(dP) sqrt(abs(dP)), linear below ``laminar`` [Pa^0.5]."""
    size = np.asarray(dP, dtype=np.float64)
    root: Vector = size / np.sqrt(np.sqrt(size * size + laminar * laminar))
    return root
