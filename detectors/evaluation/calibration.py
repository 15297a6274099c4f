"""Whether stated probabilities happen: reliability tables of the six probabilities."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from detectors.evaluation.scores import N_DRAWS, Score
from detectors.evaluation.scoring import Seen, Truths
from detectors.evaluation.study import NAMES
from detectors.words.verdict import State

Array = NDArray[np.float64]
N_BINS = 10
N_FINE = 240
_WIDEST_LOG_ODDS = 12.0
"""Fine bins are equally wide in log odds between these ends; bins of equal mass are put together from them."""


@dataclass(frozen=True)
class Reliability:
    """Times that a probability was stated, sum of what was stated, times that it happened; by pump and bin.

    Arrays of shape (n_pumps, n_bins): ``N_BINS`` equally wide ones, or ``N_FINE`` in log odds.
    """

    counted: Array
    stated: Array
    happened: Array

    @property
    def shares(self) -> Array:
        """Share of all statements, sum stated and sum happened in each bin, over the total; shape (3, n_bins)."""
        sums = np.array([table.sum(axis=0) for table in (self.counted, self.stated, self.happened)])
        return np.asarray(sums / max(float(self.counted.sum()), 1.0))


@dataclass(frozen=True)
class Calibration:
    """Five readings of the same probabilities.

    ``confidence`` asks of the largest one of each record whether it was right; ``each`` asks all six one by one, which
    is the milder question: the many small ones are easily right. Both ask every judged record and take for true what
    is true then: a fault from the record on where it exceeds its floor (``Outcome.faulty``), in fine bins.

    ``confidence_from_onset``, ``each_from_onset`` ask the records after the onset only and call them faulty although
    nothing can be seen yet; ``alarmed`` asks as ``confidence_from_onset``, while there is an alarm. Equally wide bins.
    """

    confidence: Reliability
    each: Reliability
    confidence_from_onset: Reliability
    each_from_onset: Reliability
    alarmed: Reliability


def calibration(found: Seen) -> Calibration:
    """Tables of a row in which one answer is right."""
    now = np.where(found.outcome.faulty, NAMES.index(found.row.truth), NAMES.index(State.HEALTHY))
    last = np.full(now.shape, NAMES.index(found.row.truth))
    return Calibration(
        _largest(found, found.judged, now, fine=True),
        _each(found, found.judged, now, fine=True),
        _largest(found, found.after, last),
        _each(found, found.after, last),
        _largest(found, found.after & found.alarmed, last),
    )


def mean_shares(tables: Sequence[Reliability], weights: Sequence[float] | None = None) -> Array:
    """As ``Reliability.shares``, of several rows by their weights however many records they have.

    Without weights all rows weigh the same. Rows that state nothing have no weight; all shares are 0 if none does.
    """
    tables, share = _weighed(tables, weights)
    if not tables:
        return np.zeros((3, N_BINS))
    return np.asarray(np.tensordot(share, np.array([t.shares for t in tables]), axes=1))


def equal_mass(shares: Array, n_bins: int = N_BINS) -> Array:
    """Bins of about equal mass put together from fine ones, shapes (3, n_fine) and (3, n_bins).

    A fine bin that holds more than its share stays whole: what was stated alike cannot be parted.
    """
    return _merged(shares, _bin_of(shares[0], n_bins), n_bins)


def calibration_error(
    tables: Sequence[Reliability],
    seed: int,
    confidence: float = 0.95,
    weights: Sequence[float] | None = None,
    *,
    by_mass: bool = False,
) -> Score:
    """Expected calibration error: mean gap between stated and observed share over bins (Naeini 2015).

    Parameters
    ----------
    weights
        Of the rows; None: all alike.
    by_mass
        Put fine bins together to ``N_BINS`` of equal mass first, the same in every draw.

    Returns
    -------
    Score
        Its interval resamples pumps within each row. NaN where nothing was stated.
    """
    tables, share = _weighed(tables, weights)
    if not tables:
        return Score(math.nan, math.nan, math.nan)
    shares = mean_shares(tables, share.tolist())
    place = _bin_of(shares[0], N_BINS) if by_mass else np.arange(shares.shape[1])
    n_bins = int(place.max()) + 1
    rng = np.random.default_rng(seed)
    draws = np.zeros((N_DRAWS, n_bins))
    for table, weight in zip(tables, share, strict=True):
        gap, counted = _merged(table.stated - table.happened, place, n_bins), table.counted.sum(axis=1)
        for k in range(N_DRAWS):
            drawn = rng.integers(0, len(gap), len(gap))
            draws[k] += weight * gap[drawn].sum(axis=0) / max(float(counted[drawn].sum()), 1.0)
    errors = np.abs(draws).sum(axis=1)
    low, high = np.quantile(errors, (0.5 - 0.5 * confidence, 0.5 + 0.5 * confidence))
    return Score(float(np.abs(_merged(shares[1] - shares[2], place, n_bins)).sum()), float(low), float(high))


def _weighed(tables: Sequence[Reliability], weights: Sequence[float] | None) -> tuple[list[Reliability], Array]:
    """Tables that state something and have a weight, with their weights that add up to 1."""
    given = np.ones(len(tables)) if weights is None else np.asarray(weights, dtype=np.float64)
    kept = [(t, w) for t, w in zip(tables, given, strict=True) if t.counted.any() and w > 0.0]
    share = np.array([w for _, w in kept])
    return [t for t, _ in kept], share / share.sum() if kept else share


def _bin_of(mass: Array, n_bins: int) -> NDArray[np.int64]:
    """Number of the bin of equal mass that each fine bin belongs to: by the middle of its mass."""
    middle = np.cumsum(mass) - 0.5 * mass
    return np.minimum((middle / max(float(mass.sum()), 1e-300) * n_bins).astype(np.int64), n_bins - 1)


def _merged(values: Array, place: NDArray[np.int64], n_bins: int) -> Array:
    """Sums over the fine bins of each bin, along the last axis."""
    return np.asarray(values @ np.eye(n_bins)[place])


def _largest(found: Seen, among: Truths, truth: NDArray[np.int64], *, fine: bool = False) -> Reliability:
    pump, stated, right = _stated(found, among, truth)
    records, largest = np.arange(len(stated)), stated.argmax(axis=1)
    return _table(pump, stated[records, largest], right[records, largest], len(found.last), fine=fine)


def _each(found: Seen, among: Truths, truth: NDArray[np.int64], *, fine: bool = False) -> Reliability:
    pump, stated, right = _stated(found, among, truth)
    return _table(np.repeat(pump, stated.shape[1]), stated.ravel(), right.ravel(), len(found.last), fine=fine)


def _stated(found: Seen, among: Truths, truth: NDArray[np.int64]) -> tuple[NDArray[np.int64], Array, Array]:
    """Pump, six probabilities and six truths of each record."""
    stated = found.outcome.probabilities[among]
    right = np.zeros(stated.shape)
    right[np.arange(len(right)), truth[among]] = 1.0
    return np.nonzero(among)[0], stated, right


def _table(pump: NDArray[np.int64], stated: Array, happened: Array, n_pumps: int, *, fine: bool) -> Reliability:
    n_bins = N_FINE if fine else N_BINS
    at = stated
    if fine:
        with np.errstate(divide="ignore"):
            odds = np.log(stated) - np.log1p(-stated)
        at = (odds + _WIDEST_LOG_ODDS) / (2.0 * _WIDEST_LOG_ODDS)
    index = pump * n_bins + np.clip(at * n_bins, 0, n_bins - 1).astype(np.int64)
    size = n_pumps * n_bins

    def summed(weights: Array) -> Array:
        return np.asarray(np.bincount(index, weights, minlength=size).reshape(n_pumps, n_bins), dtype=np.float64)

    return Reliability(summed(np.ones(len(stated))), summed(stated), summed(happened))
