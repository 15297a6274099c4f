"""Ground runs at constant flow: what the pump shows under load, in a world that differs from the judge's own.

The helicopter is tied down and its controls make one steady demand after the other (thesis, section 4.4.1).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from detectors.evaluation.reality import Flights, drawn_by_aircraft, viscosity_ratio
from detectors.expectation.components import LOAD_LPM
from detectors.words.observation import Mean, Window, WindowKind
from twin.condition import INPUTS
from twin.operating_point import operating_points
from twin.parameters import PumpType

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class GroundRuns:
    """Every so many flights, the first included, one window at each flow follows the zero-flow window [L/min]."""

    every: int
    flows_lpm: tuple[float, ...] = (10.0, 20.0)


def pressures_under_load(
    runs: GroundRuns, flights: Flights, pump: PumpType, rng: np.random.Generator, moved_at: int | None
) -> tuple[Array, Array]:
    """True discharge and case pressure of every flight's run at each flow [bar], shapes (n_pumps, n_flights, n_flows)."""
    n_pumps, n_flights = shape = flights.discharge.shape

    def by_aircraft(sd: float, mean: float = 0.0) -> Array:
        return drawn_by_aircraft(lambda: rng.normal(mean, sd, (n_pumps, 1)), n_flights, moved_at)

    thin = viscosity_ratio(pump, flights.temperature, np.ones(shape))
    drop = np.exp(by_aircraft(0.15)) * thin ** by_aircraft(0.12, 0.1)
    made, missed, bent = 1.0 + by_aircraft(0.02), rng.normal(0.0, 0.2, (n_pumps, 1)), rng.normal(0.0, 0.2, (n_pumps, 1))
    discharge, case = np.empty((*shape, len(runs.flows_lpm))), np.empty((*shape, len(runs.flows_lpm)))
    for k, flow in enumerate(runs.flows_lpm):
        rows = flights.rows.copy()
        rows[..., INPUTS.index("discharge_flow_lpm")] = made * flow + rng.normal(0.0, 0.25, shape)
        points = operating_points(pump.pump, rows.reshape(-1, len(INPUTS)), flights.circuit)
        more = (points.value("return_pressure_bar").reshape(shape) - flights.reservoir) * (drop - 1.0)
        load = flow / LOAD_LPM
        case[..., k] = points.value("case_pressure_bar").reshape(shape) + more
        discharge[..., k] = points.value("discharge_pressure_bar").reshape(shape) + more + load * (missed + load * bent)
    return discharge, case


def loaded_windows(
    zero_flow: Window, flows_lpm: Sequence[float], discharge: Sequence[float], case: Sequence[float]
) -> tuple[Window, ...]:
    """Windows at constant flow as a record would hold them; condition and errors are those of its zero-flow window."""
    windows = []
    for k, (flow, p_d, p_c) in enumerate(zip(flows_lpm, discharge, case, strict=True)):
        means = dict(zero_flow.means)
        means["discharge_pressure_bar"] = Mean(float(p_d), means["discharge_pressure_bar"].standard_error)
        means["case_pressure_bar"] = Mean(float(p_c), means["case_pressure_bar"].standard_error)
        means["commanded_flow_lpm"] = Mean(flow, 0.0)
        start = zero_flow.end_s + 20.0 + 80.0 * k
        windows.append(Window(WindowKind.CONSTANT_FLOW, start, start + 60.0, True, None, means, None))
    return tuple(windows)
