"""What the twin is asked and what it answers: condition, health, operating points.

Everything here is in edge units (bar gauge, L/min, rpm, degC, deg, N m) and named with them.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.units import STANDARD_ATMOSPHERE_BAR


class Condition(NamedTuple):
    """Where the pump runs: what the circuit and the aircraft impose on it."""

    speed_rpm: float
    fluid_temperature_degc: float
    reservoir_pressure_bar: float = 0.0
    discharge_flow_lpm: float = 0.0
    ambient_pressure_bar: float = STANDARD_ATMOSPHERE_BAR


class Health(NamedTuple):
    """What wear and faults change; the default is the healthy pump of the parameter set.

    ``pump_leakage_scale`` multiplies every internal leakage to the case except the compensator's;
    the three scales after it multiply one path each, on top of it. ``throttled_leakage_lpm`` is added from
    discharge to case with the law of an orifice: a slipper so worn that its throttle alone holds the flow back,
    counted at a pressure difference of 175 bar, as the circuit's own leak is. ``edge_rounding_um`` is what erosion
    has added to the radius of the valve's metering edges.
    """

    pump_leakage_scale: float = 1.0
    slipper_leakage_scale: float = 1.0
    piston_leakage_scale: float = 1.0
    port_plate_leakage_scale: float = 1.0
    control_bleed_lpm: float = 0.0
    system_leakage_lpm: float = 0.0
    pressure_setting_change_bar: float = 0.0
    drain_resistance_scale: float = 1.0
    drain_viscosity_weight_change: float = 0.0
    drain_flow_weight_change: float = 0.0
    droop_scale: float = 1.0
    throttled_leakage_lpm: float = 0.0
    edge_rounding_um: float = 0.0


CONDITION_INPUTS: tuple[str, ...] = Condition._fields
HEALTH_INPUTS: tuple[str, ...] = Health._fields
INPUTS: tuple[str, ...] = CONDITION_INPUTS + HEALTH_INPUTS
"""Order of the columns that the solver takes and differentiates by."""

RANGES: dict[str, tuple[float, float]] = {
    "speed_rpm": (200.0, 8000.0),
    "fluid_temperature_degc": (-45.0, 140.0),
    "discharge_flow_lpm": (0.0, 100.0),
    "ambient_pressure_bar": (0.01, 1.5),
    "pump_leakage_scale": (0.01, 100.0),
    "slipper_leakage_scale": (0.01, 100.0),
    "piston_leakage_scale": (0.01, 100.0),
    "port_plate_leakage_scale": (0.01, 100.0),
    "control_bleed_lpm": (0.0, 20.0),
    "system_leakage_lpm": (0.0, 50.0),
    "pressure_setting_change_bar": (-100.0, 100.0),
    "drain_resistance_scale": (0.01, 100.0),
    "drain_viscosity_weight_change": (-2.0, 2.0),
    "drain_flow_weight_change": (-2.0, 2.0),
    "droop_scale": (0.0, 10.0),
    "throttled_leakage_lpm": (0.0, 20.0),
    "edge_rounding_um": (0.0, 500.0),
}
"""Values that the solver takes; the reservoir's own range is absolute."""

RESERVOIR_RANGE_BAR = (0.1, 20.0)
"""Absolute reservoir pressure that the solver takes: gauge plus ambient."""

OUTPUTS: tuple[str, ...] = (
    "discharge_pressure_bar",
    "case_pressure_bar",
    "return_pressure_bar",
    "control_pressure_bar",
    "swashplate_angle_deg",
    "discharge_flow_lpm",
    "case_flow_lpm",
    "shaft_torque_nm",
    "piston_leakage_lpm",
    "slipper_leakage_lpm",
    "port_plate_leakage_lpm",
    "compensator_leakage_lpm",
    "suction_flow_lpm",
    "case_temperature_degc",
)
"""Order of the columns that the solver answers with."""

_INPUT_INDEX = {name: i for i, name in enumerate(INPUTS)}
_OUTPUT_INDEX = {name: i for i, name in enumerate(OUTPUTS)}


@dataclass(frozen=True, slots=True)
class OperatingPoints:
    """Steady states of one pump in one circuit.

    Attributes
    ----------
    inputs
        Asked conditions and health, shape (n, len(INPUTS)).
    values
        Answers, shape (n, len(OUTPUTS)); NaN where ``status`` is not 0.
    derivatives
        d(output)/d(input), shape (n, len(OUTPUTS), len(INPUTS)), or None when not asked for.
    status
        0 where solved; else a code of ``twin.operating_point.PROBLEMS``, shape (n,).
    """

    inputs: NDArray[np.float64]
    values: NDArray[np.float64]
    derivatives: NDArray[np.float64] | None
    status: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.status)

    def value(self, output: str) -> NDArray[np.float64]:
        """Column of one output, shape (n,)."""
        return self.values[:, _OUTPUT_INDEX[output]]

    def derivative(self, output: str, by: str) -> NDArray[np.float64]:
        """Derivative of one output by one input, shape (n,), in the units of both names."""
        if self.derivatives is None:
            raise ValueError("these operating points were solved without derivatives; ask with derivatives=True")
        return self.derivatives[:, _OUTPUT_INDEX[output], _INPUT_INDEX[by]]


def input_rows(conditions: list[Condition], healths: list[Health]) -> NDArray[np.float64]:
    """Stack conditions and health states, one row each, in the order of ``INPUTS``; shape (n, len(INPUTS))."""
    return np.array([(*c, *h) for c, h in zip(conditions, healths, strict=True)], dtype=np.float64).reshape(
        len(conditions), len(INPUTS)
    )
