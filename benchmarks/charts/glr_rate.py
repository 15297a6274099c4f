"""ARL0 of a windowed GLR by importance sampling: long times between false alarms in seconds of computing.

A false alarm is rare while the pump is healthy and common once a change is put in. Paths are drawn with a random
onset, shape and size; each alarm then counts by one over the likelihood ratio of that mixture at the alarm, which is
an unbiased estimate of the healthy probability (Chan and Lai 2007, Annals of Applied Probability; Siegmund 1985).
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr, logsumexp

from benchmarks.charts.calibration import Calibration
from benchmarks.charts.cusum import Side
from benchmarks.charts.glr import Glr, Shape

Array = NDArray[np.float64]


def glr_arl(chart: Glr, *, seed: int = 1, n_paths: int = 4000) -> tuple[float, float]:
    """Average run length [records] of a healthy sequence, and the standard error of its logarithm.

    The rate of alarms is taken after the window has filled. For an ARL0 well above the window's length.
    """
    n_steps = 3 * chart.window
    weight, alarm = _alarms(chart, chart.threshold, np.random.default_rng(seed), n_steps, n_paths)
    late = weight * (alarm > chart.window)
    # of those that are silent when the window has filled, the share that alarms by the end
    share = float(late.mean() / max(1.0 - (weight - late).mean(), 1e-9))
    if not 0.0 < share < 1.0:
        return (math.inf, math.inf) if share <= 0.0 else (1.0, math.inf)
    return -(n_steps - chart.window) / math.log1p(-share), float(late.std(ddof=1) / math.sqrt(n_paths) / late.mean())


def glr_threshold(
    window: int,
    arl: float,
    shapes: tuple[Shape, ...] = (Shape.STEP,),
    side: Side = Side.BOTH,
    *,
    seed: int = 1,
    n_paths: int = 4000,
) -> Calibration:
    """Threshold [nat] with ``arl`` records between false alarms on average, independent normal values.

    Raises
    ------
    ValueError
        If ``arl`` is below ten windows, where the rate is not small; `calibrated_threshold` serves there.
    """
    if not arl >= 10.0 * window:
        raise ValueError(f"arl is {arl:g}; importance sampling needs at least ten windows, {10 * window} records")
    threshold, error = math.log(arl), math.inf
    for _ in range(12):
        found, error = glr_arl(Glr(window, threshold, shapes, side), seed=seed, n_paths=n_paths)
        step = math.log(arl / found)
        threshold += step
        if abs(step) < 0.5 * error:
            break
    return Calibration(threshold, arl, error, n_paths)


def _alarms(chart: Glr, threshold: float, rng: np.random.Generator, n_steps: int, n_paths: int) -> tuple[Array, Array]:
    """Weight (0 without an alarm) and step of the first alarm of each path drawn with a change."""
    onset = rng.integers(0, n_steps, n_paths)
    shape = rng.integers(0, len(chart.shapes), n_paths)
    # sizes that reach the threshold at any length of the window, from one record to all of it
    spreads = math.sqrt(2.0 * threshold) / np.sqrt(np.geomspace(1.0, chart.window, 5))
    spread = rng.integers(0, len(spreads), n_paths)
    size = rng.standard_normal(n_paths) * spreads[spread]
    if chart.side is not Side.BOTH:
        size = np.abs(size) * (1.0 if chart.side is Side.UPPER else -1.0)
    ramp = np.array([s is Shape.RAMP for s in chart.shapes])[shape]
    # a ramp's size is stated at the end of a window, where its energy is a third of a step's
    slope = math.sqrt(3.0) / chart.window
    state = chart.start((n_paths,))
    match = np.zeros((len(chart.shapes), n_steps, n_paths))
    weight, alarm = np.zeros(n_paths), np.zeros(n_paths)
    alive = np.arange(n_paths)
    for t in range(n_steps):
        since = np.maximum(t + 1 - onset[alive], 0.0)
        x = rng.standard_normal(len(alive)) + size[alive] * np.where(ramp[alive], slope * since, since > 0)
        state, statistic = chart.update(state, x)
        length = np.arange(t + 1, 0, -1.0)[:, None]
        for s, kind in enumerate(chart.shapes):
            match[s, : t + 1] += x * (slope * length if kind is Shape.RAMP else 1.0)
        hit = statistic >= threshold
        if hit.any():
            logs = [
                _log_ratio(match[s, : t + 1][:, hit], length, kind, slope, spreads, chart.side)
                for s, kind in enumerate(chart.shapes)
            ]
            share = 1.0 / (n_steps * len(chart.shapes) * len(spreads))
            started = logsumexp(np.concatenate(logs), axis=0) + math.log(share)
            waiting = (n_steps - t - 1) / n_steps
            mixture = np.logaddexp(started, math.log(waiting)) if waiting else started
            weight[alive[hit]] = np.exp(-mixture)
            alarm[alive[hit]] = t + 1
            alive, state, match = alive[~hit], state[:, ~hit], match[:, :, ~hit]
            if not len(alive):
                break
    return weight, alarm


def _log_ratio(match: Array, length: Array, kind: Shape, slope: float, spreads: Array, side: Side) -> Array:
    """Log likelihood ratios of each onset and spread with the size integrated out; (n_spreads * n_onsets, paths)."""
    energy = length if kind is Shape.STEP else slope**2 * length * (length + 1.0) * (2.0 * length + 1.0) / 6.0
    out = []
    for spread in spreads:
        precision = energy + 1.0 / spread**2
        log = match**2 / (2.0 * precision) - 0.5 * np.log(precision * spread**2)
        if side is not Side.BOTH:
            sign = 1.0 if side is Side.UPPER else -1.0
            log = log + math.log(2.0) + log_ndtr(sign * match / np.sqrt(precision))
        out.append(log)
    return np.concatenate(out)
