"""How well a detector, a probability or a forecast did: pure functions, each with its uncertainty."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri
from scipy.stats import chi2

Array = NDArray[np.float64]


N_DRAWS = 500
"""Resamples of a bootstrap interval (estimate: its ends are then known to a tenth of its width)."""


@dataclass(frozen=True, slots=True)
class Score:
    """An estimate with its confidence interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Roc:
    """Receiver operating characteristic: rates at each threshold from the strictest on, and the area below."""

    thresholds: Array
    false_alarm_rate: Array
    detection_rate: Array
    area: float


def proportion(successes: int, trials: int, confidence: float = 0.95) -> Score:
    """Share with Wilson's interval; without trials anything from 0 to 1 (Wilson 1927).

    Raises
    ------
    ValueError
        If the counts or the confidence are impossible.
    """
    if not 0 <= successes <= trials or not 0.0 < confidence < 1.0:
        raise ValueError(f"{successes} successes of {trials} trials at a confidence of {confidence:g} are impossible")
    if trials == 0:
        return Score(math.nan, 0.0, 1.0)
    z, p = float(ndtri(0.5 + 0.5 * confidence)), successes / trials
    centre = (p + z**2 / (2 * trials)) / (1 + z**2 / trials)
    reach = z / (1 + z**2 / trials) * math.sqrt(p * (1 - p) / trials + z**2 / (4 * trials**2))
    low = 0.0 if successes == 0 else centre - reach
    return Score(p, low, 1.0 if successes == trials else centre + reach)


def bootstrap(
    statistic: Callable[[Array], float], values: ArrayLike, *, seed: int, confidence: float = 0.95, n_draws: int = 2000
) -> Score:
    """Statistic of independent ``values``, shape (n, ...), with a percentile interval by resampling the first axis.

    Resample what is independent: pumps, not records of one pump.

    Raises
    ------
    ValueError
        Without a value.
    """
    x = np.asarray(values, dtype=np.float64)
    if len(x) == 0:
        raise ValueError("values are missing; at least one is needed")
    rng = np.random.default_rng(seed)
    draws = [statistic(x[rng.integers(0, len(x), len(x))]) for _ in range(n_draws)]
    low, high = np.nanquantile(draws, (0.5 - 0.5 * confidence, 0.5 + 0.5 * confidence))
    return Score(float(statistic(x)), float(low), float(high))


def roc(healthy: ArrayLike, faulty: ArrayLike) -> Roc:
    """ROC of statistics that are larger for a fault; ties count half.

    Raises
    ------
    ValueError
        Without a value on either side.
    """
    h, f = np.sort(np.asarray(healthy, dtype=np.float64)), np.sort(np.asarray(faulty, dtype=np.float64))
    if not len(h) or not len(f):
        raise ValueError(f"{len(h)} healthy and {len(f)} faulty values; at least one of each is needed")
    thresholds = np.unique(np.concatenate([h, f]))[::-1]
    false_alarm = 1.0 - np.searchsorted(h, thresholds) / len(h)
    detection = 1.0 - np.searchsorted(f, thresholds) / len(f)
    x, y = np.concatenate([[0.0], false_alarm]), np.concatenate([[0.0], detection])
    return Roc(thresholds, false_alarm, detection, float(np.trapezoid(y, x)))


def calibration_error(probabilities: ArrayLike, happened: ArrayLike, n_bins: int = 10) -> float:
    """Expected calibration error: mean gap between stated and observed share over equal-width bins (Naeini 2015)."""
    p, y = np.asarray(probabilities, dtype=np.float64), np.asarray(happened, dtype=np.float64)
    if p.shape != y.shape or p.ndim != 1 or not len(p) or not ((p >= 0.0) & (p <= 1.0)).all():
        raise ValueError("probabilities must lie between 0 and 1, as many as outcomes, at least one")
    index = np.minimum((p * n_bins).astype(np.int64), n_bins - 1)
    gap = np.bincount(index, p - y, minlength=n_bins)
    return float(np.abs(gap).sum() / len(p))


def episodes(alarmed: ArrayLike, quiet_records: int = 1) -> list[tuple[int, int]]:
    """Alarm episodes as (first, last) record; a pause shorter than ``quiet_records`` does not end one."""
    found: list[tuple[int, int]] = []
    for i in np.flatnonzero(np.asarray(alarmed, dtype=np.bool_)).tolist():
        if found and i - found[-1][1] <= quiet_records:
            found[-1] = (found[-1][0], i)
        else:
            found.append((i, i))
    return found


def detection_delay(alarmed: ArrayLike, onset: int, quiet_records: int = 1) -> int | None:
    """Records from the onset's record to the first alarm of an episode that begins there or later; None if missed.

    An episode that began before the onset is a false alarm and finds nothing, even if it lasts.
    """
    starts = [first for first, _ in episodes(alarmed, quiet_records) if first >= onset]
    return starts[0] - onset if starts else None


def time_between_false_alarms(n_episodes: int, records: float, confidence: float = 0.95) -> Score:
    """Healthy records per false alarm episode with the exact Poisson interval; infinite value without any (Garwood)."""
    if n_episodes < 0 or not records > 0.0:
        raise ValueError(f"{n_episodes} episodes in {records:g} records are impossible")
    tail = 0.5 * (1.0 - confidence)
    most = 0.5 * float(chi2.ppf(1.0 - tail, 2 * n_episodes + 2))
    least = 0.5 * float(chi2.ppf(tail, 2 * n_episodes)) if n_episodes else 0.0
    value, high = (records / n_episodes, records / least) if n_episodes else (math.inf, math.inf)
    return Score(value, records / most, high)


def interval_coverage(low: ArrayLike, high: ArrayLike, truth: ArrayLike, confidence: float = 0.95) -> Score:
    """Share of intervals that hold the truth, with Wilson's interval."""
    y = np.asarray(truth, dtype=np.float64)
    inside = (np.asarray(low) <= y) & (y <= np.asarray(high))
    return proportion(int(inside.sum()), inside.size, confidence)


def continuous_ranked_probability_score(samples: ArrayLike, truth: float) -> float:
    """CRPS of a forecast given as equally likely samples, in their unit; 0 is perfect (Gneiting and Raftery 2007)."""
    x = np.sort(np.asarray(samples, dtype=np.float64))
    n = len(x)
    if n == 0:
        raise ValueError("samples are missing; at least one is needed")
    spread = float((x * (2.0 * np.arange(1, n + 1) - n - 1.0)).sum()) / n**2
    return float(np.abs(x - truth).mean()) - spread


def alpha_lambda(mean: float, truth: float, alpha: float = 0.2) -> bool:
    """Whether a forecast of remaining life lies within ``alpha`` of the true one (Saxena et al. 2010).

    Both are taken at the same moment, lambda of the way from first forecast to end of life; none (NaN) is a miss.
    """
    return bool(abs(mean - truth) <= alpha * truth)
