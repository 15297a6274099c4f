"""Whether stated probabilities happen: reliability tables of the six probabilities, per record after the onset."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from detectors.evaluation.scoring import Seen, Truths
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
    """Three readings of the same probabilities.

    ``confidence`` asks of the largest one of each record whether it was right; ``each`` asks all six one by one, which
    is the milder question: the many small ones are easily right. Both count a fault from its onset on, when nothing
    can be seen of it yet; ``alarmed`` asks as ``confidence`` does, but only while there is an alarm.
    """

    confidence: Reliability
    each: Reliability
    alarmed: Reliability


def calibration(found: Seen) -> Calibration:
    """Tables of a row in which one answer is right."""
    return Calibration(
        _largest(found, found.after), _each(found, found.after), _largest(found, found.after & found.alarmed)
    )


def mean_shares(tables: Sequence[Reliability]) -> tuple[Array, Array, Array]:
    """As ``Reliability.shares``, of several rows with the same weight for each row however many records it has.

    Rows that state nothing have no weight; all shares are 0 if none does.
    """
    filled = [t.shares for t in tables if t.counted.any()]
    parts = np.mean(filled, axis=0) if filled else np.zeros((3, N_BINS))
    return parts[0], parts[1], parts[2]


def calibration_error(tables: Sequence[Reliability], seed: int, confidence: float = 0.95) -> Score:
    """Expected calibration error: mean gap between stated and observed share (Naeini 2015), rows weighted alike.

    The interval resamples pumps within each row. NaN where nothing was stated.
    """
    tables = [t for t in tables if t.counted.any()]
    if not tables:
        return Score(math.nan, math.nan, math.nan)
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


def _largest(found: Seen, among: Truths) -> Reliability:
    pump, stated, right = _stated(found, among)
    records, largest = np.arange(len(stated)), stated.argmax(axis=1)
    return _table(pump, stated[records, largest], right[records, largest], len(found.last))


def _each(found: Seen, among: Truths) -> Reliability:
    pump, stated, right = _stated(found, among)
    return _table(np.repeat(pump, stated.shape[1]), stated.ravel(), right.ravel(), len(found.last))


def _stated(found: Seen, among: Truths) -> tuple[NDArray[np.int64], Array, Array]:
    """Pump, six probabilities and six truths of each record."""
    stated = found.outcome.probabilities[among]
    right = np.zeros(stated.shape)
    right[:, NAMES.index(found.row.truth)] = 1.0
    return np.nonzero(among)[0], stated, right


def _table(pump: NDArray[np.int64], stated: Array, happened: Array, n_pumps: int) -> Reliability:
    index = pump * N_BINS + np.clip((stated * N_BINS).astype(np.int64), 0, N_BINS - 1)
    size = n_pumps * N_BINS

    def summed(weights: Array) -> Array:
        return np.asarray(np.bincount(index, weights, minlength=size).reshape(n_pumps, N_BINS), dtype=np.float64)

    return Reliability(summed(np.ones(len(stated))), summed(stated), summed(happened))
