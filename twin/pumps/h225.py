"""The H225's main hydraulic pump (part 46159, model AP2V-0120) as the acceptance sheet shows the real one.

Fitted numbers say so in their source. Fitted to the sheet of DT 907 (annex A-4: 63 degC, 4605 rpm): slipper gap
(case flow at full flow), bleed (case flow at zero flow), spool preload (zero-flow pressure), friction (zero-flow
torque). Fitted to the droop that the test points allow (175 bar at zero flow, 167 bar near full flow): spool
rate, rate-spring stiffness. The rest are estimates that meet the thesis' targets together.
"""

from collections.abc import Mapping

from twin.parameters import (
    Compensator,
    Drive,
    Piston,
    PortPlate,
    Pump,
    PumpType,
    Quantity,
    Sensor,
    ServoPistons,
    Slipper,
    Swashplate,
    Volumes,
    block,
)
from twin.pumps.fluids import FLUIDS, MIL_PRF_83282

_EST = "estimate: meets the thesis' targets together with the other geometry"
_SHEET = "fitted to the acceptance sheet, Mkadara 2020, annex A-4"
_DROOP = "fitted to a droop of about 0.15 bar/(L/min), inside what the test points of annex A-1 allow"

PISTON: Mapping[str, Quantity] = {
    "n": Quantity(9, "-", "Mkadara 2020, section 2.1"),
    "d_p": Quantity(9.75, "mm", _EST),
    "R": Quantity(17.5, "mm", f"{_EST}; pitch circle 35 mm"),
    "b": Quantity(5.6, "um", "from table 4-3: three pistons leak 0.0023 L/min there", 0.3),
    "e_rel": Quantity(0.0, "-", "centred: the clearance itself is fitted to table 4-3"),
    "l_mean": Quantity(20.0, "mm", _EST),
    "V_dead": Quantity(0.25, "cm3", _EST, 0.2),
    "m": Quantity(20.0, "g", "estimate: steel piston of that size with its slipper", 0.3),
}
SLIPPER: Mapping[str, Quantity] = {
    "h": Quantity(8.743480, "um", _SHEET, 0.1),
    "diameter_ratio": Quantity(1.45, "-", "Mkadara 2020, table 2-10"),
    "d_throttle": Quantity(0.67, "mm", "estimate: one geometry that meets table 2-13"),
    "C_q": Quantity(0.7, "-", "usual limit coefficient of a short orifice"),
    "variable": Quantity(0, "-", "constant gap, as in section 3.3.2.1"),
    "balance": Quantity(1.022, "-", "one value that meets table 2-13; must exceed 1/cos(alpha) to lift", 0.005),
    "V_pocket": Quantity(30.0, "mm3", "estimate: pocket of some 8 mm, half a millimetre deep", 0.5),
    "h_min": Quantity(0.5, "um", "estimate: roughness of lapped faces, where contact begins", 0.5),
    "h_retainer": Quantity(116.0, "um", "one value that meets table 2-13", 0.3),
    "k_contact": Quantity(2.0e4, "N/mm", "estimate: one micrometre at 20 N, bronze on steel in the thesis' sense", 0.5),
    "d_contact": Quantity(500.0, "N s/m", "estimate: no rebound", 0.5),
    "damping": Quantity(10.0, "N s/m", "estimate: viscous drag of the piston in its bore", 0.5),
    "squeeze": Quantity(1.0, "-", "film damping of section 2.6.3, present"),
    "pumped_repair": Quantity(1.0, "-", "section 2.6.3: one area for force and swept volume"),
}
PORT_PLATE: Mapping[str, Quantity] = {
    "h": Quantity(3.43, "um", "Mkadara 2020, table 3-9 (average of scattered fits)", 0.9),
    "shape": Quantity(30.0, "-", "estimate: two lands of 150 deg at 17.5 mm radius, 3 mm wide", 0.3),
    "phi_commutation": Quantity(0.02, "rad", "estimate: delay of the pressure in the chambers", 0.5),
    "phi_seal": Quantity(2.0, "deg", "estimate: sealing land a little wider than the chamber's port", 0.5),
    "phi_ramp": Quantity(20.0, "deg", "estimate: timing groove and kidney end", 0.5),
    "A_port": Quantity(40.0, "mm2", "estimate: half of the piston's area", 0.3),
    "C_q": Quantity(0.7, "-", "usual limit coefficient of a sharp edge"),
    "dP_laminar": Quantity(0.02, "bar", "estimate: transition near Re 1000 in a port of some millimetres", 0.5),
}
SWASHPLATE: Mapping[str, Quantity] = {
    "alpha_min": Quantity(-0.12, "rad", "estimate: a little past zero; section 2.5.3.2 shows negative tilt", 0.5),
    "alpha_max": Quantity(0.264, "rad", "Mkadara 2020, table 3-9", 0.013),
    "J": Quantity(2.5e-4, "kg m2", _EST, 0.3),
    "damping": Quantity(0.5, "N m s", "estimate: bearings and churning; damps the regulated pressure", 0.5),
    "T_coulomb": Quantity(0.0, "N m", "none assumed when healthy: the pistons' forces shake the bearings loose"),
    "T_static": Quantity(0.0, "N m", "none assumed when healthy"),
    "w_friction": Quantity(0.05, "rad/s", "estimate: small against the rates of a load step, some rad/s", 0.5),
    "k_stop": Quantity(1.0e5, "N m/rad", "estimate: steel stop, 0.01 rad at 1 kN m", 0.5),
    "d_stop": Quantity(20.0, "N m s", "estimate: stops without rebound", 0.5),
}
COMPENSATOR: Mapping[str, Quantity] = {
    "A_spool": Quantity(28.0, "mm2", "estimate: 500 N of jamming hold against 175 bar, section 2.5.3.2", 0.1),
    "F_preload": Quantity(460.7946, "N", _SHEET, 0.005),
    "k_spool": Quantity(61.8445, "N/mm", _DROOP, 0.5),
    "x_zero": Quantity(
        0.413153, "mm", "spool position of the healthy pump at zero flow and 50 degC (our own solution)"
    ),
    "x_low": Quantity(-4.0, "mm", "estimate: travel of the spool towards its stop", 0.5),
    "x_high": Quantity(4.0, "mm", "estimate: travel of the spool towards its stop", 0.5),
    "k_stop": Quantity(1.0e3, "N/mm", "estimate: steel stop", 0.5),
    "edge_law": Quantity(0, "-", "smooth law of our own: differentiable, within the published laws' spread"),
    "n_edge": Quantity(1, "-", "one slot of width w_edge"),
    "w_edge": Quantity(0.20, "mm", _DROOP, 0.5),
    "c_edge": Quantity(5.0, "um", "estimate: sharp edge, rounded by a clearance", 0.5),
    "edge_radius": Quantity(1.0, "um", "estimate: rounding of a new edge, which erosion increases", 0.5),
    "delta_lambda": Quantity(7.0e-4, "-", "C_q over a transition flow number of 1000, the usual value", 0.3),
    "K_rec": Quantity(2.0, "1/um", "estimate: an overlap of 10 um leaves a tenth of the laminar flow", 0.5),
    "x_overlap": Quantity(10.0, "um", "estimate: closed-centre valve, section 2.5.1.1", 0.5),
    "C_q": Quantity(0.7, "-", "usual limit coefficient of a sharp edge"),
    "cos_jet": Quantity(0.358, "-", "cosine of the 69 deg jet angle of a sharp edge, section 2.5.1.1.2"),
    "L_jet": Quantity(0.0, "mm", "transient jet force off: small beside the viscous damping"),
    "d_spool": Quantity(5.97, "mm", "diameter of the spool area"),
    "c_spool": Quantity(6.0, "um", "estimate: usual clearance of a lapped spool", 0.5),
    "e_rel": Quantity(0.0, "-", "centred: the bleed is fitted whatever path it takes"),
    "l_seal_discharge": Quantity(0.6, "mm", "estimate: short seal beside the metering slots", 0.5),
    "l_seal_case": Quantity(3.0, "mm", _EST, 0.5),
    "d_bleed": Quantity(0.370781, "mm", _SHEET, 0.2),
    "spring_softening": Quantity(0.0, "1/K", "not modelled: no temperature series of the setting is published"),
    "m_spool": Quantity(10.0, "g", "estimate: steel spool with a third of its spring", 0.3),
    "damping": Quantity(20.0, "N s/m", "estimate: viscous drag of the lands", 0.5),
    "F_coulomb": Quantity(0.0, "N", "none assumed when healthy: pulsation shakes the spool loose"),
    "F_static": Quantity(0.0, "N", "none assumed when healthy"),
    "v_friction": Quantity(0.2, "mm/s", "10 000 times below the spool's fastest, section 2.5.2.2"),
}
SERVO: Mapping[str, Quantity] = {
    "A_stroke": Quantity(120.0, "mm2", "estimate: small enough that a load step peaks below 257 bar, table 2-8", 0.2),
    "L_stroke": Quantity(28.0, "mm", _EST),
    "b_stroke": Quantity(8.0, "um", "estimate: usual clearance of a servo piston", 0.5),
    "e_rel_stroke": Quantity(0.0, "-", "centred: the bleed is fitted whatever path it takes"),
    "l_stroke": Quantity(15.0, "mm", _EST),
    "m_stroke": Quantity(20.0, "g", "estimate: steel piston of that size", 0.3),
    "F_coulomb_stroke": Quantity(0.0, "N", "none assumed when healthy"),
    "F_static_stroke": Quantity(0.0, "N", "none assumed when healthy"),
    "A_rate": Quantity(50.0, "mm2", "20.3 MPa of table 3-9 times it is 1 kN", 0.2),
    "L_rate": Quantity(28.0, "mm", _EST),
    "F_rate": Quantity(441.7923, "N", "1 kN at zero tilt less the spring's travel", 0.3),
    "k_rate": Quantity(73.7525, "N/mm", f"{_DROOP}; 1 kN at zero tilt: 20.3 MPa of table 3-9 on 50 mm2", 0.3),
    "rate_fed": Quantity(0, "-", "spring bore vented to the case: table 3-9 calls its preload the spring's"),
    "b_rate": Quantity(8.0, "um", "estimate: usual clearance of a servo piston", 0.5),
    "e_rel_rate": Quantity(0.0, "-", "centred"),
    "l_rate": Quantity(15.0, "mm", _EST),
    "m_rate": Quantity(20.0, "g", "estimate: steel piston of that size with a third of its spring", 0.3),
    "F_coulomb_rate": Quantity(0.0, "N", "none assumed when healthy"),
    "F_static_rate": Quantity(0.0, "N", "none assumed when healthy"),
    "viscous": Quantity(1.0, "-", "drag of the gaps by equation 2-11, as it comes"),
    "v_friction": Quantity(1.0, "mm/s", "estimate: small against the strokes of a load step, some 100 mm/s"),
    "contact": Quantity(0, "-", "both pistons follow the plate: springs and pressure keep them on it"),
    "k_contact": Quantity(2.0e4, "N/mm", "estimate: steel ball end on a steel plate", 0.5),
    "d_contact": Quantity(500.0, "N s/m", "estimate: little rebound", 0.5),
}
VOLUMES: Mapping[str, Quantity] = {
    "discharge": Quantity(
        0.75, "L", "estimate: bench line with its hoses' give; sets the peak of a load step, table 2-8", 0.3
    ),
    "case": Quantity(0.8, "L", "estimate: housing less the rotating group", 0.3),
    "return_line": Quantity(0.5, "L", "estimate: hose and fittings", 0.5),
    "control": Quantity(4.0, "cm3", "estimate: bore and gallery of the stroking piston", 0.3),
}
DRIVE: Mapping[str, Quantity] = {
    "torque_viscous_ref": Quantity(1.0, "N m", _SHEET, 0.3),
    "torque_pressure": Quantity(
        0.049564, "cm3", f"{_SHEET}: N m of Coulomb friction per Pa of discharge pressure", 0.3
    ),
    "film_conductance": Quantity(
        48.0, "W/K", "estimate: 10 K of self-heating at 50 degC and 4600 rpm, so that a cold start asks some N m", 0.5
    ),
    "heat_share": Quantity(
        0.5, "-", "estimate: half of the friction warms the case, the rest leaves with the delivery and the shaft", 0.5
    ),
    "case_conductance": Quantity(
        15.0, "W/K", "estimate: 0.1 m2 of housing in moving air, and the housing's contact with the through-flow", 0.5
    ),
    "J": Quantity(0.0, "kg m2", "ideal speed: a main gear box does not give way to one pump"),
    "stiffness": Quantity(0.85, "N m s", "13.4 N m of a load step move the bench's drive by 150 rpm, figure 3-16", 0.3),
}

_PARTS: Mapping[str, Mapping[str, Quantity]] = {
    "piston": PISTON,
    "slipper": SLIPPER,
    "port_plate": PORT_PLATE,
    "swashplate": SWASHPLATE,
    "compensator": COMPENSATOR,
    "volumes": VOLUMES,
    "servo": SERVO,
    "drive": DRIVE,
    "fluid": MIL_PRF_83282,
}

LIMITS: Mapping[str, Quantity] = {
    "case_flow_lpm": Quantity(1.5, "L/min", "Mkadara 2020, table 2-1: largest case flow at zero flow"),
    "case_flow_low_lpm": Quantity(0.3, "L/min", "Mkadara 2020, table 2-1: smallest case flow at zero flow"),
    "reference_temperature_k": Quantity(333.15, "K", "Mkadara 2020, table 2-1: 60 degC"),
    "zero_flow_pressure_low_bar": Quantity(173.0, "bar", "Mkadara 2020, table 2-1"),
    "zero_flow_pressure_high_bar": Quantity(177.0, "bar", "Mkadara 2020, table 2-1"),
    "case_pressure_limit_bar": Quantity(
        3.5,
        "bar",
        "estimate, over the reservoir: shaft seal and case of such pumps are commonly rated for a few bar",
        0.3,
    ),
}

_FAULT_STATES = ("pump_degradation", "compensator_fault", "system_leakage", "drain_restriction", "sensor_fault")
_ONSETS = "estimate, the same for every fault: priors that do not decide, until a fleet's findings say otherwise"
POPULATION: Mapping[str, Quantity] = {
    "pump_leakage_scale": Quantity(0.30, "-", "estimate: spans the acceptance limits of case flow"),
    "pressure_setting_bar": Quantity(1.0, "bar", "acceptance limits 173 to 177 bar as two sigma"),
    "drain_resistance_scale": Quantity(0.20, "-", "estimate: hoses and fittings between aircraft"),
    "drain_viscosity_weight": Quantity(0.30, "-", "estimate: hoses explain 40 % of k_c at 50 degC"),
    "drain_flow_weight": Quantity(0.40, "-", "estimate: fittings explain the rest"),
    "system_leakage_lpm": Quantity(0.2, "L/min", "by-pass 0.3 to 0.7 L/min of table 2-1, round its mean"),
    "droop_scale": Quantity(1.0, "-", "estimate: droop times 0.3 to 3 between pumps"),
    "reservoir_pressure_bar": Quantity(0.5, "bar", "estimate: spread where no reservoir sensor is fitted"),
    "case_zero_bar": Quantity(0.06, "bar", "zero shift between campaigns of a published rig (Rojek, Blachnik 2024)"),
    **{f"{state}_onsets": Quantity(1.0, "1/1000 records", _ONSETS) for state in _FAULT_STATES},
}
"""How pumps, aircraft and sensors differ; and how often each fault sets in."""

H225 = PumpType(
    name="h225",
    title="H225 main hydraulic pump, 46159 (AP2V-0120)",
    pump=Pump(
        piston=block(Piston, PISTON),
        slipper=block(Slipper, SLIPPER),
        port_plate=block(PortPlate, PORT_PLATE),
        swashplate=block(Swashplate, SWASHPLATE),
        compensator=block(Compensator, COMPENSATOR),
        volumes=block(Volumes, VOLUMES),
        servo=block(ServoPistons, SERVO),
        drive=block(Drive, DRIVE),
        fluid=FLUIDS["MIL-PRF-83282"],
    ),
    quantities={f"{part}.{name}": q for part, fields in _PARTS.items() for name, q in fields.items()},
    nominal_speed_rpm=4600.0,
    nominal_reservoir_pressure_bar=0.0,
    sensors={
        "discharge_pressure_bar": Sensor(350.0, 0.01, 0.001),
        "case_pressure_bar": Sensor(5.0, 0.01, 0.001),
        "reservoir_pressure_bar": Sensor(5.0, 0.01, 0.001),
    },
    limits=LIMITS,
    population=POPULATION,
)
