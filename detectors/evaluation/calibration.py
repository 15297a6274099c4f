"""Whether stated probabilities happen: reliability tables of the six probabilities, per record after the onset."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from detectors.evaluation.scoring import Seen
from detectors.scores import Score
from detectors.verdict import FAULTS, State

Array = NDArray[np.float64]
N_BINS = 10
NAMES: tuple[State, ...] = (State.HEALTHY, *FAULTS)
_N_DRAWS = 500


@dataclass(frozen=True)
class Reliability:
    """Times that a probability was stated, sum of what was stated, times that it happened; by pump and bin.

    Arrays of shape (n_pumps, N_BINS); the bins are equally wide.
    """

    counted: Array
    stated: Array
    happened: Array

    @property
    def shares(self) -> tuple[Array, Array, Array]:
        """Share of all statements, sum stated and sum happened in each bin, over the total; each (N_BINS,)."""
        n = max(float(self.counted.sum()), 1.0)
        return self.counted.sum(axis=0) / n, self.stated.sum(axis=0) / n, self.happened.sum(axis=0) / n


@dataclass(frozen=True)
class Calibration:
    """Two readings of the same probabilities.

    ``confidence`` asks of the largest one of each record whether it was right; ``each`` asks all six one by one, which
    is the milder question: the many small ones are easily right.
    """

    confidence: Reliability
    each: Reliability


def calibration(found: Seen) -> Calibration:
    """Tables of a row in which one answer is right."""
    pump = np.nonzero(found.after)[0]
    stated = found.outcome.probabilities[found.after]
    right = np.zeros(stated.shape)
    right[:, NAMES.index(found.row.truth)] = 1.0
    records = np.arange(len(stated))
    largest = stated.argmax(axis=1)
    n = len(found.last)
    return Calibration(
        _table(pump, stated[records, largest], right[records, largest], n),
        _table(np.repeat(pump, stated.shape[1]), stated.ravel(), right.ravel(), n),
    )


def mean_shares(tables: Sequence[Reliability]) -> tuple[Array, Array, Array]:
    """As ``Reliability.shares``, of several rows with the same weight for each row however many records it has.

    Raises
    ------
    ValueError
        Without a table.
    """
    if not tables:
        raise ValueError("reliability tables are missing; at least one is needed")
    parts = np.mean([t.shares for t in tables], axis=0)
    return parts[0], parts[1], parts[2]


def calibration_error(tables: Sequence[Reliability], seed: int, confidence: float = 0.95) -> Score:
    """Expected calibration error: mean gap between stated and observed share (Naeini 2015), rows weighted alike.

    The interval resamples pumps within each row.
    """
    _, stated, happened = mean_shares(tables)
    rng = np.random.default_rng(seed)
    draws = np.zeros((_N_DRAWS, N_BINS))
    for table in tables:
        gap, counted = table.stated - table.happened, table.counted.sum(axis=1)
        for k in range(_N_DRAWS):
            drawn = rng.integers(0, len(gap), len(gap))
            draws[k] += gap[drawn].sum(axis=0) / max(float(counted[drawn].sum()), 1.0)
    errors = np.abs(draws / len(tables)).sum(axis=1)
    low, high = np.quantile(errors, (0.5 - 0.5 * confidence, 0.5 + 0.5 * confidence))
    return Score(float(np.abs(stated - happened).sum()), float(low), float(high))


def _table(pump: NDArray[np.int64], stated: Array, happened: Array, n_pumps: int) -> Reliability:
    index = pump * N_BINS + np.clip((stated * N_BINS).astype(np.int64), 0, N_BINS - 1)
    size = n_pumps * N_BINS

    def summed(weights: Array) -> Array:
        return np.asarray(np.bincount(index, weights, minlength=size).reshape(n_pumps, N_BINS), dtype=np.float64)

    return Reliability(summed(np.ones(len(stated))), summed(stated), summed(happened))
