"""Tabular CUSUM, one- and two-sided, with its average run length by a Markov chain.

Page (1954); Brook and Evans (1972), Biometrika 59, 539; Siegmund (1985), Sequential Analysis, ch. 2;
Montgomery, Introduction to Statistical Quality Control, section 9.1.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.stats import norm

from benchmarks.charts.contract import Sequence

_STATES = 300
"""Cells of the chart's range in the Markov chain (estimate: more cells change no run length that is used)."""


class Side(StrEnum):
    """Direction of the change that is looked for."""

    UPPER = "upper"
    LOWER = "lower"
    BOTH = "both"


@dataclass(frozen=True, slots=True)
class CusumState:
    """Sums for a rise and for a fall [standard deviations]."""

    upper: Sequence
    lower: Sequence


@dataclass(frozen=True, slots=True)
class Cusum:
    """CUSUM of standardised values; the statistic is the larger sum in use [standard deviations].

    ``reference`` (k) is half the shift that is looked for, ``threshold`` (h) from `cusum_threshold`.
    """

    reference: float
    threshold: float
    side: Side = Side.BOTH

    def __post_init__(self) -> None:
        _check(self.reference, self.threshold)

    def start(self, shape: tuple[int, ...] = ()) -> CusumState:
        """Both sums at zero."""
        return CusumState(np.zeros(shape), np.zeros(shape))

    def update(self, state: CusumState, x: ArrayLike) -> tuple[CusumState, Sequence]:
        """Add one value of each sequence."""
        value = np.asarray(x, dtype=np.float64)
        missing = np.isnan(value)
        upper = np.where(missing, state.upper, np.maximum(0.0, state.upper + value - self.reference))
        lower = np.where(missing, state.lower, np.maximum(0.0, state.lower - value - self.reference))
        if self.side is Side.UPPER:
            statistic = upper
        elif self.side is Side.LOWER:
            statistic = lower
        else:
            statistic = np.maximum(upper, lower)
        return CusumState(upper, lower), statistic


def cusum_arl(reference: float, threshold: float, side: Side = Side.BOTH, shift: float = 0.0) -> float:
    """Average run length [records] from zero under a constant ``shift`` [standard deviations].

    Brook and Evans' chain over the sum's value, extrapolated in the square of the cell width. Two one-sided sums
    that cannot both be positive past the threshold combine as ``1/ARL = 1/ARL_upper + 1/ARL_lower``.

    Raises
    ------
    ValueError
        If the reference is negative or the threshold not positive.
    """
    _check(reference, threshold)
    if side is not Side.BOTH:
        return _extrapolated(reference, threshold, shift if side is Side.UPPER else -shift)
    rate = 1.0 / _extrapolated(reference, threshold, shift) + 1.0 / _extrapolated(reference, threshold, -shift)
    return 1.0 / rate


def siegmund_arl(reference: float, threshold: float, shift: float = 0.0) -> float:
    """One-sided average run length [records] by Siegmund's corrected diffusion approximation."""
    drift, barrier = shift - reference, threshold + 1.166
    if abs(drift) < 1e-6:
        return barrier**2
    exponent = 2.0 * drift * barrier
    return (math.exp(-exponent) + exponent - 1.0) / (2.0 * drift**2)


def cusum_threshold(reference: float, arl: float, side: Side = Side.BOTH) -> float:
    """Threshold with ``arl`` records between false alarms on average, independent normal values.

    Raises
    ------
    ValueError
        If ``arl`` is not above what a chart with a vanishing threshold reaches.
    """
    _check(reference, 1.0)
    lowest = cusum_arl(reference, 1e-3, side)
    if not arl > lowest:
        raise ValueError(f"arl is {arl:g}; with a reference of {reference:g} it must exceed {lowest:.3g} records")
    high = 1.0
    while cusum_arl(reference, high, side) < arl:
        high *= 1.6
    return float(brentq(lambda h: math.log(cusum_arl(reference, h, side) / arl), 1e-3, high, xtol=1e-7))


def _check(reference: float, threshold: float) -> None:
    faults = []
    if not (math.isfinite(reference) and reference >= 0.0):
        faults.append(f"reference is {reference:g}; it must be finite and at least 0")
    if not threshold > 0.0:
        faults.append(f"threshold is {threshold:g}; it must be above 0")
    if faults:
        raise ValueError("; ".join(faults))


def _extrapolated(reference: float, threshold: float, shift: float) -> float:
    coarse = _chain_arl(reference, threshold, shift, _STATES // 2)
    fine = _chain_arl(reference, threshold, shift, _STATES)
    # error ~ width^2 with width = 2 h / (2 n - 1)
    ratio = ((2 * _STATES - 1) / (2 * (_STATES // 2) - 1)) ** 2
    return (ratio * fine - coarse) / (ratio - 1.0)


def _chain_arl(reference: float, threshold: float, shift: float, n_states: int) -> float:
    """State 0 gathers everything at or below half a cell; the last cell ends at the threshold."""
    width = 2.0 * threshold / (2 * n_states - 1)
    index = np.arange(n_states)
    step = index[None, :] - index[:, None]
    centre = reference - shift
    transition = norm.cdf((step + 0.5) * width + centre) - norm.cdf((step - 0.5) * width + centre)
    transition[:, 0] = norm.cdf((0.5 - index) * width + centre)
    return float(np.linalg.solve(np.eye(n_states) - transition, np.ones(n_states))[0])
