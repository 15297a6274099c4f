"""Steady windows: stable speed, steady temperature, untouched controls, every mean steady, long enough.

Flow itself is rarely measured in flight. Zero flow is inferred: nobody moves anything (control activity, or the
commanded flow, where recorded) and the discharge pressure sits steadily at the regulated level. A consumer that
draws a constant flow with the controls at rest cannot be seen from here; it is what `system_leakage` means.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from detectors.reduction.statistics import block_means, mean_with_error, without_spikes
from detectors.reduction.zero import stretches
from detectors.words.numbers import LOWEST_PRESSURE_SHARE, MAD_TO_SIGMA, MEDIAN_ERROR, MOST_MISSING
from detectors.words.observation import Mean, Window, WindowKind
from twin.parameters import PumpType
from twin.recording import OPTIONAL_CHANNELS, REQUIRED_CHANNELS, Recording

LOWEST_SPEED_FRACTION = 0.7
"""Share of the nominal speed above which the pump counts as turning (estimate: below flight idle, above a run-down)."""
_SEGMENTS = 4
"""Parts of a window whose medians must agree (estimate: quarters show a drift and a single step alike)."""
_FEWEST_FOR_SCATTER = 16
"""Samples that a scatter needs (estimate: it is then known to a fifth)."""
_NOISE_SIGMAS = 3.0
"""Errors of the quarters that a swing may exceed its limit by (estimate: swinging samples alone should hardly ever fail a window)."""
_CHANNELS = (*REQUIRED_CHANNELS[1:], *(c for c in OPTIONAL_CHANNELS if c != "flight_control_activity"))


@dataclass(frozen=True, slots=True)
class _Blocks:
    """Means over blocks of about a second: what steadiness is judged on, whatever the sampling rate."""

    time: NDArray[np.float64]
    duration: float
    channels: Mapping[str, NDArray[np.float64]]


def steady_windows(recording: Recording, pump: PumpType, thresholds: Mapping[str, float]) -> tuple[Window, ...]:
    """Zero-flow and constant-flow windows of a recording in time order, the rejected ones with their reason."""
    if len(recording) < 2:
        return ()
    blocks = _blocks(recording, thresholds["window_minimum_duration_s"])
    windows: list[Window] = []
    for kind, mask in _candidates(blocks, pump, thresholds):
        for first, end in stretches(mask):
            windows.extend(_cut(recording, blocks, pump, thresholds, kind, first, end))
    return tuple(sorted(windows, key=lambda w: w.start_s))


def _blocks(recording: Recording, shortest_s: float) -> _Blocks:
    step = float(np.median(np.diff(recording.time_s)))
    duration = max(step, min(1.0, shortest_s / 20.0))
    names = [n for n in (*_CHANNELS, "flight_control_activity") if n in recording]
    time = np.empty(0)
    channels = {}
    for name in names:
        time, channels[name] = block_means(recording.time_s, recording[name], duration)
    return _Blocks(time, duration, channels)


def _candidates(
    blocks: _Blocks, pump: PumpType, thresholds: Mapping[str, float]
) -> list[tuple[WindowKind, NDArray[np.bool_]]]:
    """Blocks in which the pump turns and nobody touches anything, split by commanded flow where it is known."""
    speed = blocks.channels["shaft_speed_rpm"]
    turning = np.nan_to_num(speed) > LOWEST_SPEED_FRACTION * pump.nominal_speed_rpm
    regulated = pump.limits["zero_flow_pressure_low_bar"].value * LOWEST_PRESSURE_SHARE
    commanded = blocks.channels.get("commanded_flow_lpm")
    quiet = turning.copy()
    activity = blocks.channels.get("flight_control_activity")
    if activity is not None:
        quiet &= ~(activity > thresholds["window_control_activity"])
    pressure = np.nan_to_num(blocks.channels["discharge_pressure_bar"])
    zero = quiet & (pressure > regulated)
    if commanded is None:
        return [(WindowKind.ZERO_FLOW, zero)]
    # where nobody recorded what was commanded, nobody knows what flowed
    known = np.isfinite(commanded)
    flowing = known & (np.nan_to_num(commanded) > thresholds["window_commanded_flow_lpm"])
    found = [(WindowKind.ZERO_FLOW, zero & known & ~flowing)]
    # a ground run holds one flow after the other: each level is a stretch of its own
    level = _levels(commanded, flowing, thresholds["window_commanded_flow_lpm"])
    found += [(WindowKind.CONSTANT_FLOW, quiet & (level == k)) for k in range(1, int(level.max(initial=0)) + 1)]
    return found


def _levels(commanded: NDArray[np.float64], flowing: NDArray[np.bool_], step: float) -> NDArray[np.int64]:
    """Number of the level that each block is commanded to, counted from 1 in time order; 0 where nothing is."""
    level = np.zeros(len(commanded), dtype=np.int64)
    count, held = 0, np.nan
    for i in np.flatnonzero(flowing):
        if i == 0 or not flowing[i - 1] or abs(commanded[i] - held) > step:
            count, held = count + 1, commanded[i]
        level[i] = count
    return level


def _cut(
    recording: Recording,
    blocks: _Blocks,
    pump: PumpType,
    thresholds: Mapping[str, float],
    kind: WindowKind,
    first: int,
    end: int,
) -> list[Window]:
    """Cut a quiet stretch into pieces of the shortest length, join steady neighbours while they stay steady."""
    shortest = thresholds["window_minimum_duration_s"]
    n_piece = max(2, round(shortest / blocks.duration))
    if (end - first) * blocks.duration < shortest - 0.5 * blocks.duration:
        if (end - first) * blocks.duration < 0.3 * shortest:
            return []
        reason = f"lasts {(end - first) * blocks.duration:.0f} s; at least {shortest:.0f} s are needed"
        return [_window(recording, blocks, pump, kind, first, end, reason)]
    n_pieces = max(1, (end - first) // n_piece)
    edges = [first + k * n_piece for k in range(n_pieces)] + [end]
    spans: list[tuple[int, int, str | None]] = []
    for a, b in itertools.pairwise(edges):
        why = _unsteady(blocks, pump, thresholds, a, b)
        if spans and (spans[-1][2] is None) == (why is None):
            joined = _unsteady(blocks, pump, thresholds, spans[-1][0], b)
            if (joined is None) == (why is None):
                spans[-1] = (spans[-1][0], b, joined)
                continue
        spans.append((a, b, why))
    return [_window(recording, blocks, pump, kind, a, b, why) for a, b, why in spans]


def _unsteady(blocks: _Blocks, pump: PumpType, thresholds: Mapping[str, float], first: int, end: int) -> str | None:
    """Why blocks ``first`` to ``end`` are not steady, every cause named; None when they are."""
    reasons = []
    for name in REQUIRED_CHANNELS[1:]:
        missing = 1.0 - np.isfinite(blocks.channels[name][first:end]).mean()
        if missing > MOST_MISSING:
            reasons.append(f"{_words(name)} is missing for {100 * missing:.0f} % of the stretch")
    if reasons:
        return "; ".join(reasons)
    speed = _swing(blocks.channels["shaft_speed_rpm"][first:end])
    centre = float(np.nanmedian(blocks.channels["shaft_speed_rpm"][first:end]))
    band = thresholds["window_speed_band_percent"]
    if 100.0 * speed > band * centre:
        reasons.append(f"speed moves by {100.0 * speed / centre:.1f} %; limit {band:g} %")
    drift, limit = (
        _swing(blocks.channels["fluid_temperature_degc"][first:end]),
        thresholds["window_temperature_drift_k"],
    )
    if drift > limit:
        reasons.append(f"temperature drifts {drift:.1f} K over the stretch; limit {limit:.1f} K")
    share = thresholds["window_steady_percent_full_scale"] / 100.0
    for name, sensor in pump.sensors.items():
        if name not in blocks.channels:
            continue
        part = blocks.channels[name][first:end]
        swing, allowed = _swing(part), share * sensor.full_scale_bar
        if swing > allowed + _NOISE_SIGMAS * _error_of_quarters(part):
            reasons.append(f"mean of {_words(name)} varies by {swing:.3f} bar; limit {allowed:.3f} bar")
    return "; ".join(reasons) or None


def _swing(values: NDArray[np.float64]) -> float:
    """Largest difference between the medians of the stretch's quarters: spikes and noise do not count."""
    medians = [float(np.nanmedian(q)) for q in np.array_split(values, _SEGMENTS) if np.isfinite(q).any()]
    return max(medians) - min(medians) if medians else 0.0


def _error_of_quarters(values: NDArray[np.float64]) -> float:
    """One-sigma of the medians of the quarters from the values' own noise: swinging samples are no drifting mean.

    The noise is taken from neighbours, so that neither a drift nor a single step counts as noise.
    """
    steps = np.diff(values[np.isfinite(values)])
    if len(steps) < _FEWEST_FOR_SCATTER:
        return 0.0
    sigma = MAD_TO_SIGMA * float(np.median(np.abs(steps))) / math.sqrt(2.0)
    return MEDIAN_ERROR * sigma / math.sqrt(len(values) / _SEGMENTS)


def _window(
    recording: Recording,
    blocks: _Blocks,
    pump: PumpType,
    kind: WindowKind,
    first: int,
    end: int,
    reason: str | None,
) -> Window:
    start_s = float(blocks.time[first])
    end_s = start_s + (end - first) * blocks.duration
    inside = slice(*np.searchsorted(recording.time_s, (start_s - 1e-9, end_s - 1e-9)))
    means: dict[str, Mean] = {}
    for name in _CHANNELS:
        if name not in recording:
            continue
        sensor = pump.sensors.get(name)
        resolution = sensor.resolution_bar if sensor else 0.0
        mean = mean_with_error(recording[name][inside], resolution)
        if mean is not None:
            means[name] = mean
    end_s = min(end_s, float(recording.time_s[-1]))
    scatter = _scatter(recording["discharge_pressure_bar"][inside])
    return Window(kind, start_s, end_s, reason is None, reason, means, scatter)


def _scatter(samples: NDArray[np.float64]) -> float | None:
    """One-sigma of the samples about a straight line, spikes apart; None for too few, or where all are alike."""
    clean = without_spikes(samples)
    at = np.flatnonzero(np.isfinite(clean))
    if len(at) < _FEWEST_FOR_SCATTER:
        return None
    x = at / len(clean) - 0.5
    off = clean[at] - np.polynomial.polynomial.polyval(x, np.polynomial.polynomial.polyfit(x, clean[at], 1))
    sd = math.sqrt(float(off @ off) / (len(at) - 2))
    return sd if sd > 0.0 else None


def unchanging_channels(recording: Recording, window: Window, names: Sequence[str]) -> tuple[str, ...]:
    """Channels that do not change by a single bit over the window: stuck, or digitised too coarsely."""
    part = recording.between(window.start_s, window.end_s)
    stuck = []
    for name in names:
        known = without_spikes(part[name])
        known = known[np.isfinite(known)]
        if len(known) >= 10 and np.ptp(known) == 0.0:
            stuck.append(name)
    return tuple(stuck)


def _words(name: str) -> str:
    return name.rsplit("_", 1)[0].replace("_", " ")
