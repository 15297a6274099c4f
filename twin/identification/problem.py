"""What is fitted to what: measured points, free parameters, and normalised residuals with their sensitivities."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.condition import OUTPUTS, Condition, Health, input_rows
from twin.identification.priors import CIRCUIT_PARTS, Prior, prior_of
from twin.operating_point import operating_points, problem
from twin.parameters import Circuit, Pump, PumpType, Quantity

MEASURED: tuple[str, ...] = ("discharge_pressure_bar", "case_pressure_bar", "case_flow_lpm", "shaft_torque_nm")
"""Outputs that a test bench measures."""
DEFAULT_PARAMETERS: tuple[str, ...] = (
    "slipper.h",
    "piston.b",
    "port_plate.h",
    "compensator.d_bleed",
    "compensator.F_preload",
    "compensator.k_spool",
    "drive.torque_viscous_ref",
    "drive.torque_pressure",
    "circuit.k_c",
    "circuit.w_nu",
    "circuit.w_Q",
)
"""Gaps, bleed, setting, droop, friction of the pump; resistance and law of the drain."""
_STEP = 1.0e-3
"""Of the spread: the solver is smooth and converges to 1e-10, so that central differences keep six digits."""
_FARTHEST = 6.0
"""Spreads that a number may move: farther off nothing is known to be a pump."""
_WEIGHTS = (-0.5, 1.5)
"""Weights of the drain law stay between these."""
_UNSOLVED = 1.0e3
"""Normalised residual of a point without a solution: worse than any that has one."""


class Measurement(NamedTuple):
    """A measured value with its standard deviation, in the unit of the output's name."""

    value: float
    standard_deviation: float


@dataclass(frozen=True, slots=True)
class Point:
    """One steady point of a test: where the pump ran, and what was measured, by names of ``MEASURED``."""

    condition: Condition
    measured: Mapping[str, Measurement]


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number to find [SI]: it starts from the set's value and moves in steps of its prior's spread.

    ``low`` and ``high`` bound its offset, in spreads.
    """

    path: str
    unit: str
    start: float
    prior: Prior
    low: float
    high: float
    per_unit: float

    def value(self, offset: float) -> float:
        """The number so many spreads from its start."""
        if self.prior.is_ratio:
            return self.start * math.exp(offset * self.prior.spread)
        return self.start + offset * self.prior.spread * self.per_unit

    def slope(self, offset: float) -> float:
        """d(value)/d(offset)."""
        return self.prior.spread * (abs(self.value(offset)) if self.prior.is_ratio else self.per_unit)


@dataclass(frozen=True, slots=True)
class Problem:
    """Points and free parameters of one pump in one circuit.

    ``offsets`` of the methods are changes from the start in units of the spreads, shape (len(parameters),).
    """

    kind: PumpType
    circuit: Circuit
    points: Sequence[Point]
    parameters: tuple[Parameter, ...]
    rows: NDArray[np.float64] = field(init=False)
    places: tuple[tuple[int, str], ...] = field(init=False)

    def __post_init__(self) -> None:
        rows = input_rows([p.condition for p in self.points], [Health()] * len(self.points))
        object.__setattr__(self, "rows", rows)
        object.__setattr__(self, "places", tuple((i, n) for i, p in enumerate(self.points) for n in p.measured))

    def values(self, offsets: NDArray[np.float64]) -> NDArray[np.float64]:
        """Parameters [SI], shape (len(parameters),)."""
        return np.array([p.value(float(offset)) for p, offset in zip(self.parameters, offsets, strict=True)])

    def predicted(self, offsets: NDArray[np.float64]) -> NDArray[np.float64]:
        """The twin's value of every measurement in the order of ``places``; NaN without a solution."""
        pump, circuit = self._changed(self.values(offsets))
        points = operating_points(pump, self.rows, circuit)
        columns = {name: points.values[:, OUTPUTS.index(name)] for name in MEASURED}
        return np.array([columns[name][i] for i, name in self.places])

    def residuals(self, offsets: NDArray[np.float64]) -> NDArray[np.float64]:
        """(Measured - twin) / standard deviation of every measurement."""
        measured = [self.points[i].measured[name] for i, name in self.places]
        values = np.array([m.value for m in measured])
        found: NDArray[np.float64] = (values - self.predicted(offsets)) / np.array(
            [m.standard_deviation for m in measured]
        )
        return np.nan_to_num(found, nan=_UNSOLVED, posinf=_UNSOLVED, neginf=-_UNSOLVED)

    def jacobian(self, offsets: NDArray[np.float64]) -> NDArray[np.float64]:
        """d(residual)/d(offset), shape (len(places), len(parameters)), by central differences."""
        columns = np.empty((len(self.places), len(self.parameters)))
        for k in range(len(self.parameters)):
            step = np.zeros(len(self.parameters))
            step[k] = _STEP
            columns[:, k] = (self.residuals(offsets + step) - self.residuals(offsets - step)) / (2.0 * _STEP)
        return columns

    def unsolved(self) -> list[str]:
        """Points that the starting parameters cannot reach, in words."""
        found = operating_points(self.kind.pump, self.rows, self.circuit)
        faults = [(i, problem(found, i)) for i in range(len(self.points))]
        return [f"point {i + 1}: {fault}" for i, fault in faults if fault is not None]

    def _changed(self, values: NDArray[np.float64]) -> tuple[Pump, Circuit]:
        pump, circuit = self.kind.pump, self.circuit
        for parameter, value in zip(self.parameters, values, strict=True):
            part, _, name = parameter.path.partition(".")
            if part == CIRCUIT_PARTS:
                circuit = circuit._replace(**{name: float(value)})
            else:
                block: Any = getattr(pump, part)
                pump = pump._replace(**{part: block._replace(**{name: float(value)})})
        return pump, circuit


def parameter_of(kind: PumpType, circuit: Mapping[str, Quantity], path: str) -> Parameter:
    """A free parameter with its prior.

    Raises
    ------
    KeyError
        when the set and the circuit have no such number.
    """
    part, _, name = path.partition(".")
    quantity = circuit[name] if part == CIRCUIT_PARTS else kind.quantities[path]
    prior = prior_of(kind, quantity, path)
    per_unit = Quantity(1.0, quantity.unit, "").si
    if prior.is_ratio:
        return Parameter(path, quantity.unit, quantity.si, prior, -_FARTHEST, _FARTHEST, per_unit)
    low, high = ((bound - quantity.value) / prior.spread for bound in _WEIGHTS)
    return Parameter(path, quantity.unit, quantity.si, prior, low, high, per_unit)
