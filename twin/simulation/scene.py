"""What the pump sees at one instant, SI, with everything that follows from it alone."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin import columns as at
from twin.compiled import compiled
from twin.condition import INPUTS
from twin.laws.compressibility import Medium, medium_of
from twin.laws.fluid import P_ATMOSPHERE, Film, density, film_of, kinematic_viscosity
from twin.laws.metering_edge import Edge
from twin.parameters import Circuit, Pump
from twin.parts.compensator import edge_of
from twin.parts.drive import T_REF, viscous_torque
from twin.parts.slipper import (
    land_area,
    land_coefficient,
    outer_area,
    squeeze_coefficient,
    throttle_coefficient,
)
from twin.units import KELVIN_AT_0_DEGC, M3_PER_S_PER_LPM, PA_PER_BAR, RAD_PER_S_PER_RPM

Vector = NDArray[np.float64]

TRANSIENT_INPUTS: tuple[str, ...] = (
    "load_conductance_lpm_per_sqrt_bar",
    "spool_jamming_force_n",
    "swashplate_friction_nm",
)
"""Inputs that only the transient pump has, behind those of ``twin.condition.INPUTS``: the load as an opening
(1 / sqrt(k_d) of equation 3-2), friction of a jammed spool (2-24), friction of the plate's bearings."""
SCENE_INPUTS: tuple[str, ...] = INPUTS + TRANSIENT_INPUTS
N_SCENE = len(SCENE_INPUTS)
LOAD_OPENING, SPOOL_JAMMING, PLATE_FRICTION = range(len(INPUTS), N_SCENE)


class Scene(NamedTuple):
    """Conditions and health of one instant with the fluid's properties and the passages' coefficients."""

    omega: float
    P_s: float
    P_amb: float
    load: float
    Q_load: float
    Q_sys: float
    rho: float
    nu: float
    medium: Medium
    film: Film
    T: float
    k_c: float
    w_nu: float
    w_Q: float
    Q_ref: float
    k_inf: float
    K: float
    preload: float
    k_valve: float
    piston_scale: float
    slipper_scale: float
    plate_scale: float
    bleed: float
    throttled: float
    edge: Edge
    jam: float
    plate_friction: float
    viscous: float
    ring: float
    ring_drag: float
    land: float
    throttle: float
    S_eq: float
    A_outer: float
    squeeze: float
    t_max: float
    pitch_c: float
    pitch_s: float


@compiled
def scene_of(pump: Pump, circuit: Circuit, row: Vector) -> Scene:
    """Scene of one row of inputs in the order of ``SCENE_INPUTS`` (edge units), shape (>= N_SCENE,)."""
    T = row[at.TEMPERATURE] + KELVIN_AT_0_DEGC
    fluid, comp, piston, slipper = pump.fluid, pump.compensator, pump.piston, pump.slipper
    preload = (
        comp.F_preload * (1.0 - comp.spring_softening * (T - T_REF))
        + row[at.SETTING_CHANGE] * PA_PER_BAR * comp.A_spool
    )
    rho = density(fluid, T, P_ATMOSPHERE)
    warmer = T - circuit.T_ref
    return Scene(
        omega=row[at.SPEED] * RAD_PER_S_PER_RPM,
        P_s=(row[at.RESERVOIR] + row[at.AMBIENT]) * PA_PER_BAR,
        P_amb=row[at.AMBIENT] * PA_PER_BAR,
        load=row[LOAD_OPENING] * M3_PER_S_PER_LPM / math.sqrt(PA_PER_BAR),
        Q_load=row[at.ASKED_FLOW] * M3_PER_S_PER_LPM,
        Q_sys=row[at.SYSTEM_LEAKAGE] * M3_PER_S_PER_LPM,
        rho=rho,
        nu=kinematic_viscosity(fluid, T),
        medium=medium_of(fluid, T),
        film=film_of(fluid, T),
        T=T,
        k_c=circuit.k_c * (1.0 + circuit.k_c_slope * warmer) * row[at.DRAIN_SCALE],
        w_nu=circuit.w_nu + row[at.DRAIN_VISCOSITY_CHANGE],
        w_Q=circuit.w_Q + row[at.DRAIN_FLOW_CHANGE],
        Q_ref=circuit.Q_ref,
        k_inf=circuit.k_inf * (1.0 + circuit.k_inf_slope * warmer),
        K=circuit.K * (1.0 + circuit.K_slope * warmer),
        preload=preload + comp.k_spool * comp.x_zero * (1.0 - row[at.DROOP_SCALE]),
        k_valve=comp.k_spool * row[at.DROOP_SCALE],
        piston_scale=row[at.PUMP_SCALE] * row[at.PISTON_SCALE],
        slipper_scale=row[at.PUMP_SCALE] * row[at.SLIPPER_SCALE],
        plate_scale=row[at.PUMP_SCALE] * row[at.PORT_PLATE_SCALE],
        bleed=row[at.CONTROL_BLEED] * M3_PER_S_PER_LPM,
        throttled=row[at.THROTTLED_LEAKAGE] * M3_PER_S_PER_LPM,
        edge=edge_of(comp, row[at.EDGE_ROUNDING] * 1.0e-6),
        jam=row[SPOOL_JAMMING],
        plate_friction=row[PLATE_FRICTION],
        viscous=viscous_torque(pump.drive, fluid, T, row[at.SPEED] * RAD_PER_S_PER_RPM),
        ring=math.pi * piston.d_p * piston.b**3 / 12.0 * (1.0 + 1.5 * piston.e_rel**2),
        ring_drag=0.5 * piston.b * math.pi * piston.d_p,
        land=land_coefficient(slipper),
        throttle=throttle_coefficient(slipper, rho),
        S_eq=land_area(piston, slipper),
        A_outer=outer_area(piston, slipper),
        squeeze=squeeze_coefficient(piston, slipper),
        t_max=math.tan(pump.swashplate.alpha_max),
        pitch_c=math.cos(2.0 * math.pi / piston.n),
        pitch_s=math.sin(2.0 * math.pi / piston.n),
    )
