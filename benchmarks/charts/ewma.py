"""Exponentially weighted moving average, two-sided, with its average run length by a Markov chain.

Roberts (1959); Lucas and Saccucci (1990), Technometrics 32, 1.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.stats import norm

from benchmarks.charts.contract import Sequence

_STATES = 201
"""Cells of the chart's range in the Markov chain, odd so that one is centred (estimate: more change no run length that is used)."""


@dataclass(frozen=True, slots=True)
class Ewma:
    """EWMA of standardised values; the statistic is its size in its own long-run standard deviations.

    ``weight`` (lambda) of the newest value; ``threshold`` (L) from `ewma_threshold`.
    """

    weight: float
    threshold: float

    def __post_init__(self) -> None:
        _check(self.weight, self.threshold)

    def start(self, shape: tuple[int, ...] = ()) -> Sequence:
        """Average at zero."""
        return np.zeros(shape)

    def update(self, state: Sequence, x: ArrayLike) -> tuple[Sequence, Sequence]:
        """Average in one value of each sequence."""
        value = np.asarray(x, dtype=np.float64)
        average = np.where(np.isnan(value), state, (1.0 - self.weight) * state + self.weight * value)
        return average, np.abs(average) / _long_run_sd(self.weight)


def ewma_arl(weight: float, threshold: float, shift: float = 0.0) -> float:
    """Average run length [records] from zero under a constant ``shift`` [standard deviations].

    Lucas and Saccucci's chain over the average's value, extrapolated in the square of the cell width.

    Raises
    ------
    ValueError
        If the weight is outside (0, 1] or the threshold is not positive.
    """
    _check(weight, threshold)
    n_coarse = 2 * (_STATES // 4) + 1
    coarse, fine = (_chain_arl(weight, threshold, shift, n) for n in (n_coarse, _STATES))
    ratio = (_STATES / n_coarse) ** 2
    return (ratio * fine - coarse) / (ratio - 1.0)


def ewma_threshold(weight: float, arl: float) -> float:
    """Threshold with ``arl`` records between false alarms on average, independent normal values.

    Raises
    ------
    ValueError
        If ``arl`` is not above what a chart with a vanishing threshold reaches.
    """
    _check(weight, 1.0)
    lowest = ewma_arl(weight, 0.05)
    if not arl > lowest:
        raise ValueError(f"arl is {arl:g}; with a weight of {weight:g} it must exceed {lowest:.3g} records")
    high = 2.0
    while ewma_arl(weight, high) < arl:
        high += 0.5
    return float(brentq(lambda limit: math.log(ewma_arl(weight, limit) / arl), 0.05, high, xtol=1e-7))


def _check(weight: float, threshold: float) -> None:
    faults = []
    if not 0.0 < weight <= 1.0:
        faults.append(f"weight is {weight:g}; it must be above 0 and at most 1")
    if not threshold > 0.0:
        faults.append(f"threshold is {threshold:g}; it must be above 0")
    if faults:
        raise ValueError("; ".join(faults))


def _long_run_sd(weight: float) -> float:
    return math.sqrt(weight / (2.0 - weight))


def _chain_arl(weight: float, threshold: float, shift: float, n_states: int) -> float:
    limit = threshold * _long_run_sd(weight)
    width = 2.0 * limit / n_states
    centre = -limit + (np.arange(n_states) + 0.5) * width
    upper = (centre[None, :] + 0.5 * width - (1.0 - weight) * centre[:, None]) / weight - shift
    lower = (centre[None, :] - 0.5 * width - (1.0 - weight) * centre[:, None]) / weight - shift
    transition = norm.cdf(upper) - norm.cdf(lower)
    return float(np.linalg.solve(np.eye(n_states) - transition, np.ones(n_states))[n_states // 2])
