"""Threshold of any chart from simulated healthy sequences, with its error."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from benchmarks.charts.contract import Chart

S = TypeVar("S")

Source = Callable[[np.random.Generator, int], Iterator[NDArray[np.float64]]]
"""``source(rng, m)`` yields, step by step and without end, the next healthy value of m independent sequences."""


@dataclass(frozen=True, slots=True)
class Calibration:
    """A threshold, the ARL0 that it was found for, standard error of ln(ARL0) and number of simulated sequences."""

    threshold: float
    arl: float
    log_arl_standard_error: float
    n_paths: int


def calibrated_threshold(
    chart: Chart[S],
    arl: float,
    source: Source,
    *,
    seed: int,
    n_sequences: int = 400,
    horizon: float = 3.0,
) -> Calibration:
    """Threshold at which ``chart`` alarms falsely every ``arl`` records on average; its own threshold is not used.

    All sequences run for ``horizon * arl`` steps. For any threshold the records until the first alarm, or the end,
    over the number of sequences that alarmed estimate ARL0 (run lengths are geometric but for a short start).

    Parameters
    ----------
    chart : Chart
        The chart, its threshold being any admissible number.
    arl : float
        Wanted average number of records between false alarms.
    source : Source
        Healthy values: `independent_normal`, or a simulation or resampling of the evidence itself.
    seed : int
        Seed; the same seed gives the same threshold.
    n_sequences : int
        Sequences side by side; the relative error of ARL0 is about ``1 / sqrt(n_sequences)``.
    horizon : float
        Length of each sequence in units of ``arl``.

    Raises
    ------
    ValueError
        If a number is too small for a calibration.
    """
    faults = [
        f"{name} is {value:g}; it must be at least {least:g}"
        for name, value, least in (("arl", arl, 2), ("n_sequences", n_sequences, 20), ("horizon", horizon, 1))
        if not value >= least
    ]
    if faults:
        raise ValueError("; ".join(faults))
    highs = _running_maxima(chart, source, seed, n_sequences, math.ceil(horizon * arl))
    low, high = 0.0, max(float(values[-1]) for _, values in highs)
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _exposure(highs, middle, horizon * arl)[0] < arl else (low, middle)
    n_alarms = _exposure(highs, high, horizon * arl)[1]
    return Calibration(high, arl, 1.0 / math.sqrt(max(n_alarms, 1)), n_sequences)


def independent_normal(rng: np.random.Generator, n_sequences: int) -> Iterator[NDArray[np.float64]]:
    """Healthy values of an ideal channel: independent, standard normal."""
    while True:
        yield rng.standard_normal(n_sequences)


def _running_maxima(
    chart: Chart[S], source: Source, seed: int, n_sequences: int, n_steps: int
) -> list[tuple[NDArray[np.int64], NDArray[np.float64]]]:
    """Steps at which each sequence's statistic reached a new high, and the highs."""
    state, top = chart.start((n_sequences,)), np.full(n_sequences, -np.inf)
    who, when, what = [], [], []
    values = source(np.random.default_rng(seed), n_sequences)
    for step in range(1, n_steps + 1):
        state, statistic = chart.update(state, next(values))
        (new,) = np.nonzero(statistic > top)
        if len(new):
            top[new] = statistic[new]
            who.append(new)
            when.append(np.full(len(new), step))
            what.append(statistic[new])
    sequence, steps, highs = np.concatenate(who), np.concatenate(when), np.concatenate(what)
    order = np.argsort(sequence, kind="stable")
    cuts = np.searchsorted(sequence[order], np.arange(1, n_sequences))
    return list(zip(np.split(steps[order], cuts), np.split(highs[order], cuts), strict=True))


def _exposure(
    highs: list[tuple[NDArray[np.int64], NDArray[np.float64]]], threshold: float, end: float
) -> tuple[float, int]:
    """ARL0 and number of alarms at a threshold."""
    records, alarms = 0.0, 0
    for steps, values in highs:
        first = int(np.searchsorted(values, threshold))
        if first < len(values):
            records += float(steps[first])
            alarms += 1
        else:
            records += end
    return (records / alarms if alarms else math.inf), alarms
