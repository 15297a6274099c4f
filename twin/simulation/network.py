"""The hydraulic network of the pump at one instant, as secant conductances Q / dP.

Both integrators stand on this one function: the linearly implicit step solves with the conductances, a reference
integrator multiplies them with the pressure differences. State vector: the chambers' pressures, then P_d, P_c, P_i,
P_ctrl [Pa absolute], spool position and speed, tilt and tilt rate. Flows count volume at ambient density.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled
from twin.laws.bench import return_pressure_drop
from twin.laws.fluid import P_ATMOSPHERE, bulk_modulus, density, gap_viscosity, kinematic_viscosity
from twin.laws.orifice import smooth_orifice_conductance
from twin.parameters import Circuit, Pump
from twin.parts.piston import chamber_volume, volume_by_tilt, volume_rate_by_rotation
from twin.parts.port_plate import window
from twin.parts.swashplate import inertia_torque, spring_torque, stop_torque, stroking_arm
from twin.steady_state import T_50, edge_opening
from twin.units import KELVIN_AT_0_DEGC, M3_PER_S_PER_LPM, PA_PER_BAR, RAD_PER_S_PER_RPM

Vector = NDArray[np.float64]

P_D, P_C, P_I, P_CTRL, X, V_SPOOL, ALPHA, ALPHA_DOT = range(8)
"""Places of the shared states behind the chambers."""
_P_REF = 175.0e5
_SMALL = 1.0e3
"""Pressure difference below which turbulent passages of the circuit count as laminar [Pa]."""


class Scene(NamedTuple):
    """What stays constant over one stretch of a simulation, SI, with what follows from it."""

    omega: float
    P_s: float
    k_d: float
    Q_load: float
    Q_sys: float
    rho: float
    B_0: float
    B_gain: float
    mu_0: float
    mu_slope: float
    k_c: float
    k_cQ: float
    k_inf: float
    K: float
    preload: float
    k_valve: float
    piston_scale: float
    slipper_scale: float
    plate_scale: float
    bleed: float
    throttled: float


@compiled
def scene_of(pump: Pump, circuit: Circuit, row: Vector, k_d: float) -> Scene:
    """Scene of one row of inputs (``twin.condition.INPUTS``); ``k_d`` > 0 is a load resistance [Pa/(m3/s)^2]."""
    T = row[1] + KELVIN_AT_0_DEGC
    fluid, comp = pump.fluid, pump.compensator
    P_c = P_ATMOSPHERE
    mu_0 = gap_viscosity(fluid, T, P_c, P_c)
    mu_slope = math.log(gap_viscosity(fluid, T, P_c + _P_REF, P_c) / mu_0) / _P_REF
    k_c = circuit.k_c * (1.0 + circuit.k_c_slope * (T - circuit.T_ref)) * row[12]
    w_nu, w_Q = circuit.w_nu + row[13], circuit.w_Q + row[14]
    nu_ratio = kinematic_viscosity(fluid, T) / kinematic_viscosity(fluid, T_50)
    preload = comp.F_preload * (1.0 - comp.spring_softening * (T - T_50)) + row[11] * PA_PER_BAR * comp.A_spool
    Q_load = 0.0 if k_d > 0.0 else row[3] * M3_PER_S_PER_LPM
    return Scene(
        omega=row[0] * RAD_PER_S_PER_RPM,
        P_s=(row[2] + row[4]) * PA_PER_BAR,
        k_d=k_d,
        Q_load=Q_load,
        Q_sys=row[10] * M3_PER_S_PER_LPM,
        rho=density(fluid, T, P_ATMOSPHERE),
        B_0=bulk_modulus(fluid, T, P_ATMOSPHERE),
        B_gain=fluid.B_pressure_gain,
        mu_0=mu_0,
        mu_slope=mu_slope,
        k_c=k_c * (w_nu * nu_ratio + 1.0 - w_nu - w_Q),
        k_cQ=k_c * w_Q / circuit.Q_ref,
        k_inf=circuit.k_inf * (1.0 + circuit.k_inf_slope * (T - circuit.T_ref)),
        K=circuit.K * (1.0 + circuit.K_slope * (T - circuit.T_ref)),
        preload=preload + comp.k_spool * comp.x_zero * (1.0 - row[15]),
        k_valve=comp.k_spool * row[15],
        piston_scale=row[5] * row[7],
        slipper_scale=row[5] * row[6],
        plate_scale=row[5] * row[8],
        bleed=row[9] * M3_PER_S_PER_LPM,
        throttled=row[16] * M3_PER_S_PER_LPM,
    )


class Shared(NamedTuple):
    """Conductances [m3/s/Pa] and forces of everything but the chambers at one instant.

    ``e_in_x``, ``e_out_x`` are slopes of the control flows by the spool's position [m2/s]; ``F_spring`` with its
    slope acts against discharge pressure on the spool; ``torque`` (without pressures) with its slopes on the plate.
    """

    load: float
    throttled: float
    plate_d: float
    plate_s: float
    e_in: float
    e_in_x: float
    e_out: float
    e_out_x: float
    bleed: float
    drain: float
    ret: float
    F_spring: float
    F_spring_x: float
    torque: float
    torque_alpha: float
    torque_alpha_dot: float
    arm: float


@compiled
def _turbulent(dP: float, C_q_area: float, rho: float) -> float:
    return smooth_orifice_conductance(dP, C_q_area, rho, _SMALL)


@compiled
def return_conductance(dP: float, k_inf: float, K: float, gamma: float) -> float:
    """Secant conductance of the return line [m3/s/Pa]: equation 3-4 inverted by Newton's method."""
    limit = 1.0 / (k_inf * K)
    if abs(dP) < 1.0e-3:
        return limit
    Q = min(abs(dP) * limit, math.pow(abs(dP) / k_inf, 1.0 / (1.0 + gamma)))
    for _ in range(6):
        h = 1.0e-6 * Q
        f = return_pressure_drop(Q, k_inf, K, gamma)
        slope = (return_pressure_drop(Q + h, k_inf, K, gamma) - f) / h
        step = (abs(dP) - f) / slope
        Q += step
        if abs(step) < 1.0e-12 * Q:
            break
    return Q / abs(dP)


@compiled
def drain_conductance(dP: float, k_c: float, k_cQ: float) -> float:
    """Secant conductance of the drain line [m3/s/Pa]: ``k_c Q + k_cQ Q |Q| = dP`` solved for Q / dP."""
    return 2.0 / (k_c + math.sqrt(k_c * k_c + 4.0 * k_cQ * abs(dP)))


@compiled
def shared_network(pump: Pump, circuit: Circuit, scene: Scene, z: Vector) -> Shared:
    """Passages and forces between the shared states ``z``, shape (8,)."""
    comp, plate = pump.compensator, pump.port_plate
    P_d, P_c, P_i, P_ctrl = z[P_D], z[P_C], z[P_I], z[P_CTRL]
    x, alpha, alpha_dot = z[X], z[ALPHA], z[ALPHA_DOT]
    rho = scene.rho
    load = 1.0 / math.sqrt(scene.k_d * math.sqrt((P_d - P_i) ** 2 + _SMALL**2)) if scene.k_d > 0.0 else 0.0
    gap = scene.plate_scale * plate.h**3 / 12.0 * plate.shape
    plate_d = gap / (scene.mu_0 * math.exp(scene.mu_slope * max(P_d - P_c, 0.0)))
    w = comp.C_q * comp.w_edge
    per_in, per_out = _turbulent(P_d - P_ctrl, w, rho), _turbulent(P_ctrl - P_c, w, rho)
    open_in, slope_in = edge_opening(x - comp.x_overlap, comp.c_edge)
    open_out, slope_out = edge_opening(-x - comp.x_overlap, comp.c_edge)
    ring = math.pi * comp.d_spool * comp.c_spool**3 / 12.0
    mu_in = scene.mu_0 * math.exp(scene.mu_slope * max(P_d - P_ctrl, 0.0))
    mu_out = scene.mu_0 * math.exp(scene.mu_slope * max(P_ctrl - P_c, 0.0))
    d_stroke = math.sqrt(4.0 * comp.A_stroke / math.pi)
    stroke = math.pi * d_stroke * comp.b_stroke**3 / (12.0 * mu_out * comp.l_stroke)
    bleed = _turbulent(P_ctrl - P_c, comp.C_q * 0.25 * math.pi * comp.d_bleed**2, rho)
    jet = 2.0 * comp.C_q * comp.cos_jet * comp.w_edge * (P_d - P_ctrl)
    t = math.tan(alpha)
    spring = spring_torque(comp, pump.swashplate.alpha_max, alpha)
    contact = 1.0 if alpha > pump.swashplate.alpha_max else 0.0
    P_down = P_i if circuit.shared > 0.5 else scene.P_s
    damping = pump.swashplate.damping
    torque = spring + inertia_torque(pump.piston, alpha, scene.omega)
    torque += stop_torque(pump.swashplate, alpha, alpha_dot) - damping * alpha_dot
    bleed_extra = scene.bleed * math.tanh((P_ctrl - P_c) / (0.05 * comp.F_rate / comp.A_stroke))
    return Shared(
        load=load,
        throttled=scene.throttled / math.sqrt(_P_REF * math.sqrt((P_d - P_c) ** 2 + _SMALL**2)),
        plate_d=plate_d,
        plate_s=gap / scene.mu_0,
        e_in=per_in * open_in + ring / (mu_in * comp.l_seal_discharge),
        e_in_x=per_in * slope_in * (P_d - P_ctrl),
        e_out=per_out * open_out + ring / (mu_out * comp.l_seal_case) + stroke + bleed,
        e_out_x=-per_out * slope_out * (P_ctrl - P_c),
        bleed=bleed_extra,
        drain=drain_conductance(P_c - P_down, scene.k_c, scene.k_cQ),
        ret=return_conductance(P_i - scene.P_s, scene.k_inf, scene.K, circuit.gamma),
        F_spring=scene.preload + scene.k_valve * x + jet * open_in + comp.damping * z[V_SPOOL],
        F_spring_x=scene.k_valve + jet * slope_in,
        torque=torque,
        torque_alpha=-comp.k_rate * comp.L_rate**2 * (1.0 + t * t) ** 2 - contact * pump.swashplate.k_stop,
        torque_alpha_dot=-damping - contact * pump.swashplate.d_stop,
        arm=stroking_arm(comp, alpha),
    )


@compiled
def chamber_network(
    pump: Pump, scene: Scene, y: Vector, n: int, theta: float, scales: NDArray[np.float64], out: NDArray[np.float64]
) -> None:
    """Passages of every chamber into ``out``, shape (n, at least 9).

    Columns: conductance to discharge, to suction, to the case; drag flow to the case [m3/s]; volume [m3]; its rate
    by rotation [m3/s]; its slope by tilt [m3/rad]; cosine and sine of the piston's angle. ``scales`` (n, 2) multiply
    each piston's and each slipper's leakage.
    """
    piston, slipper, plate = pump.piston, pump.slipper, pump.port_plate
    P_c, alpha = y[n + P_C], y[n + ALPHA]
    P_d = y[n + P_D]
    t, t_max = math.tan(alpha), math.tan(pump.swashplate.alpha_max)
    ring = math.pi * piston.d_p * piston.b**3 / 12.0
    land = math.pi * slipper.h**3 / (6.0 * math.log(slipper.diameter_ratio))
    K = slipper.C_q * 0.25 * math.pi * slipper.d_throttle**2 * math.sqrt(2.0 / scene.rho)
    # the next piston's angle by rotation: one sine and cosine for all of them
    c, s = math.cos(theta), math.sin(theta)
    turn_c, turn_s = math.cos(2.0 * math.pi / n), math.sin(2.0 * math.pi / n)
    delayed = (theta - plate.phi_commutation) % (2.0 * math.pi)
    for k in range(n):
        P = y[k]
        out[k, 0] = out[k, 1] = 0.0
        if delayed < math.pi:
            area = plate.C_q * window(plate, delayed)
            out[k, 0] = smooth_orifice_conductance(P - P_d, area, scene.rho, plate.dP_laminar)
        else:
            area = plate.C_q * window(plate, delayed - math.pi)
            out[k, 1] = smooth_orifice_conductance(P - scene.P_s, area, scene.rho, plate.dP_laminar)
        mu = scene.mu_0 * math.exp(scene.mu_slope * max(P - P_c, 0.0))
        G = land / mu
        throttled = 2.0 * K * G / (K + math.sqrt(K * K + 4.0 * G * G * abs(P - P_c)))
        gap = ring / (mu * (piston.l_mean - piston.R * t * c))
        out[k, 2] = scene.slipper_scale * scales[k, 1] * throttled + scene.piston_scale * scales[k, 0] * gap
        out[k, 3] = -0.5 * piston.R * t * s * scene.omega * piston.b * math.pi * piston.d_p
        out[k, 4] = chamber_volume(piston, t_max, t, c)
        out[k, 5] = volume_rate_by_rotation(piston, t, s, scene.omega)
        out[k, 6] = volume_by_tilt(piston, t, c)
        out[k, 7], out[k, 8] = c, s
        c, s = c * turn_c - s * turn_s, s * turn_c + c * turn_s
        delayed += 2.0 * math.pi / n
        if delayed >= 2.0 * math.pi:
            delayed -= 2.0 * math.pi
