"""What another alarm threshold would have done: the same histories, the log odds of a fault cut at every height.

An alarm stands as in ``detectors.judgement.isolation``: raised after some records in a row above the threshold, ended below a
lower one. The log odds are those of the six stated probabilities; having come worn counts as a fault in them.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from detectors.evaluation.scores import N_DRAWS, Score, detection_delay, proportion, time_between_false_alarms
from detectors.evaluation.scoring import Seen, Truths

Array = NDArray[np.float64]

THRESHOLDS: tuple[float, ...] = (-2.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0, 12.0, 15.0, 20.0, 25.0, 30.0)
"""Log odds [nat] at which alarms are cut."""
WANTED_FALSE_ALARMS = 1.0
"""Per 10,000 records."""
DETECTED_AT_ONE = "alarm after the onset, at 1 false alarm per 10,000 records"
DELAY_AT_ONE = "delay, median, at 1 false alarm per 10,000 records"
THRESHOLD_AT_ONE = "log odds that give 1 false alarm per 10,000 records"
_MISSED = 1.0e9
"""Delay that stands for no alarm: beyond any life, and finite so that medians can be taken."""


@dataclass(frozen=True)
class OperatingCurve:
    """By threshold: false alarms per 10,000 healthy records, share of faulty pumps found, their median delay [flights].

    Each with its 95 % interval: exact Poisson, Wilson, resampled pumps. A median that was never reached is infinite.
    """

    thresholds: tuple[float, ...]
    false_alarms: tuple[Score, ...]
    detected: tuple[Score, ...]
    delay: tuple[Score, ...]


def alarmed_at(log_odds: Array, on: ArrayLike, off: ArrayLike, n_records: int) -> Truths:
    """Whether an alarm stands at each threshold; log odds that are not a number are no evidence of anything.

    Parameters
    ----------
    log_odds
        Shape (n_pumps, n_records) [nat].
    on, off
        Levels that raise and end an alarm, shapes (n_levels,) [nat].
    n_records
        In a row above ``on`` before an alarm is raised.

    Returns
    -------
    ndarray of bool
        Shape (n_levels, n_pumps, n_records).
    """
    upper, lower = (np.asarray(level, dtype=np.float64)[:, None] for level in (on, off))
    result = np.zeros((len(upper), *log_odds.shape), dtype=np.bool_)
    raised, above = result[..., 0].copy(), np.zeros(result.shape[:2], dtype=np.int64)
    for j, value in enumerate(log_odds.T):
        above = np.where(value > upper, above + 1, 0)
        raised = (above >= n_records) | (raised & (value >= lower))
        result[..., j] = raised
    return result


def log_odds(found: Seen) -> Array:
    """Log odds of any fault against health [nat]; NaN where no verdict was possible, shape (n_pumps, n_records)."""
    healthy = np.clip(found.outcome.probabilities[..., 0], 1.0e-300, 1.0)
    odds = np.log(np.maximum(1.0 - healthy, 1.0e-300)) - np.log(healthy)
    return np.where(found.judged, odds, np.nan)


def operating_curve(
    healthy: Seen, faulty: Seen, thresholds: Mapping[str, float], seed: int
) -> tuple[OperatingCurve, dict[str, Score]]:
    """Sweep the alarm threshold.

    Parameters
    ----------
    healthy, faulty
        Pumps without a fault, and of a row with an onset, under the same sensing.
    thresholds
        Effective thresholds: records in a row, and how far the off-level lies below the on-level.
    seed
        Of the resampling of pumps, healthy and faulty apart.

    Returns
    -------
    curve
        Over ``THRESHOLDS``.
    scores
        ``DETECTED_AT_ONE``, ``DELAY_AT_ONE`` and ``THRESHOLD_AT_ONE``, at the lowest threshold that keeps the wanted
        rate in the same draw; empty where none does.
    """
    n_records = int(thresholds["alarm_records"])
    below = thresholds["alarm_on_log_odds"] - thresholds["alarm_off_log_odds"]
    sound, sick = log_odds(healthy), log_odds(faulty)
    records = healthy.judged.sum(axis=1)
    levels = np.array(THRESHOLDS)
    quiet = alarmed_at(sound, levels, levels - below, n_records)
    began = quiet.copy()
    began[..., 1:] &= ~quiet[..., :-1]
    false_alarms = began.sum(axis=2).astype(np.float64)
    loud = alarmed_at(sick, levels, levels - below, n_records)
    delay = np.array([[_delay(faulty, i, line) for i, line in enumerate(lines)] for lines in loud])
    curve = OperatingCurve(
        THRESHOLDS,
        tuple(_rate(int(n.sum()), int(records.sum())) for n in false_alarms),
        tuple(proportion(int((d < _MISSED).sum()), len(d)) for d in delay),
        tuple(_median(d, seed) for d in delay),
    )
    return curve, _at_wanted_rate(false_alarms, records, delay, seed)


def _delay(faulty: Seen, pump: int, alarmed: Truths) -> float:
    """Flights from the onset to the first alarm that begins then; ``_MISSED`` where none does."""
    after = faulty.after[pump]
    if not after.any():
        return _MISSED
    onset = int(np.argmax(after))
    found = detection_delay(alarmed, onset)
    if found is None:
        return _MISSED
    return float(faulty.outcome.flight[pump, onset + found] - (faulty.row.onset or 0))


def _rate(n: int, records: int) -> Score:
    if not records:
        return Score(math.nan, 0.0, math.inf)
    between = time_between_false_alarms(n, records)
    return Score(1.0e4 * n / records, 1.0e4 / between.high, 1.0e4 / between.low)


def _median(delay: Array, seed: int) -> Score:
    rng = np.random.default_rng(seed)
    rank = (len(delay) - 1) // 2
    drawn = np.sort(delay[rng.integers(0, len(delay), (N_DRAWS, len(delay)))], axis=1)[:, rank]
    low, high = np.quantile(drawn, (0.025, 0.975), method="nearest")
    return Score(*(_reached(v) for v in (float(np.sort(delay)[rank]), float(low), float(high))))


def _reached(delay: float) -> float:
    return math.inf if delay >= _MISSED else delay


def _at_wanted_rate(false_alarms: Array, records: NDArray[np.int64], delay: Array, seed: int) -> dict[str, Score]:
    """Share found, median delay and threshold where the rate is kept; pumps are resampled, healthy and faulty apart."""
    rng = np.random.default_rng(seed)
    rank = (delay.shape[1] - 1) // 2

    def at(sound: NDArray[np.int64], sick: NDArray[np.int64]) -> tuple[float, float, float] | None:
        rate = 1.0e4 * false_alarms[:, sound].sum(axis=1) / max(float(records[sound].sum()), 1.0)
        # a rate that rises again with the threshold is chance: the lowest threshold from which on all keep it
        kept = np.logical_and.accumulate((rate <= WANTED_FALSE_ALARMS)[::-1])[::-1]
        if not kept.any():
            return None
        k = int(np.argmax(kept))
        found = np.sort(delay[k, sick])
        return float((found < _MISSED).mean()), float(found[rank]), THRESHOLDS[k]

    n, m = false_alarms.shape[1], delay.shape[1]
    value = at(np.arange(n, dtype=np.int64), np.arange(m, dtype=np.int64))
    draws = [at(rng.integers(0, n, (n,)), rng.integers(0, m, (m,))) for _ in range(N_DRAWS)]
    kept = np.array([d for d in draws if d is not None])
    if value is None or not len(kept):
        return {}
    low, high = np.quantile(kept, (0.025, 0.975), axis=0, method="nearest")
    names = (DETECTED_AT_ONE, DELAY_AT_ONE, THRESHOLD_AT_ONE)
    return {
        name: Score(*(_reached(float(v)) for v in ends))
        for name, ends in zip(names, zip(value, low, high, strict=True), strict=True)
    }
