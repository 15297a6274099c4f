"""Whether stated probabilities happen: reliability tables of the six probabilities, per record after the onset."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from detectors.evaluation.scoring import Seen
from detectors.verdict import FAULTS, State

Array = NDArray[np.float64]
N_BINS = 10
NAMES: tuple[State, ...] = (State.HEALTHY, *FAULTS)


@dataclass(frozen=True)
class Reliability:
    """Records, sum of stated probabilities and number of times it happened, each of shape (N_BINS,).

    The bins are equally wide; entries are additive, so that tables of rows can be summed.
    """

    records: Array
    stated: Array
    happened: Array

    @property
    def error(self) -> float:
        """Expected calibration error: mean gap between stated and observed share (Naeini 2015); NaN when empty."""
        n = float(self.records.sum())
        return float(np.abs(self.stated - self.happened).sum() / n) if n else float("nan")


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
    stated = found.outcome.probabilities[found.after]
    right = np.zeros(stated.shape)
    right[:, NAMES.index(found.row.truth)] = 1.0
    records = np.arange(len(stated))
    largest = stated.argmax(axis=1)
    return Calibration(
        _table(stated[records, largest], right[records, largest]), _table(stated.ravel(), right.ravel())
    )


def mean_calibration(rows: Sequence[Calibration]) -> Calibration:
    """Tables of several rows, each row with the same weight however many records it has."""
    return Calibration(_mean([r.confidence for r in rows]), _mean([r.each for r in rows]))


def _mean(tables: Sequence[Reliability]) -> Reliability:
    filled = [t for t in tables if t.records.sum()]
    none = np.zeros(N_BINS)
    return Reliability(
        sum((t.records / t.records.sum() for t in filled), none),
        sum((t.stated / t.records.sum() for t in filled), none),
        sum((t.happened / t.records.sum() for t in filled), none),
    )


def _table(stated: Array, happened: Array) -> Reliability:
    index = np.clip((stated * N_BINS).astype(np.int64), 0, N_BINS - 1)
    counted = np.bincount(index, minlength=N_BINS).astype(np.float64)
    return Reliability(
        counted, np.bincount(index, stated, minlength=N_BINS), np.bincount(index, happened, minlength=N_BINS)
    )
