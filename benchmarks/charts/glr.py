"""Generalised likelihood ratio over unknown onset and size: step or ramp, within a window.

Willsky and Jones (1976); Lai and Xing (2010), Sequential Analysis 29, 162: the window costs nothing for changes that
are found within it.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.charts.contract import Sequence
from benchmarks.charts.cusum import Side


class Shape(StrEnum):
    """How a change grows after its onset."""

    STEP = "step"
    RAMP = "ramp"


@dataclass(frozen=True, slots=True)
class Glr:
    """GLR of standardised values; the statistic is the log likelihood ratio of the best change [nat].

    The best change has any onset among the last ``window`` known values, any of ``shapes`` and any size of the wanted
    ``side``. ``threshold`` from `glr_threshold` or `calibrated_threshold`.
    """

    window: int
    threshold: float
    shapes: tuple[Shape, ...] = (Shape.STEP,)
    side: Side = Side.BOTH

    def __post_init__(self) -> None:
        faults = []
        if self.window < 1:
            faults.append(f"window is {self.window}; it must be at least 1")
        if not (math.isfinite(self.threshold) and self.threshold > 0.0):
            faults.append(f"threshold is {self.threshold:g}; it must be finite and above 0")
        if not self.shapes or len(set(self.shapes)) != len(self.shapes):
            faults.append("shapes must name one shape or more, each once")
        if faults:
            raise ValueError("; ".join(faults))

    def start(self, shape: tuple[int, ...] = ()) -> Sequence:
        """No values yet: the last ``window`` values, newest first, zero where there is none; (window, *shape)."""
        return np.zeros((self.window, *shape))

    def update(self, state: Sequence, x: ArrayLike) -> tuple[Sequence, Sequence]:
        """Take one value of each sequence.

        Values before the first are zeros: they can only lower the ratio of an onset before the start.
        """
        value = np.asarray(x, dtype=np.float64)
        known = np.concatenate([np.broadcast_to(value, state.shape[1:])[None], state[:-1]])
        recent = np.where(np.isnan(value), state, known)
        return recent, self._statistic(recent)

    def _statistic(self, recent: Sequence) -> Sequence:
        n = np.arange(1.0, self.window + 1.0).reshape(-1, *([1] * (recent.ndim - 1)))
        total = np.cumsum(recent, axis=0)
        found = []
        for shape in self.shapes:
            if shape is Shape.STEP:
                match, energy = total, n
            else:
                # the newest of n values is at n, the oldest at 1: a sum of the sums up to each
                match, energy = np.cumsum(total, axis=0), n * (n + 1.0) * (2.0 * n + 1.0) / 6.0
            if self.side is Side.UPPER:
                match = np.maximum(match, 0.0)
            elif self.side is Side.LOWER:
                match = np.minimum(match, 0.0)
            found.append((match**2 / (2.0 * energy)).max(axis=0))
        best: Sequence = np.stack(found).max(axis=0)
        return best
