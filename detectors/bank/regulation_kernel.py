"""One step of the regulation charts. Compiled; plain arrays, every filter in place."""

import math

import numpy as np

from detectors.bank.shapes import ABSENT, LEVEL, SHOWN, SIZE, WARMTH, Array, Charts
from detectors.bank.summary import log_normal_above
from twin.compiled import compiled


@compiled
def advance(charts: Charts, level_walk: Array, size_walk: Array) -> None:
    """From one record to the next, in place; ``level_walk`` and ``size_walk`` are variances by feature."""
    covariance = charts.covariance
    for k in range(len(covariance)):
        for f in range(covariance.shape[1]):
            covariance[k, f, LEVEL, LEVEL] += level_walk[k]
            if f > 0:
                covariance[k, f, SIZE, SIZE] += size_walk[k]


@compiled
def learn(charts: Charts, values: Array, warmth: float, most_variance: Array, most_half_degrees: float) -> None:
    """Update every chart whose feature was seen, in place."""
    for k in range(len(values)):
        if not math.isfinite(values[k]):
            continue
        if not charts.begun[k]:
            # no population is known of these: the first flight says where the pump begins
            charts.mean[k, 0, LEVEL], charts.begun[k] = values[k], True
        _learn(charts, k, values[k], warmth, most_variance[k], most_half_degrees)


@compiled
def _learn(charts: Charts, k: int, value: float, warmth: float, most_variance: float, most_half_degrees: float) -> None:
    """Update every filter of chart k in place: linear model, unknown noise variance (normal-inverse-gamma).

    A fault shows on some flights and not on others: its filter weighs both, with a share that it learns, and is
    updated as the likelier of the two.
    """
    half_degrees, sum_of_squares, presence = charts.half_degrees[k], charts.sum_of_squares[k], charts.presence[k]
    log_evidence, n = charts.log_evidence[k], charts.n[k]
    moved = np.empty(3)
    for f in range(n):
        m, P = charts.mean[k, f], charts.covariance[k, f]
        a, b = half_degrees[f], sum_of_squares[f]
        # what is measured is level + slope * warmth, and the fault's size on top where it shows
        expected = m[LEVEL] + warmth * m[WARMTH]
        spread = P[LEVEL, LEVEL] + 2.0 * warmth * P[LEVEL, WARMTH] + warmth * warmth * P[WARMTH, WARMTH]
        with_fault = 0.0
        without = _log_density(value - expected, spread, a, b)
        log_evidence[f] += without
        if f > 0:
            more = spread + 2.0 * (P[LEVEL, SIZE] + warmth * P[WARMTH, SIZE]) + P[SIZE, SIZE]
            present = _log_density(value - expected - m[SIZE], more, a, b)
            share = presence[f, SHOWN] / (presence[f, SHOWN] + presence[f, ABSENT])
            top = max(present, without)
            weight, other = share * math.exp(present - top), (1.0 - share) * math.exp(without - top)
            log_evidence[f] += top + math.log(weight + other) - without
            presence[f, SHOWN] += weight / (weight + other)
            presence[f, ABSENT] += other / (weight + other)
            if weight >= other:
                with_fault, spread, expected = 1.0, more, expected + m[SIZE]
        off = value - expected
        z2 = off * off * a / (b * (spread + 1.0))
        total = spread + max(1.0, (2.0 * a + z2) / (2.0 * a + 1.0))
        for i in range(3):
            moved[i] = P[i, LEVEL] + warmth * P[i, WARMTH] + with_fault * P[i, SIZE]
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
def spawn(charts: Charts, presence: Array, size_variance: Array, log_hazard: float) -> None:
    """A change of every feature that was seen sets in now, in place; the least likely onset gives way.

    ``presence`` (2,) are the prior flights on which it shows and does not, ``size_variance`` by feature in noise variances.
    """
    for k in range(len(charts.n)):
        if not charts.begun[k]:
            continue
        place = charts.n[k]
        if place == charts.mean.shape[1]:
            place = 1 + charts.log_evidence[k, 1:].argmin()
        else:
            charts.n[k] += 1
        for i in range(3):
            charts.mean[k, place, i] = charts.mean[k, 0, i]
            for j in range(3):
                of_size = SIZE in (i, j)
                charts.covariance[k, place, i, j] = 0.0 if of_size else charts.covariance[k, 0, i, j]
        charts.covariance[k, place, SIZE, SIZE] = size_variance[k]
        charts.half_degrees[k, place] = charts.half_degrees[k, 0]
        charts.sum_of_squares[k, place] = charts.sum_of_squares[k, 0]
        charts.presence[k, place, SHOWN], charts.presence[k, place, ABSENT] = presence[SHOWN], presence[ABSENT]
        charts.log_evidence[k, place] = charts.log_evidence[k, 0] + log_hazard


@compiled
def _log_density(off: float, spread: float, a: float, b: float) -> float:
    """Logarithm of the Student-t density ``off`` from its mean, ``spread`` in noise variances."""
    square = 2.0 * b * (spread + 1.0)
    tail = (a + 0.5) * math.log1p(off * off / square)
    return math.lgamma(a + 0.5) - math.lgamma(a) - 0.5 * math.log(math.pi * square) - tail


@compiled
def log_odds(charts: Charts, sign: Array, floor: Array) -> float:
    """Log of prior odds times evidence of all faults together against the healthy pump; -1e300 without a fault.

    Faults count by the share of their size's law on the side that is a fault, and from a size that is worth a word.
    """
    best, total = -1.0e300, 0.0
    for k in range(len(charts.n)):
        for f in range(1, charts.n[k]):
            size = sign[k] * charts.mean[k, f, SIZE]
            if size < floor[k]:
                continue
            variance = charts.covariance[k, f, SIZE, SIZE] * charts.sum_of_squares[k, f] / charts.half_degrees[k, f]
            sd = math.sqrt(max(variance, 1.0e-300))
            odds = charts.log_evidence[k, f] + log_normal_above(size / sd) + math.log(2.0)
            if odds > best:
                total = total * math.exp(best - odds) + 1.0
                best = odds
            else:
                total += math.exp(odds - best)
    return best + math.log(total) if total > 0.0 else best
