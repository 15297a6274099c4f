"""Droop and recovery of the regulated pressure at load steps: the compensator's health, from ordinary flight records."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from detectors.reduction.statistics import mean_with_error, without_spikes
from detectors.words.numbers import LOWEST_PRESSURE_SHARE, MAD_TO_SIGMA
from detectors.words.signature import Droop, LoadStep
from twin.parameters import PumpType
from twin.recording import REQUIRED_CHANNELS, Recording

Samples = NDArray[np.float64]

STEADY_S = 0.5
"""Shortest steady stretch on either side of a step [s]."""
LONGEST_S = 5.0
"""Longest stretch that is looked at on either side [s]: later the conditions have moved on."""
DROOP_RATE_HZ = 25.0
"""Rate that faster records are brought down to for the droop: their medians would take room in proportion to its square."""
SMALLEST_FLOW_LPM = 1.0
SMALLEST_PRESSURE_BAR = 0.5
"""Smallest step that counts, of the flow and of the pressure (estimates: clear of noise; half a bar is some 5 L/min)."""
_SIGMAS = 6.0
"""Errors that an edge must stand out by (estimate: an hour at 25 Hz has 90,000 places for a false one)."""
_FEWEST = 8
"""Samples that a side of a step needs (estimate: two halves of four can be compared)."""
_FLOWS = ("commanded_flow_lpm", "discharge_flow_lpm")


@dataclass(frozen=True, slots=True)
class _Side:
    """Steady pressure and flow on one side of a step, each with its one-sigma error."""

    pressure: float
    pressure_error: float
    flow: float
    flow_error: float
    noise: float


def load_steps(recording: Recording, pump: PumpType) -> tuple[LoadStep, ...]:
    """Steps of the load between steady stretches, in time order.

    A step is seen in the commanded flow, else in the measured discharge flow, else in the discharge pressure itself.
    A step that does not stand between two steady stretches of at least half a second tells nothing of droop and is left
    out, as is one whose pressure falls below the regulated range: there the pump is at its stop.
    """
    if len(recording) < 2 * _FEWEST:
        return ()
    time = recording.time_s
    step = float(np.median(np.diff(time)))
    name = next((f for f in _FLOWS if f in recording and np.isfinite(recording[f]).any()), "discharge_pressure_bar")
    by_flow = name in _FLOWS
    pressure = recording["discharge_pressure_bar"]
    half = max(_FEWEST // 2, round(0.5 * STEADY_S / step))
    edges = _edges(recording[name], half, SMALLEST_FLOW_LPM if by_flow else SMALLEST_PRESSURE_BAR)
    flow = recording[_measured_flow(recording)] if by_flow else np.full(len(time), np.nan)
    found = []
    bounds = [0, *edges, len(time)]
    for before, edge, after in zip(bounds, bounds[1:], bounds[2:], strict=False):
        one = _step(time, pressure, flow, (before, edge, after), step, pump)
        if one is not None:
            found.append(one)
    return tuple(found)


def droop_from_rest(recording: Recording, pump: PumpType) -> Droop | None:
    """Droop from the record's load steps between zero and a known flow, averaged by their errors; None without any.

    Steps between two flows are left out: the droop is not quite a straight line.
    """
    if not any(f in recording and np.isfinite(recording[f]).any() for f in _FLOWS):
        return None
    slopes, weights, flows = [], [], []
    for step in load_steps(_slowed(recording), pump):
        before, change = step.flow_before_lpm, step.flow_change_lpm
        droop, error = step.droop_bar_per_lpm, step.droop_error_bar_per_lpm
        if before is None or change is None or droop is None or not error:
            continue
        if min(abs(before), abs(before + change)) < SMALLEST_FLOW_LPM:
            slopes.append(droop)
            weights.append(error**-2.0)
            flows.append(abs(change))
    if not slopes:
        return None
    flow = float(np.average(flows, weights=weights))
    return Droop(flow, flow * float(np.average(slopes, weights=weights)), flow / math.sqrt(sum(weights)))


def _slowed(recording: Recording) -> Recording:
    """The record by means of so many neighbours that it has at most ``DROOP_RATE_HZ``: droop asks for no more."""
    time = recording.time_s
    if len(time) < 2:
        return recording
    k = math.ceil(1.0 / (DROOP_RATE_HZ * float(np.median(np.diff(time)))) - 0.5)
    n = len(time) // max(k, 1)
    if k < 2 or n < 2:
        return recording
    names = ("time_s", "discharge_pressure_bar", *(f for f in _FLOWS if f in recording))
    found = {}
    for name in names:
        whole = recording[name][: n * k].reshape(n, k)
        known = np.isfinite(whole)
        count = known.sum(axis=1)
        sums = np.where(known, whole, 0.0).sum(axis=1)
        found[name] = np.where(count > 0, sums / np.maximum(count, 1), np.nan)
    rest = {name: np.full(n, np.nan) for name in REQUIRED_CHANNELS if name not in found}
    return Recording({**found, **rest})


def _measured_flow(recording: Recording) -> str:
    """Measured discharge flow where there is one: the command is not what the pump delivered."""
    return next(f for f in reversed(_FLOWS) if f in recording and np.isfinite(recording[f]).any())


def _edges(samples: Samples, half: int, smallest: float) -> list[int]:
    """Samples at which the median over ``half`` samples jumps: where the jump is largest between quiet stretches."""
    x = samples.copy()
    known = np.isfinite(x)
    if known.sum() < 2 * half:
        return []
    index = np.arange(len(x))
    x = np.interp(index, index[known], x[known])
    if len(x) < 2 * half + 1:
        return []
    medians = np.median(np.lib.stride_tricks.sliding_window_view(x, half), axis=1)
    jump = medians[half:] - medians[:-half]
    noise = MAD_TO_SIGMA * float(np.median(np.abs(np.diff(x)))) / math.sqrt(2.0)
    limit = max(smallest, _SIGMAS * noise / math.sqrt(half))
    edges = []
    above = np.abs(jump) >= limit
    starts = np.flatnonzero(np.diff(np.concatenate(([False], above, [False])).astype(np.int8)))
    for first, end in zip(starts[::2], starts[1::2], strict=True):
        # the middle of the jump's plateau: medians see the edge from both sides alike
        top = np.abs(jump[first:end])
        high = np.flatnonzero(top >= 0.9 * top.max())
        place = int(first) + half + int(high[len(high) // 2])
        edges.append(_refined(x, place, half))
    return edges


def _refined(x: Samples, place: int, half: int) -> int:
    """First sample past half of the jump near ``place``."""
    low, high = max(place - half, 0), min(place + half, len(x))
    before, after = float(np.median(x[max(low - half, 0) : low + 1])), float(np.median(x[high - 1 : high + half]))
    share = (x[low:high] - before) / (after - before) if after != before else np.zeros(high - low)
    crossed = np.flatnonzero(share > 0.5)
    return low + int(crossed[0]) if len(crossed) else place


def _step(
    time: Samples, pressure: Samples, flow: Samples, bounds: tuple[int, int, int], step: float, pump: PumpType
) -> LoadStep | None:
    start, edge, end = bounds
    # the last steady stretch before the edge, and the last one before the next edge
    first = max(start, int(np.searchsorted(time, time[edge] - LONGEST_S)))
    last = min(end, int(np.searchsorted(time, time[edge] + LONGEST_S)))
    guard = max(1, round(0.02 * (last - edge))) if end < len(time) else 0
    before = _side(time, pressure, flow, (first + (edge - first) // 2, edge - 1), step)
    after = _side(time, pressure, flow, (edge + (last - edge) // 2, last - guard), step)
    if before is None or after is None:
        return None
    if min(before.pressure, after.pressure) < LOWEST_PRESSURE_SHARE * pump.limits["zero_flow_pressure_low_bar"].value:
        return None
    way = pressure[edge : last - guard] - after.pressure
    known = np.isfinite(without_spikes(np.diff(way, prepend=way[0]), 2.0 * after.noise + 1.0)) & np.isfinite(way)
    if known.sum() < _FEWEST:
        return None
    at, deviation = time[edge : last - guard][known] - time[edge], way[known]
    excursion = float(deviation[np.argmax(np.abs(deviation))])
    band = max(0.1 * abs(excursion), 4.0 * after.noise)
    # the middle of three neighbours: one noisy sample does not make the recovery longer
    outside = np.flatnonzero(median_filter(np.abs(deviation), 3, mode="nearest") > band)
    leaves = int(outside[-1]) + 1 if len(outside) else 0
    recovery = float(at[min(leaves, len(at) - 1)])
    change = after.pressure - before.pressure
    change_error = math.hypot(before.pressure_error, after.pressure_error)
    flow_change = after.flow - before.flow
    droop = droop_error = None
    if math.isfinite(flow_change) and abs(flow_change) >= SMALLEST_FLOW_LPM:
        droop = -change / flow_change
        flow_error = math.hypot(before.flow_error, after.flow_error)
        droop_error = math.hypot(change_error / flow_change, droop * flow_error / flow_change)
    return LoadStep(
        float(time[edge]),
        before.flow if math.isfinite(flow_change) else None,
        float(flow_change) if math.isfinite(flow_change) else None,
        change,
        change_error,
        droop,
        droop_error,
        excursion,
        recovery,
        # both ends fall anywhere between two samples, and noise moves where an exponential crosses the band
        math.hypot(step / math.sqrt(6.0), after.noise * recovery / (math.log(10.0) * band)),
        band,
    )


def _side(time: Samples, pressure: Samples, flow: Samples, bounds: tuple[int, int], step: float) -> _Side | None:
    """Steady means of a stretch; None where it is too short or still moves."""
    inside = slice(*bounds)
    x = pressure[inside]
    if bounds[1] - bounds[0] < _FEWEST or time[bounds[1] - 1] - time[bounds[0]] < 0.5 * STEADY_S - step:
        return None
    mean = mean_with_error(x)
    if mean is None or np.isfinite(x).sum() < _FEWEST:
        return None
    clean = without_spikes(x)
    halves = [float(np.nanmean(h)) for h in np.array_split(clean, 2) if np.isfinite(h).any()]
    noise = float(np.nanstd(clean))
    # ripple of the pump moves no mean; a drift of a tenth of the smallest step does not yet count
    if len(halves) < 2 or abs(halves[1] - halves[0]) > max(0.1 * SMALLEST_PRESSURE_BAR, 5.0 * mean.standard_error):
        return None
    q = mean_with_error(flow[inside])
    if q is None:
        return _Side(mean.mean, mean.standard_error, math.nan, math.nan, noise)
    return _Side(mean.mean, mean.standard_error, q.mean, q.standard_error, noise)
