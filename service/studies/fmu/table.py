"""The operating point as a table: values and slopes on a grid, for a model that has no solver."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.condition import INPUTS, OUTPUTS, Condition, Health, input_rows
from twin.operating_point import operating_points
from twin.operating_point.validity import TEMPERATURES_DEGC, geometric_delivery
from twin.parameters import PumpType
from twin.pumps.circuit_sets import CircuitSet
from twin.units import STANDARD_ATMOSPHERE_BAR

SPEEDS = (0.4, 0.55, 0.7, 0.85, 1.0, 1.2)
"""Of the nominal speed."""
N_TEMPERATURES = 9
SHARES = (0.0, 0.03, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.88, 0.93, 0.96, 1.02)
"""Discharge flow over the swept volume times speed; the last is more than a pump delivers."""
LEAKAGES = (0.5, 1.0, 1.5, 2.5, 4.0)
LINEAR: tuple[str, ...] = (
    "reservoir_pressure_bar",
    "system_leakage_lpm",
    "pressure_setting_change_bar",
    "drain_resistance_scale",
)
"""Inputs that enter by their slope at the grid's nodes."""


@dataclass(frozen=True, slots=True)
class Table:
    """Values and slopes of every output at every node.

    Attributes
    ----------
    axes
        Speed [rpm], temperature [degC], flow share [-], leakage scale [-].
    values
        Shape (speeds, temperatures, shares, leakages, len(OUTPUTS), 1 + len(LINEAR)): the output, then its slopes; NaN where
        there is no steady state.
    origin
        Where the slopes count from, in the order of ``LINEAR``.
    delivery_lpm_per_rpm
        Swept volume: flow share times speed times this is the flow.
    """

    axes: tuple[NDArray[np.float64], ...]
    values: NDArray[np.float64]
    origin: tuple[float, ...]
    delivery_lpm_per_rpm: float


def table_of(kind: PumpType, circuit: CircuitSet) -> Table:
    """Solve the grid: some 3800 operating points with derivatives, a quarter of a second."""
    axes = (
        kind.nominal_speed_rpm * np.array(SPEEDS),
        np.linspace(*TEMPERATURES_DEGC, N_TEMPERATURES),
        np.array(SHARES),
        np.array(LEAKAGES),
    )
    swept = geometric_delivery(kind.pump, 1.0)
    reservoir = kind.nominal_reservoir_pressure_bar
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
    conditions = [
        Condition(n, T, reservoir, share * n * swept, STANDARD_ATMOSPHERE_BAR) for n, T, share, _ in grid.tolist()
    ]
    healths = [Health(pump_leakage_scale=scale, system_leakage_lpm=circuit.leak_lpm) for scale in grid[:, 3].tolist()]
    points = operating_points(kind.pump, input_rows(conditions, healths), circuit.circuit, derivatives=True)
    if points.derivatives is None or (points.status != 0).all():
        raise ValueError(f"{kind.name} has no steady state in this circuit: there is nothing to tabulate")
    slopes = points.derivatives[:, :, [INPUTS.index(name) for name in LINEAR]]
    values = np.concatenate([points.values[:, :, None], slopes], axis=2)
    shape = (*(len(axis) for axis in axes), len(OUTPUTS), 1 + len(LINEAR))
    return Table(axes, values.reshape(shape), (reservoir, 0.0, 0.0, 1.0), swept)
