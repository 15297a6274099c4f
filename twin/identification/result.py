"""What an identification found: estimates with intervals, what the points leave open, residuals, remarks."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.parameters import PumpType, Quantity
from twin.pumps.written import pump_type_from


@dataclass(frozen=True, slots=True)
class Estimate:
    """One number found, in ``unit``; ``low`` and ``high`` bound 90 %."""

    path: str
    unit: str
    start: float
    value: float
    standard_deviation: float
    low: float
    high: float
    at_bound: bool


@dataclass(frozen=True, slots=True)
class Undetermined:
    """A number that the points cannot tell: it stays at its start. ``beside``: what it cannot be told from."""

    path: str
    beside: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class PointResidual:
    """One measurement beside the twin, in the unit of the output; ``normalised`` is per standard deviation."""

    point: int
    output: str
    measured: float
    twin: float
    residual: float
    normalised: float


@dataclass(frozen=True, slots=True)
class Identification:
    """Estimates of one pump type.

    Attributes
    ----------
    covariance, correlation
        Of the estimates in their units and [-], shape (n, n); what is undetermined adds its stated spread.
    chi_square, degrees_of_freedom, p_value
        Of the residuals; a p-value below 0.01 says that the twin or the standard deviations do not fit the points,
        and the share of the noise in the covariance is widened by chi-square per degree of freedom.
    """

    kind: PumpType
    circuit: str
    estimates: tuple[Estimate, ...]
    undetermined: tuple[Undetermined, ...]
    covariance: NDArray[np.float64]
    correlation: NDArray[np.float64]
    residuals: tuple[PointResidual, ...]
    chi_square: float
    degrees_of_freedom: int
    p_value: float
    warnings: tuple[str, ...]

    def changes(self, source: str) -> dict[str, Quantity]:
        """Identified numbers of the pump, those of the circuit left out, by path."""
        return {
            e.path: Quantity(e.value, e.unit, source, _relative(e))
            for e in self.estimates
            if not e.path.startswith("circuit.")
        }

    def document(self, name: str, source: str) -> dict[str, object]:
        """Derived parameter set in the shape of ``twin.pumps.written``; raises ``ParameterFaultsError`` if it is none.

        A set that was itself derived and is no built-in one is named as base all the same.
        """
        changes = {path: _plain(q) for path, q in self.changes(source).items()}
        title = f"{self.kind.title}, {source}"
        document: dict[str, object] = {"id": name, "base": self.kind.name, "title": title, "changes": changes}
        pump_type_from(document, {self.kind.name: self.kind})
        return document


def _relative(estimate: Estimate) -> float | None:
    return abs(estimate.standard_deviation / estimate.value) if estimate.value else None


def _plain(quantity: Quantity) -> Mapping[str, object]:
    plain: dict[str, object] = {"value": quantity.value, "unit": quantity.unit, "source": quantity.source}
    return plain if quantity.uncertainty is None else plain | {"uncertainty": quantity.uncertainty}
