"""Bring any channel to a chart: mean and spread taken off, a known autocorrelation whitened."""

from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.charts.contract import Chart, Sequence

S = TypeVar("S")


@dataclass(frozen=True, slots=True)
class StandardisedState(Generic[S]):
    """Inner chart's state, the last known standardised value (NaN before the first), records since then."""

    inner: S
    last: Sequence
    age: Sequence


@dataclass(frozen=True, slots=True)
class Standardised(Generic[S]):
    """A chart fed with ``(x - mean) / standard_deviation``, whitened by the AR(1) coefficient ``autocorrelation``.

    After ``j`` records the healthy value keeps ``autocorrelation**j`` of the last one; what is new, over its own
    spread, goes to the inner chart, so that its ARL0 holds, also across missing values. A shift of one standard
    deviation reaches the inner chart as ``sqrt((1 - a) / (1 + a))`` of one: correlated records tell less.
    """

    chart: Chart[S]
    mean: float
    standard_deviation: float
    autocorrelation: float = 0.0

    def __post_init__(self) -> None:
        faults = []
        if not np.isfinite(self.mean):
            faults.append("mean is not a number")
        if not (np.isfinite(self.standard_deviation) and self.standard_deviation > 0.0):
            faults.append(f"standard_deviation is {self.standard_deviation:g}; it must be finite and above 0")
        if not -1.0 < self.autocorrelation < 1.0:
            faults.append(f"autocorrelation is {self.autocorrelation:g}; it must lie between -1 and 1")
        if faults:
            raise ValueError("; ".join(faults))

    @property
    def threshold(self) -> float:
        """The inner chart's."""
        return self.chart.threshold

    def start(self, shape: tuple[int, ...] = ()) -> StandardisedState[S]:
        """Nothing known yet."""
        return StandardisedState(self.chart.start(shape), np.full(shape, np.nan), np.ones(shape))

    def update(self, state: StandardisedState[S], x: ArrayLike) -> tuple[StandardisedState[S], Sequence]:
        """Standardise, whiten, update the inner chart."""
        z = (np.asarray(x, dtype=np.float64) - self.mean) / self.standard_deviation
        kept = np.where(np.isnan(state.last), 0.0, self.autocorrelation**state.age)
        innovation = (z - kept * np.nan_to_num(state.last)) / np.sqrt(1.0 - kept**2)
        inner, statistic = self.chart.update(state.inner, innovation)
        missing = np.isnan(z)
        last = np.where(missing, state.last, z)
        age = np.where(missing, state.age + 1.0, 1.0)
        return StandardisedState(inner, last, age), statistic
