"""How the compensator regulates, watched beside the filter bank: scatter, ripple and frequency of discharge pressure.

A spool that sticks lets the regulated pressure swing; one that is stuck, or whose metering edges are rounded, answers
more slowly. Neither moves the means that the bank lives on, and how restless the consumers are says nothing about
leakage: these numbers share no unknown with the bank's state. Each is therefore followed by a chart of its own, and
what the charts find is weighed against the healthy pump of the bank (``detectors.isolation``).
"""

import math
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from detectors.filter_summary import log_normal_above
from twin.compiled import compiled

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class Feature(IntEnum):
    """What is followed, each as a natural logarithm of its number."""

    SCATTER = 0
    """One-sigma of the discharge pressure's samples in a zero-flow window, at any sampling rate [bar]."""
    RIPPLE = 1
    """Root mean square below order 1, from a burst [bar]."""
    FREQUENCY = 2
    """Where that ripple lies, its mean frequency, from a burst [Hz]."""


N_FEATURES = len(Feature)
MOST_ONSETS = 5
LOG_HAZARD = math.log(3.0e-4)
"""Prior of a change of one feature setting in between two onset candidates (estimate)."""
_SIGN = np.array([1.0, 1.0, -1.0])
"""Direction of a fault: a sticking spool swings, a stuck or eroded one is slow. A calmer or quicker pump is no worse."""
_SCALE = np.array([1.5, 1.5, 0.4])
_FLOOR = np.array([0.9, 0.9, 0.15])
"""Size of a fault and the size that is worth a word [-]: consumers double their restlessness, the twin's regulation slows
down by a tenth between 30 and 90 degC and by a quarter where edges are rounded tenfold."""
_NOISE = np.array([0.30, 0.30, 0.06])
"""Spread from flight to flight of a healthy pump [-] (estimates); each chart learns its own from here."""
_LEVEL = np.array([2.0, 2.0, 0.5])
_LEVEL_WALK = np.array([0.01, 0.01, 0.0015])
_WARMTH = np.array([0.3, 0.3, 0.10])
_AMPLITUDE_WALK = np.array([0.05, 0.05, 0.004])
_FIRST_HALF_DEGREES = 2.5
_MOST_HALF_DEGREES = 6.0
"""Degrees of freedom, halved, of the Student-t evidence: at first, and once the spread is known. Never more, so that a
single flight with busy consumers stays cheap."""
_MOST_NOISE = 2.0
"""A healthy pump's spread over the expected one, at most: a fault that comes and goes is no noise."""
_SHOWN = np.array([9.0, 1.0])
"""Prior flights on which a fault shows and does not (estimate)."""
_CAPACITY = 1 + MOST_ONSETS
_L, _W, _A = range(3)


@dataclass(slots=True)
class Regulation:
    """Charts of one installation, a healthy filter and up to five onsets each. Changed in place by its methods.

    Attributes
    ----------
    mean, covariance
        Level at 50 degC, slope by warmth and size of the fault; the covariance counts in noise variances. Shapes
        (N_FEATURES, M, 3) and (N_FEATURES, M, 3, 3).
    half_degrees, sum_of_squares
        What is known of the noise: shape and rate of the inverse-gamma law of its variance, (N_FEATURES, M).
    shown
        Flights on which the fault showed and on which it did not, by responsibility and prior, (N_FEATURES, M, 2).
    log_evidence
        (N_FEATURES, M).
    n
        Filters of each chart, (N_FEATURES,).
    """

    mean: Array = field(default_factory=lambda: np.zeros((N_FEATURES, _CAPACITY, 3)))
    covariance: Array = field(default_factory=lambda: np.zeros((N_FEATURES, _CAPACITY, 3, 3)))
    half_degrees: Array = field(default_factory=lambda: np.full((N_FEATURES, _CAPACITY), _FIRST_HALF_DEGREES))
    sum_of_squares: Array = field(default_factory=lambda: np.zeros((N_FEATURES, _CAPACITY)))
    shown: Array = field(default_factory=lambda: np.tile(_SHOWN, (N_FEATURES, _CAPACITY, 1)))
    log_evidence: Array = field(default_factory=lambda: np.zeros((N_FEATURES, _CAPACITY)))
    n: Integers = field(default_factory=lambda: np.ones(N_FEATURES, dtype=np.int64))
    begun: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(N_FEATURES, dtype=np.bool_))

    def __post_init__(self) -> None:
        """Start with an unknown healthy pump."""
        self.sum_of_squares[:] = (_FIRST_HALF_DEGREES * _NOISE**2)[:, None]
        self.covariance[:, 0, _W, _W] = (_WARMTH / _NOISE) ** 2
        self.covariance[:, 0, _L, _L] = (_LEVEL / _NOISE) ** 2

    def learn(self, values: Array, warmth: float) -> None:
        """Take the features of one window or burst, shape (N_FEATURES,), NaN where one was not seen."""
        for k in np.flatnonzero(np.isfinite(values)):
            if not self.begun[k]:
                # no population is known of these: the first flight says where the pump begins
                self.mean[k, 0, _L], self.begun[k] = values[k], True
            _learn(
                self.mean[k],
                self.covariance[k],
                self.half_degrees[k],
                self.sum_of_squares[k],
                self.shown[k],
                self.log_evidence[k],
                int(self.n[k]),
                float(values[k]),
                warmth,
                float((_MOST_NOISE * _NOISE[k]) ** 2),
            )

    def pass_time(self) -> None:
        """From one record to the next: levels and faults wander."""
        self.covariance[:, :, _L, _L] += ((_LEVEL_WALK / _NOISE) ** 2)[:, None]
        self.covariance[:, 1:, _A, _A] += ((_AMPLITUDE_WALK / _NOISE) ** 2)[:, None]

    def spawn(self) -> None:
        """A change of every feature setting in now; the least likely onset gives way."""
        for k in np.flatnonzero(self.begun):
            place = int(self.n[k])
            if place == _CAPACITY:
                place = 1 + int(np.argmin(self.log_evidence[k, 1:]))
            else:
                self.n[k] += 1
            for array in (self.mean, self.covariance, self.half_degrees, self.sum_of_squares, self.log_evidence):
                array[k, place] = array[k, 0]
            self.covariance[k, place, _A, :] = 0.0
            self.covariance[k, place, :, _A] = 0.0
            self.covariance[k, place, _A, _A] = (_SCALE[k] / _NOISE[k]) ** 2
            self.shown[k, place] = _SHOWN
            self.log_evidence[k, place] += LOG_HAZARD

    def log_odds(self) -> float:
        """Log of prior odds times evidence of a changed regulation against the healthy pump, over all charts.

        The charts are rivals, not witnesses: ripple and scatter of one flight have one cause, so the larger counts and
        not their product.
        """
        return _log_odds(
            self.mean,
            self.covariance,
            self.half_degrees,
            self.sum_of_squares,
            self.log_evidence,
            self.n,
            _SIGN,
            _FLOOR,
        )


@compiled
def _learn(
    mean: Array, covariance: Array, half_degrees: Array, sum_of_squares: Array, shown: Array, log_evidence: Array,
    n: int, value: float, warmth: float, most_variance: float,
) -> None:  # fmt: skip
    """Update every filter of one chart in place: linear model, unknown noise variance (normal-inverse-gamma).

    A fault shows on some flights and not on others: its filter weighs both, with a share that it learns, and is
    updated as the likelier of the two.
    """
    h = np.ones(3)
    h[1] = warmth
    for f in range(n):
        h[2] = 0.0
        without = _log_density(mean[f], covariance[f], half_degrees[f], sum_of_squares[f], h, value)
        log_evidence[f] += without
        if f > 0:
            h[2] = 1.0
            present = _log_density(mean[f], covariance[f], half_degrees[f], sum_of_squares[f], h, value)
            share = shown[f, 0] / (shown[f, 0] + shown[f, 1])
            top = max(present, without)
            weights = share * math.exp(present - top), (1.0 - share) * math.exp(without - top)
            total = weights[0] + weights[1]
            log_evidence[f] += top + math.log(total) - without
            shown[f, 0] += weights[0] / total
            shown[f, 1] += weights[1] / total
            h[2] = 1.0 if weights[0] >= weights[1] else 0.0
        P_h = covariance[f] @ h
        spread = float(h @ P_h)
        a, b = half_degrees[f], sum_of_squares[f]
        off = value - float(h @ mean[f])
        z2 = off * off * a / (b * (spread + 1.0))
        inflation = max(1.0, (2.0 * a + z2) / (2.0 * a + 1.0))
        gain = P_h / (spread + inflation)
        mean[f] += gain * off
        covariance[f] -= np.outer(gain, P_h)
        a, b = a + 0.5, b + 0.5 * off * off / (spread + inflation)
        keep = min(1.0, _MOST_HALF_DEGREES / a)
        half_degrees[f], sum_of_squares[f] = keep * a, min(keep * b, keep * a * most_variance)
    healthy = log_evidence[0]
    for f in range(n):
        log_evidence[f] -= healthy


@compiled
def _log_density(m: Array, P: Array, a: float, b: float, h: Array, value: float) -> float:
    """Logarithm of the Student-t density of a value."""
    S = float(h @ (P @ h)) + 1.0
    off = value - float(h @ m)
    z2 = off * off / (2.0 * b * S)
    return math.lgamma(a + 0.5) - math.lgamma(a) - 0.5 * math.log(2.0 * math.pi * b * S) - (a + 0.5) * math.log1p(z2)


@compiled
def _log_odds(
    mean: Array, covariance: Array, half_degrees: Array, sum_of_squares: Array, log_evidence: Array, n: Integers,
    sign: Array, floor: Array,
) -> float:  # fmt: skip
    best, total = -1.0e300, 0.0
    for k in range(len(n)):
        for f in range(1, n[k]):
            size = sign[k] * mean[k, f, 2]
            if size < floor[k]:
                continue
            sd = math.sqrt(max(covariance[k, f, 2, 2] * sum_of_squares[k, f] / half_degrees[k, f], 1.0e-300))
            odds = log_evidence[k, f] + log_normal_above(size / sd) + math.log(2.0)
            if odds > best:
                total = total * math.exp(best - odds) + 1.0
                best = odds
            else:
                total += math.exp(odds - best)
    return best + math.log(total) if total > 0.0 else best
