"""One step of the regulation charts. Compiled; plain arrays, every filter in place."""

import math

import numpy as np
from numpy.typing import NDArray

from detectors.bank.summary import log_normal_above
from twin.compiled import compiled

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
_L, _W, _A = range(3)


@compiled
def advance(covariance: Array, level_walk: Array, amplitude_walk: Array) -> None:
    """From one record to the next, in place; ``level_walk`` and ``amplitude_walk`` are variances by feature."""
    for k in range(len(covariance)):
        for f in range(covariance.shape[1]):
            covariance[k, f, _L, _L] += level_walk[k]
            if f > 0:
                covariance[k, f, _A, _A] += amplitude_walk[k]


@compiled
def learn(
    mean: Array, covariance: Array, half_degrees: Array, sum_of_squares: Array, shown: Array, log_evidence: Array,
    n: Integers, begun: NDArray[np.bool_], values: Array, warmth: float, most_variance: Array, most_half_degrees: float,
) -> None:  # fmt: skip
    """Update every chart whose feature was seen, in place; arrays as in ``detectors.bank.regulation``."""
    for k in range(len(values)):
        if not math.isfinite(values[k]):
            continue
        if not begun[k]:
            # no population is known of these: the first flight says where the pump begins
            mean[k, 0, _L], begun[k] = values[k], True
        _learn(
            mean[k], covariance[k], half_degrees[k], sum_of_squares[k], shown[k], log_evidence[k],
            n[k], values[k], warmth, most_variance[k], most_half_degrees,
        )  # fmt: skip


@compiled
def _learn(
    mean: Array, covariance: Array, half_degrees: Array, sum_of_squares: Array, shown: Array, log_evidence: Array,
    n: int, value: float, warmth: float, most_variance: float, most_half_degrees: float,
) -> None:  # fmt: skip
    """Update every filter of one chart in place: linear model, unknown noise variance (normal-inverse-gamma).

    A fault shows on some flights and not on others: its filter weighs both, with a share that it learns, and is
    updated as the likelier of the two.
    """
    moved = np.empty(3)
    for f in range(n):
        m, P = mean[f], covariance[f]
        a, b = half_degrees[f], sum_of_squares[f]
        # what is measured is level + slope * warmth, and the fault's size on top where it shows
        expected = m[_L] + warmth * m[_W]
        spread = P[_L, _L] + 2.0 * warmth * P[_L, _W] + warmth * warmth * P[_W, _W]
        with_fault = 0.0
        without = _log_density(value - expected, spread, a, b)
        log_evidence[f] += without
        if f > 0:
            more = spread + 2.0 * (P[_L, _A] + warmth * P[_W, _A]) + P[_A, _A]
            present = _log_density(value - expected - m[_A], more, a, b)
            share = shown[f, 0] / (shown[f, 0] + shown[f, 1])
            top = max(present, without)
            weight, other = share * math.exp(present - top), (1.0 - share) * math.exp(without - top)
            log_evidence[f] += top + math.log(weight + other) - without
            shown[f, 0] += weight / (weight + other)
            shown[f, 1] += other / (weight + other)
            if weight >= other:
                with_fault, spread, expected = 1.0, more, expected + m[_A]
        off = value - expected
        z2 = off * off * a / (b * (spread + 1.0))
        total = spread + max(1.0, (2.0 * a + z2) / (2.0 * a + 1.0))
        for i in range(3):
            moved[i] = P[i, _L] + warmth * P[i, _W] + with_fault * P[i, _A]
        for i in range(3):
            m[i] += moved[i] / total * off
            for j in range(3):
                P[i, j] -= moved[i] * moved[j] / total
        a, b = a + 0.5, b + 0.5 * off * off / total
        keep = min(1.0, most_half_degrees / a)
        half_degrees[f], sum_of_squares[f] = keep * a, min(keep * b, keep * a * most_variance)
    healthy = log_evidence[0]
    for f in range(n):
        log_evidence[f] -= healthy


@compiled
def _log_density(off: float, spread: float, a: float, b: float) -> float:
    """Logarithm of the Student-t density ``off`` from its mean, ``spread`` in noise variances."""
    square = 2.0 * b * (spread + 1.0)
    tail = (a + 0.5) * math.log1p(off * off / square)
    return math.lgamma(a + 0.5) - math.lgamma(a) - 0.5 * math.log(math.pi * square) - tail


@compiled
def log_odds(
    mean: Array, covariance: Array, half_degrees: Array, sum_of_squares: Array, log_evidence: Array, n: Integers,
    sign: Array, floor: Array,
) -> float:  # fmt: skip
    """Log of prior odds times evidence of all faults together against the healthy pump; -1e300 without a fault.

    Faults count by the share of their size's law on the side that is a fault, and from a size that is worth a word.
    """
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
