"""Any log evidence as a chart: Page's cumulated log likelihood ratio, and a level that is already cumulated."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from benchmarks.charts.contract import Sequence


@dataclass(frozen=True, slots=True)
class EvidenceChart:
    """Fed with the log predictive ratio of fault over healthy for each record; the statistic is in nat.

    ``W = max(W, 0) + l`` (Page 1954). For independent records and a true ratio ARL0 is at least ``exp(threshold)``;
    `evidence_threshold` uses this bound, `calibrated_threshold` the evidence's own healthy sequences.
    """

    threshold: float

    def start(self, shape: tuple[int, ...] = ()) -> Sequence:
        """No evidence."""
        return np.zeros(shape)

    def update(self, state: Sequence, x: ArrayLike) -> tuple[Sequence, Sequence]:
        """Add the evidence of one record of each sequence."""
        value = np.asarray(x, dtype=np.float64)
        total = np.where(np.isnan(value), state, np.maximum(state, 0.0) + value)
        return total, total


@dataclass(frozen=True, slots=True)
class LevelChart:
    """Fed with evidence that is already cumulated, as a state's log odds; alarms when the last ``n_records`` exceed.

    The statistic is the smallest of the last ``n_records`` values [nat]; before that many there is none (minus
    infinity). Its ARL0 comes from `calibrated_threshold` on healthy sequences: no bound holds for a level as such.
    """

    threshold: float
    n_records: int = 1

    def __post_init__(self) -> None:
        if self.n_records < 1:
            raise ValueError(f"n_records is {self.n_records}; it must be at least 1")

    def start(self, shape: tuple[int, ...] = ()) -> Sequence:
        """No value yet; shape (*shape, n_records)."""
        return np.full((*shape, self.n_records), -np.inf)

    def update(self, state: Sequence, x: ArrayLike) -> tuple[Sequence, Sequence]:
        """Take the newest level of each sequence."""
        value = np.asarray(x, dtype=np.float64)
        moved = np.concatenate([state[..., 1:], np.broadcast_to(value, state.shape[:-1])[..., None]], axis=-1)
        kept = np.where(np.isnan(value)[..., None], state, moved)
        return kept, kept.min(axis=-1)
