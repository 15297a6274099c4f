"""What an identification found: estimates with intervals, what the points leave open, residuals, remarks."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.parameters import PumpType, Quantity
from twin.pumps.written import pump_type_from

POOR_FIT = 0.01
PRIOR_DECIDES = 0.5
"""Share of the prior's variance that is left: above it the prior says more than the points."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """One number found, in ``unit``; ``low`` and ``high`` bound 90 %.

    ``prior`` is the one-sigma spread known beforehand, a ratio or in ``unit`` (``prior_is_ratio``), ``prior_source``
    where it comes from; ``prior_share`` how much of its variance is left: near 0 the points decide, near 1 the prior.
    """

    path: str
    unit: str
    start: float
    value: float
    standard_deviation: float
    low: float
    high: float
    at_bound: bool
    prior: float
    prior_is_ratio: bool
    prior_source: str
    prior_share: float

    @property
    def decided_by(self) -> str:
        """``points`` or ``prior``: whose information is the larger part."""
        return "prior" if self.prior_share > PRIOR_DECIDES else "points"


@dataclass(frozen=True, slots=True)
class Undetermined:
    """A number that the prior decides, because the points cannot tell it. ``beside``: what it cannot be told from."""

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
        Of the estimates in their units and [-], shape (n, n).
    chi_square, degrees_of_freedom, p_value
        Of the residuals and of the offsets from the prior together, which at the most probable numbers has as many
        degrees of freedom as there are measurements.
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

    @property
    def is_misfit(self) -> bool:
        """True where no pump of this type explains the points: p below 0.01."""
        return self.p_value < POOR_FIT

    def changes(self, source: str) -> dict[str, Quantity]:
        """Identified numbers of the pump, those of the circuit left out, by path; none where the prior decides all.

        What the prior decides is among them and says so in its source: the numbers fit the points together.
        """
        own = [e for e in self.estimates if not e.path.startswith("circuit.")]
        if all(e.decided_by == "prior" for e in own):
            return {}
        words = {"points": source, "prior": f"{source}; decided by the prior, not by the points"}
        return {e.path: Quantity(e.value, e.unit, words[e.decided_by], _relative(e)) for e in own}

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
