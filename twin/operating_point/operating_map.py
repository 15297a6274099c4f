"""Operating map: one pump over a grid of speeds and flows, for notebooks and pictures."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.condition import OUTPUTS, Condition, Health, input_rows
from twin.operating_point.points import operating_points
from twin.operating_point.validity import outside
from twin.parameters import Circuit, PumpType


@dataclass(frozen=True, slots=True)
class OperatingMap:
    """Steady states over speed and discharge flow.

    Attributes
    ----------
    speed_rpm, discharge_flow_lpm
        Axes, shape (n,) and (m,).
    outputs
        By name of ``twin.condition.OUTPUTS``, shape (n, m); NaN where there is no steady state.
    outside
        True where something lies outside what the pump type was held against, shape (n, m).
    """

    speed_rpm: NDArray[np.float64]
    discharge_flow_lpm: NDArray[np.float64]
    outputs: dict[str, NDArray[np.float64]]
    outside: NDArray[np.bool_]

    def __getitem__(self, output: str) -> NDArray[np.float64]:
        """One output over the map, shape (n, m)."""
        return self.outputs[output]


def operating_map(
    kind: PumpType,
    circuit: Circuit,
    speed_rpm: Sequence[float] | NDArray[np.float64],
    discharge_flow_lpm: Sequence[float] | NDArray[np.float64],
    *,
    fluid_temperature_degc: float = 50.0,
    reservoir_pressure_bar: float = 0.0,
    health: Health = Health(),  # noqa: B008 - immutable
) -> OperatingMap:
    """Steady states of a pump type over speeds [rpm] and flows [L/min], at one temperature and health.

    Raises
    ------
    ValueError
        when an axis is empty.
    """
    speeds, flows = (np.asarray(axis, dtype=np.float64).ravel() for axis in (speed_rpm, discharge_flow_lpm))
    if not len(speeds) or not len(flows):
        raise ValueError("a map needs at least one speed and one flow")
    conditions = [Condition(n, fluid_temperature_degc, reservoir_pressure_bar, q) for n in speeds for q in flows]
    points = operating_points(kind.pump, input_rows(conditions, [health] * len(conditions)), circuit)
    shape = (len(speeds), len(flows))
    beyond = np.array([bool(names) for names in outside(kind, points)]).reshape(shape)
    outputs = {name: points.value(name).reshape(shape) for name in OUTPUTS}
    return OperatingMap(speeds, flows, outputs, beyond)
