"""Anchors: the nominal twin at the condition of a window, in the few numbers that a judge's update needs.

A filter bank asks the twin some hundred times a record. The operating point answers once, for the healthy pump of
the type at the window's own condition; around that answer the pressures follow in closed form from the flows
(``detectors.expectation.reduced_twin``), which costs a fraction of a microsecond a question.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled
from twin.condition import INPUTS, OUTPUTS, Condition, Health, OperatingPoints, input_rows
from twin.laws.fluid import Fluid, kinematic_viscosity, throttling_heating
from twin.operating_point.equations import drain_viscosity_ratio
from twin.operating_point.points import slipper_model
from twin.operating_point.solver import solve_batch
from twin.parameters import Circuit, Drive, Pump, PumpType
from twin.parts.slipper_map import SlipperMap
from twin.units import KELVIN_AT_0_DEGC, M3_PER_S_PER_LPM, PA_PER_BAR

Array = NDArray[np.float64]

COLUMNS: tuple[str, ...] = (
    "regulated_difference",  # discharge minus case pressure of the nominal pump [bar]
    "reservoir",  # gauge [bar]
    "load_flow",  # [L/min]
    "slipper_flow",  # nominal slipper leakage here [L/min]
    "laminar_flow",  # nominal leakage of pistons and port plate here [L/min]
    "compensator_flow",  # nominal flow from the compensator to the case [L/min]
    "droop",  # d(difference)/d(droop scale) [bar]
    "by_slippers",  # d(difference)/d(slipper leakage) [bar/(L/min)]
    "by_laminar",
    "by_throttled",
    "by_system",
    "by_bleed",
    "by_setting",  # d(difference)/d(setting) [-]
    "compensator_by_slippers",  # d(case flow)/d(slipper leakage) beside that leakage itself and the gaps' own share of the
    # difference: the plate tilts, its control pressure falls, chambers commute earlier [-]
    "compensator_by_laminar",
    "compensator_by_throttled",
    "compensator_by_system",
    "compensator_by_bleed",
    "compensator_by_setting",  # [L/min/bar]
    "drain",  # k_c at this temperature [bar/(L/min)]
    "drain_weight_viscosity",  # the circuit's own weights of the drain law [-]
    "drain_weight_flow",
    "drain_flow",  # flow at which the weights are counted [L/min]
    "viscosity_ratio",  # of the drain law, at the nominal pump's case flow [-]
    "friction_warmth",  # what the shaft's friction takes off its logarithm by warming the case of the nominal pump [-]
    "heat_flow",  # what carries friction heat off beside the case flow, as a flow [L/min]
    "return_coefficient",  # k_inf [bar/(L/min)^(1 + gamma)]
    "return_constant",  # K [(L/min)^gamma]
    "return_exponent",  # gamma [-]
    "shared",  # 1 when drain and load share the return line
    "slipper_law",  # slipper leakage here over that at the reference condition [-]
    "laminar_law",  # the same of pistons and port plate [-]
    "system_law",  # viscosity at 50 degC over viscosity here: what a laminar leak is multiplied with [-]
    "warmth",  # (fluid temperature - 50 degC) / 30 K
    "discharge_by_temperature",  # [bar/K]
    "case_by_temperature",
    "discharge_by_load",  # [bar/(L/min)]
    "case_by_load",
)
COLUMN = {name: i for i, name in enumerate(COLUMNS)}
_NEEDED = np.array(
    [
        INPUTS.index(name)
        for name in (
            "fluid_temperature_degc",
            "discharge_flow_lpm",
            "slipper_leakage_scale",
            "piston_leakage_scale",
            "port_plate_leakage_scale",
            "control_bleed_lpm",
            "system_leakage_lpm",
            "pressure_setting_change_bar",
            "droop_scale",
            "throttled_leakage_lpm",
        )
    ]
)
"""Inputs that an anchor is differentiated by; the others' columns stay NaN."""


def reference_condition(pump: PumpType) -> Condition:
    """The pump type's reference condition: nominal speed, zero flow, the acceptance sheet's temperature."""
    temperature = pump.limits["reference_temperature_k"].value - KELVIN_AT_0_DEGC
    return Condition(pump.nominal_speed_rpm, temperature, pump.nominal_reservoir_pressure_bar)


def anchors(conditions: Sequence[Condition], pump: PumpType, circuit: Circuit) -> tuple[Array, NDArray[np.bool_]]:
    """Anchors of many windows at once.

    Parameters
    ----------
    conditions
        Where the windows were taken, length n.
    pump, circuit
        What the twin is told.

    Returns
    -------
    rows
        Shape (n, len(COLUMNS)), in bar and L/min.
    solved
        Where the twin has a solution, shape (n,); the other rows hold NaN.
    """
    asked = [*conditions, reference_condition(pump)]
    points = _solved_apart(pump.pump, input_rows(asked, [Health()] * len(asked)), circuit)
    rows = np.empty((len(asked), len(COLUMNS)))

    def put(name: str, values: Array | float) -> None:
        rows[:, COLUMN[name]] = values

    def slope(by: str) -> Array:
        return points.derivative("discharge_pressure_bar", by) - points.derivative("case_pressure_bar", by)

    celsius = np.array([c.fluid_temperature_degc for c in asked])
    kelvin = celsius + KELVIN_AT_0_DEGC
    slippers = points.value("slipper_leakage_lpm")
    laminar = points.value("piston_leakage_lpm") + points.value("port_plate_leakage_lpm")
    difference = points.value("discharge_pressure_bar") - points.value("case_pressure_bar")
    put("regulated_difference", difference)
    put("reservoir", np.array([c.reservoir_pressure_bar for c in asked]))
    put("load_flow", np.array([c.discharge_flow_lpm for c in asked]))
    put("slipper_flow", slippers)
    put("laminar_flow", laminar)
    put("compensator_flow", points.value("case_flow_lpm") - slippers - laminar)
    put("droop", slope("droop_scale"))
    put("by_slippers", slope("slipper_leakage_scale") / slippers)
    put("by_laminar", (slope("piston_leakage_scale") + slope("port_plate_leakage_scale")) / laminar)
    put("by_throttled", slope("throttled_leakage_lpm"))
    put("by_system", slope("system_leakage_lpm"))
    put("by_bleed", slope("control_bleed_lpm"))
    put("by_setting", slope("pressure_setting_change_bar"))

    def compensator(*by: str) -> Array:
        """What the case flow gains beside a leakage itself and what the regulated difference makes of the gaps."""
        gaps = (slippers + laminar) / difference
        return np.asarray(sum(points.derivative("case_flow_lpm", b) - gaps * slope(b) for b in by))

    both = compensator("piston_leakage_scale", "port_plate_leakage_scale")
    put("compensator_by_slippers", compensator("slipper_leakage_scale") / slippers - 1.0)
    put("compensator_by_laminar", both / laminar - 1.0)
    put("compensator_by_throttled", compensator("throttled_leakage_lpm") - 1.0)
    put("compensator_by_system", compensator("system_leakage_lpm"))
    put("compensator_by_bleed", compensator("control_bleed_lpm"))
    put("compensator_by_setting", compensator("pressure_setting_change_bar"))
    by_flow = M3_PER_S_PER_LPM / PA_PER_BAR
    put("drain", circuit.k_c * (1.0 + circuit.k_c_slope * (kelvin - circuit.T_ref)) * by_flow)
    put("drain_weight_viscosity", circuit.w_nu)
    put("drain_weight_flow", circuit.w_Q)
    put("drain_flow", circuit.Q_ref / M3_PER_S_PER_LPM)
    fluid, drive = pump.pump.fluid, pump.pump.drive
    case = points.value("case_temperature_degc") + KELVIN_AT_0_DEGC
    ratio, per_pascal, per_kelvin, law = _of_fluid(drive, fluid, circuit.Q_ref, kelvin, case)
    put("viscosity_ratio", ratio)
    put("friction_warmth", per_kelvin * (case - kelvin - per_pascal * PA_PER_BAR * difference))
    put("heat_flow", drive.case_conductance * per_pascal / M3_PER_S_PER_LPM)
    warmer = kelvin - circuit.T_ref
    per_gamma = M3_PER_S_PER_LPM**circuit.gamma
    put("return_coefficient", circuit.k_inf * (1.0 + circuit.k_inf_slope * warmer) * by_flow * per_gamma)
    put("return_constant", circuit.K * (1.0 + circuit.K_slope * warmer) / per_gamma)
    put("return_exponent", circuit.gamma)
    put("shared", circuit.shared)
    put("slipper_law", slippers / slippers[-1])
    put("laminar_law", laminar / laminar[-1])
    put("system_law", law)
    put("warmth", (celsius - 50.0) / 30.0)
    put("discharge_by_temperature", points.derivative("discharge_pressure_bar", "fluid_temperature_degc"))
    put("case_by_temperature", points.derivative("case_pressure_bar", "fluid_temperature_degc"))
    put("discharge_by_load", points.derivative("discharge_pressure_bar", "discharge_flow_lpm"))
    put("case_by_load", points.derivative("case_pressure_bar", "discharge_flow_lpm"))
    solved = points.status == 0
    rows[~solved] = np.nan
    return rows[:-1], solved[:-1]


@compiled
def _of_fluid(drive: Drive, fluid: Fluid, bench_flow: float, kelvin: Array, case: Array) -> Array:
    """Of each window's fluid, shape (4, n): viscosity in the drain's law [-]; warming by throttling [K/Pa] at ``kelvin``;
    fall of the viscosity's logarithm per K at ``case``; viscosity at 50 degC over that at ``kelvin``.
    """
    found, nu_50 = np.empty((4, len(kelvin))), kinematic_viscosity(fluid, 50.0 + KELVIN_AT_0_DEGC)
    for i in range(len(kelvin)):
        found[0, i] = drain_viscosity_ratio(drive, fluid, bench_flow, case[i])
        found[1, i] = throttling_heating(fluid, kelvin[i], 1.0, 0.0)
        colder, warmer = kinematic_viscosity(fluid, case[i] - 0.5), kinematic_viscosity(fluid, case[i] + 0.5)
        found[2, i] = math.log(colder / warmer)
        found[3, i] = nu_50 / kinematic_viscosity(fluid, kelvin[i])
    return found


def _solved_apart(pump: Pump, inputs: Array, circuit: Circuit) -> OperatingPoints:
    """Operating points with derivatives, each from a cold start: a window's anchor may not depend on its neighbours."""
    n = len(inputs)
    values, slopes = np.empty((n, len(OUTPUTS))), np.full((n, len(OUTPUTS), len(INPUTS)), np.nan)
    status = np.zeros(n, dtype=np.int64)
    _solve_each(pump, slipper_model(pump), circuit, inputs, np.zeros(n), values, _NEEDED, slopes, status)
    return OperatingPoints(inputs, values, slopes, status)


@compiled
def _solve_each(
    pump: Pump,
    model: SlipperMap,
    circuit: Circuit,
    rows: Array,
    k_d: Array,
    values: Array,
    by: NDArray[np.int64],
    slopes: Array,
    status: NDArray[np.int64],
) -> None:
    for i in range(len(rows)):
        row = slice(i, i + 1)
        solve_batch(pump, model, circuit, rows[row], k_d[row], values[row], by, slopes[row], status[row])
