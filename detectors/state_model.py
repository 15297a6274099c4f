"""The state that every hypothesis carries, and the twin as its measurement model.

A state vector holds what differs between pumps, aircraft and sensors (the nuisances, all alive, none frozen) and
one fault amplitude added to the component that its hypothesis names. The fault stands inside the twin's flow,
not beside it: a big fault is not a small one times a slope.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from detectors.verdict import State
from twin.condition import INPUTS, Health
from twin.operating_point import operating_points
from twin.parameters import Circuit, PumpType

Array = NDArray[np.float64]

COMPONENTS: tuple[str, ...] = (
    "ln_leakage",
    "throttled_leakage_lpm",
    "system_orifice_lpm",
    "system_laminar_lpm",
    "setting_bar",
    "bleed_lpm",
    "ln_drain",
    "drain_viscosity_weight",
    "drain_flow_weight",
    "ln_droop",
    "case_offset_bar",
    "reservoir_bar",
)
INDEX = {name: i for i, name in enumerate(COMPONENTS)}
FAULT = len(COMPONENTS)
"""Place of the fault amplitude in the state vector."""
N_STATE = FAULT + 1
MEASUREMENTS: tuple[str, ...] = ("discharge_pressure_bar", "case_pressure_bar", "zero_bar")


@dataclass(frozen=True, slots=True)
class FaultKind:
    """One way in which something can go wrong: which component moves, how far, in which direction.

    ``scale`` is the one-sigma size of a sudden fault in the component's unit; ``floor`` the size below which it is
    not worth a word and counts as healthy; ``sign`` is +1 when the amplitude can only be positive (a leak does
    not heal), 0 when both directions occur.
    """

    name: str
    state: State
    component: str
    scale: float
    floor: float
    sign: int


FAULT_KINDS: tuple[FaultKind, ...] = (
    FaultKind("leakage, laminar", State.PUMP_DEGRADATION, "ln_leakage", 0.6, 0.06, 1),
    FaultKind("leakage, throttled", State.PUMP_DEGRADATION, "throttled_leakage_lpm", 0.5, 0.05, 1),
    FaultKind("setting", State.COMPENSATOR_FAULT, "setting_bar", 2.0, 0.8, 0),
    FaultKind("bleed", State.COMPENSATOR_FAULT, "bleed_lpm", 0.2, 0.05, 1),
    FaultKind("system leakage, orifice", State.SYSTEM_LEAKAGE, "system_orifice_lpm", 1.5, 0.3, 1),
    FaultKind("system leakage, laminar", State.SYSTEM_LEAKAGE, "system_laminar_lpm", 1.5, 0.3, 1),
    FaultKind("drain restriction", State.DRAIN_RESTRICTION, "ln_drain", 0.3, 0.06, 1),
    FaultKind("case sensor", State.SENSOR_FAULT, "case_offset_bar", 0.15, 0.06, 0),
)
"""Sizes are estimates: what is worth finding on an H225 and what the literature's rigs show."""

_WALK: dict[str, float] = {
    "ln_leakage": 0.002,
    "throttled_leakage_lpm": 0.0005,
    "system_orifice_lpm": 0.005,
    "system_laminar_lpm": 0.005,
    "setting_bar": 0.03,
    "bleed_lpm": 0.0005,
    "ln_drain": 0.002,
    "drain_viscosity_weight": 0.003,
    "drain_flow_weight": 0.003,
    "ln_droop": 0.005,
    "case_offset_bar": 0.006,
    "reservoir_bar": 0.2,
}
"""One-sigma change of each component from record to record of a healthy pump (estimates; the zero's: 0.06 bar
over some hundred flights)."""


def prior(pump: PumpType) -> tuple[Array, Array]:
    """Mean and one-sigma spread of the state of a newly installed healthy pump, shapes (N_STATE,), (N_STATE,)."""
    population = pump.population
    mean, sd = np.zeros(N_STATE), np.zeros(N_STATE)
    mean[INDEX["system_orifice_lpm"]] = 0.3  # the by-pass flow of table 2-1, at its lower end
    mean[INDEX["drain_viscosity_weight"]] = 0.2
    mean[INDEX["drain_flow_weight"]] = 0.2
    spread = {
        "ln_leakage": population["pump_leakage_scale"].value,
        "throttled_leakage_lpm": 0.02,
        "system_orifice_lpm": population["system_leakage_lpm"].value,
        "system_laminar_lpm": population["system_leakage_lpm"].value,
        "setting_bar": population["pressure_setting_bar"].value,
        "bleed_lpm": 0.02,
        "ln_drain": population["drain_resistance_scale"].value,
        "drain_viscosity_weight": population["drain_viscosity_weight"].value,
        "drain_flow_weight": population["drain_flow_weight"].value,
        "ln_droop": 0.7 * population["droop_scale"].value,
        "case_offset_bar": population["case_zero_bar"].value,
        "reservoir_bar": population["reservoir_pressure_bar"].value,
    }
    for name, value in spread.items():
        sd[INDEX[name]] = value
    return mean, sd


def walk_variance() -> Array:
    """Process noise of a healthy pump from record to record, shape (N_STATE,)."""
    variance = np.zeros(N_STATE)
    for name, sd in _WALK.items():
        variance[INDEX[name]] = sd**2
    return variance


def resolved(states: Array, component: NDArray[np.int64]) -> Array:
    """States with the fault amplitude added to the component it moves, shape (m, FAULT).

    ``component`` is -1 for the healthy hypothesis. Leakages and bleed are floored at zero where they enter.
    """
    full = states[:, :FAULT].copy()
    faulty = component >= 0
    full[faulty, component[faulty]] += states[faulty, FAULT]
    return full


def twin_rows(full: Array, condition: Array, laminar_ratio: float) -> Array:
    """Rows of twin inputs for resolved states at one condition, shape (m, len(INPUTS)).

    ``laminar_ratio`` is viscosity at 50 degC over viscosity here: what a laminar leak is multiplied with.
    """
    rows = np.tile((*condition, *Health()), (len(full), 1))

    def put(name: str, values: Array | float) -> None:
        rows[:, INPUTS.index(name)] = values

    put("pump_leakage_scale", np.exp(np.clip(full[:, INDEX["ln_leakage"]], -3.0, 4.0)))
    put("control_bleed_lpm", np.clip(full[:, INDEX["bleed_lpm"]], 0.0, 10.0))
    system = full[:, INDEX["system_orifice_lpm"]] + laminar_ratio * full[:, INDEX["system_laminar_lpm"]]
    put("system_leakage_lpm", np.clip(system, 0.0, 20.0))
    put("pressure_setting_change_bar", np.clip(full[:, INDEX["setting_bar"]], -60.0, 60.0))
    put("drain_resistance_scale", np.exp(np.clip(full[:, INDEX["ln_drain"]], -3.0, 3.0)))
    put("drain_viscosity_weight_change", np.clip(full[:, INDEX["drain_viscosity_weight"]], -0.5, 1.5))
    put("drain_flow_weight_change", np.clip(full[:, INDEX["drain_flow_weight"]], -0.5, 1.5))
    put("droop_scale", np.exp(np.clip(full[:, INDEX["ln_droop"]], -3.0, 2.0)))
    put("throttled_leakage_lpm", np.clip(full[:, INDEX["throttled_leakage_lpm"]], 0.0, 10.0))
    reservoir = INPUTS.index("reservoir_pressure_bar")
    rows[:, reservoir] += full[:, INDEX["reservoir_bar"]]
    return rows


_TWIN_INPUT = {
    "throttled_leakage_lpm": "throttled_leakage_lpm",
    "system_orifice_lpm": "system_leakage_lpm",
    "setting_bar": "pressure_setting_change_bar",
    "bleed_lpm": "control_bleed_lpm",
    "drain_viscosity_weight": "drain_viscosity_weight_change",
    "drain_flow_weight": "drain_flow_weight_change",
    "reservoir_bar": "reservoir_pressure_bar",
}
_LOGARITHMIC = {
    "ln_leakage": "pump_leakage_scale",
    "ln_drain": "drain_resistance_scale",
    "ln_droop": "droop_scale",
}


@dataclass(frozen=True, slots=True)
class Scene:
    """Where one record was taken, as the measurement model needs it.

    ``condition`` holds the condition part of a twin row, shape (5,); ``laminar_ratio`` is viscosity at 50 degC
    over viscosity here; without a reservoir sensor the reservoir's own state enters.
    """

    condition: Array
    laminar_ratio: float
    reservoir_measured: bool


def predicted(
    states: Array, component: NDArray[np.int64], scene: Scene, pump: PumpType, circuit: Circuit
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """What each state says the sensors show, and its slopes.

    Returns
    -------
    prediction
        Shape (m, 3) in the order of ``MEASUREMENTS`` [bar].
    slopes
        d(prediction)/d(state), shape (m, 3, N_STATE).
    solved
        Where the twin has a solution, shape (m,).
    """
    full = resolved(states, component)
    if scene.reservoir_measured:
        full[:, INDEX["reservoir_bar"]] = 0.0
    rows = twin_rows(full, scene.condition, scene.laminar_ratio)
    points = operating_points(pump.pump, rows, circuit, derivatives=True)
    m = len(states)
    y, slopes = np.zeros((m, 3)), np.zeros((m, 3, N_STATE))
    for k, output in enumerate(MEASUREMENTS[:2]):
        y[:, k] = points.value(output)
        for name, by in _TWIN_INPUT.items():
            slopes[:, k, INDEX[name]] = points.derivative(output, by)
        slopes[:, k, INDEX["system_laminar_lpm"]] = scene.laminar_ratio * slopes[:, k, INDEX["system_orifice_lpm"]]
        for name, by in _LOGARITHMIC.items():
            slopes[:, k, INDEX[name]] = points.derivative(output, by) * rows[:, INPUTS.index(by)]
    y[:, 1] += full[:, INDEX["case_offset_bar"]]
    y[:, 2] = full[:, INDEX["case_offset_bar"]] + full[:, INDEX["reservoir_bar"]]
    slopes[:, 1:, INDEX["case_offset_bar"]] = 1.0
    slopes[:, 2, INDEX["reservoir_bar"]] = 1.0
    if scene.reservoir_measured:
        slopes[:, :, INDEX["reservoir_bar"]] = 0.0
    faulty = component >= 0
    slopes[faulty, :, FAULT] = slopes[faulty, :, component[faulty]]
    return y, slopes, points.status == 0
