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

from detectors.reduction.conditioning import (
    Gaps,
    bridged_stretches,
    gaps_of,
    shares_lost,
    without_single_spikes,
    words,
)
from detectors.reduction.declared import fitted_channels
from detectors.reduction.statistics import block_means, mean_with_error, warming_rate, without_spikes
from detectors.words.numbers import LOWEST_PRESSURE_SHARE, MAD_TO_SIGMA, MEDIAN_ERROR
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


_SMALLEST_SPIKE = 0.01
"""Smallest spike of a pressure, share of the sensor's full scale (estimate: half of what a window may move by)."""


@dataclass(frozen=True, slots=True)
class _Blocks:
    """Means over blocks of about a second: what steadiness is judged on, whatever the sampling rate.

    ``edges`` has one instant more than there are blocks; ``gaps`` are the lost samples of the required channels.
    """

    edges: NDArray[np.float64]
    duration: float
    channels: Mapping[str, NDArray[np.float64]]
    gaps: Mapping[str, Gaps]


@dataclass(frozen=True, slots=True)
class _Search:
    """What windows are looked for in, and by which limits."""

    recording: Recording
    blocks: _Blocks
    pump: PumpType
    thresholds: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class _Candidate:
    """Blocks in which a kind of window may lie, and those of which nobody knows."""

    kind: WindowKind
    holds: NDArray[np.bool_]
    unknown: NDArray[np.bool_]


def steady_windows(recording: Recording, pump: PumpType, thresholds: Mapping[str, float]) -> tuple[Window, ...]:
    """Zero-flow and constant-flow windows of a conditioned recording in time order, the rejected ones with their reason."""
    if len(recording) < 2:
        return ()
    blocks = _blocks(recording, pump, thresholds["window_minimum_duration_s"])
    search = _Search(recording, blocks, pump, thresholds)
    gaps = tuple(blocks.gaps.values())
    windows: list[Window] = []
    for candidate in _candidates(search):
        for first, end in bridged_stretches(candidate.holds, candidate.unknown, blocks.edges, gaps, blocks.duration):
            windows.extend(_cut(search, candidate.kind, first, end))
    return tuple(sorted(windows, key=lambda w: w.start_s))


def marked_windows(
    recording: Recording,
    pump: PumpType,
    thresholds: Mapping[str, float],
    stretches: Sequence[tuple[float, float]],
) -> list[Window]:
    """Windows that an engineer vouches for: stretches [s] whose medians turn, regulate and hold a known flow."""
    if len(recording) < 2 or not stretches:
        return []
    search = _Search(recording, _blocks(recording, pump, thresholds["window_minimum_duration_s"]), pump, thresholds)
    found = []
    for start_s, end_s in stretches:
        first, end = np.searchsorted(recording.time_s, (start_s, np.nextafter(end_s, np.inf)))
        medians = {n: _median(recording[n][first:end]) for n in fitted_channels(pump)}
        flow = _median(recording["commanded_flow_lpm"][first:end]) if "commanded_flow_lpm" in recording else 0.0
        if not all(math.isfinite(m) for m in (*medians.values(), flow)):
            continue
        if medians["shaft_speed_rpm"] <= LOWEST_SPEED_FRACTION * pump.nominal_speed_rpm:
            continue
        if flow > thresholds["window_commanded_flow_lpm"]:
            found.append(_window(search, WindowKind.CONSTANT_FLOW, slice(int(first), int(end)), None))
        elif medians.get("discharge_pressure_bar", math.inf) > _regulated(pump):
            found.append(_window(search, WindowKind.ZERO_FLOW, slice(int(first), int(end)), None))
    return found


def _median(samples: NDArray[np.float64]) -> float:
    known = samples[np.isfinite(samples)]
    return float(np.median(known)) if len(known) else math.nan


def _blocks(recording: Recording, pump: PumpType, shortest_s: float) -> _Blocks:
    time = recording.time_s
    step = float(np.median(np.diff(time)))
    duration = max(step, min(1.0, shortest_s / 20.0))
    starts = np.empty(0)
    channels = {}
    for name in (n for n in (*_CHANNELS, "flight_control_activity") if n in recording):
        sensor = pump.sensors.get(name)
        samples = recording[name]
        if sensor is not None:
            samples = without_single_spikes(samples, _SMALLEST_SPIKE * sensor.full_scale_bar)
        starts, channels[name] = block_means(time, samples, duration)
    edges = np.append(starts, starts[-1] + duration)
    return _Blocks(edges, duration, channels, {n: gaps_of(time, recording[n]) for n in fitted_channels(pump)})


def _candidates(search: _Search) -> list[_Candidate]:
    """Where the pump turns and nobody touches anything, split by commanded flow where it is known.

    What was not sampled is unknown, neither one nor the other.
    """
    channels, thresholds = search.blocks.channels, search.thresholds
    speed, pressure = channels["shaft_speed_rpm"], channels["discharge_pressure_bar"]
    with np.errstate(invalid="ignore"):
        turning = speed > LOWEST_SPEED_FRACTION * search.pump.nominal_speed_rpm
        unknown = ~np.isfinite(speed)
        quiet = np.ones(len(speed), dtype=np.bool_)
        activity = channels.get("flight_control_activity")
        if activity is not None:
            quiet = ~(activity > thresholds["window_control_activity"])
        high = _regulates(pressure, search.pump, recorded=channels)
    dark = ~np.isfinite(pressure) & ("discharge_pressure_bar" in search.blocks.gaps)
    zero = turning & quiet & high
    zero_unknown = quiet & (unknown | dark) & (turning | unknown) & (high | dark)
    commanded = channels.get("commanded_flow_lpm")
    if commanded is None:
        return [_Candidate(WindowKind.ZERO_FLOW, zero, zero_unknown)]
    # where nobody recorded what was commanded, nobody knows what flowed
    known = np.isfinite(commanded)
    flowing = known & (np.nan_to_num(commanded) > thresholds["window_commanded_flow_lpm"])
    untold = ~known & (zero | zero_unknown)
    found = [_Candidate(WindowKind.ZERO_FLOW, zero & known & ~flowing, (zero_unknown & ~flowing) | untold)]
    # a ground run holds one flow after the other: each level is a stretch of its own
    level = _levels(commanded, flowing, thresholds["window_commanded_flow_lpm"])
    for k in range(1, int(level.max(initial=0)) + 1):
        at = level == k
        lost = ~known | (at & unknown)
        found.append(_Candidate(WindowKind.CONSTANT_FLOW, quiet & at & turning, quiet & lost & (turning | unknown)))
    return found


def _levels(commanded: NDArray[np.float64], flowing: NDArray[np.bool_], step: float) -> NDArray[np.int64]:
    """Number of the level that each block is commanded to, counted from 1 in time order; 0 where nothing is."""
    level = np.zeros(len(commanded), dtype=np.int64)
    count, held, last = 0, np.nan, -1
    for i in map(int, np.flatnonzero(flowing)):
        # what lies between two blocks of one level may be unknown, but not another level or none
        if last < 0 or np.isfinite(commanded[last + 1 : i]).any() or abs(commanded[i] - held) > step:
            count, held = count + 1, commanded[i]
        level[i], last = count, i
    return level


def _regulates(
    pressure: NDArray[np.float64], pump: PumpType, recorded: Mapping[str, NDArray[np.float64]]
) -> NDArray[np.bool_]:
    """Where the compensator regulates; where nobody records the pressure, wherever the controls are known."""
    if "discharge_pressure_bar" in fitted_channels(pump):
        return np.asarray(pressure > _regulated(pump))
    return np.full(len(pressure), "flight_control_activity" in recorded or "commanded_flow_lpm" in recorded)


def _regulated(pump: PumpType) -> float:
    """Discharge pressure above which the compensator regulates [bar]."""
    return pump.limits["zero_flow_pressure_low_bar"].value * LOWEST_PRESSURE_SHARE


def _cut(search: _Search, kind: WindowKind, first: int, end: int) -> list[Window]:
    """Cut a quiet stretch into pieces of the shortest length, join steady neighbours while they stay steady."""
    blocks, shortest = search.blocks, search.thresholds["window_minimum_duration_s"]
    inside = _samples(search, kind, first, end)
    n_piece = max(2, round(shortest / blocks.duration))
    if (end - first) * blocks.duration < shortest - 0.5 * blocks.duration:
        if (end - first) * blocks.duration < 0.3 * shortest:
            return []
        reason = f"lasts {(end - first) * blocks.duration:.0f} s; at least {shortest:.0f} s are needed"
        return [_window(search, kind, inside, reason)]
    n_pieces = max(1, (end - first) // n_piece)
    edges = [first + k * n_piece for k in range(n_pieces)] + [end]
    spans: list[tuple[int, int, str | None]] = []
    for a, b in itertools.pairwise(edges):
        spans.append((a, b, _unsteady(search, a, b)))
        while len(spans) > 1:
            joined = _joined(search, spans)
            if joined is None:
                break
            spans = joined
    cuts = np.searchsorted(search.recording.time_s, [blocks.edges[b] - 1e-9 for _, b, _ in spans[:-1]])
    bounds = [inside.start, *(int(c) for c in cuts), inside.stop]
    return [
        _window(search, kind, slice(a, b), why)
        for (a, b), (_, _, why) in zip(itertools.pairwise(bounds), spans, strict=True)
    ]


def _joined(search: _Search, spans: Sequence[tuple[int, int, str | None]]) -> list[tuple[int, int, str | None]] | None:
    """The last two spans as one where they stay steady, or unsteady, together; None where they stay apart.

    A piece that has lost too much joins steady neighbours as long as all of them together have not.
    """
    *rest, (a, _, before), (_, b, why) = spans
    whole = _unsteady(search, a, b)
    if (before is None) == (why is None):
        return [*rest, (a, b, whole)] if (whole is None) == (why is None) else None
    lost = spans[-1] if before is None else spans[-2]
    if not _lost(search.blocks, lost[0], lost[1]):
        return None
    if whole is None:
        return [*rest, (a, b, None)]
    # the steady stretch before the gap may be long enough for both
    if rest and why is None and rest[-1][2] is None and _unsteady(search, rest[-1][0], b) is None:
        return [*rest[:-1], (rest[-1][0], b, None)]
    return None


def _lost(blocks: _Blocks, first: int, end: int) -> list[str]:
    """Channels of which blocks ``first`` to ``end`` have lost too much, as reasons."""
    start_s, end_s = float(blocks.edges[first]), float(blocks.edges[end])
    return [
        f"{words(name)} is missing for {100 * gaps.lost(start_s, end_s) / (end_s - start_s):.0f} % of the stretch"
        for name, gaps in blocks.gaps.items()
        if gaps.too_many(start_s, end_s) or not np.isfinite(blocks.channels[name][first:end]).any()
    ]


def _unsteady(search: _Search, first: int, end: int) -> str | None:
    """Why blocks ``first`` to ``end`` are not steady, every cause named; None when they are."""
    channels, thresholds = search.blocks.channels, search.thresholds
    reasons = _lost(search.blocks, first, end)
    if reasons:
        return "; ".join(reasons)
    speed = _swing(channels["shaft_speed_rpm"][first:end])
    centre = float(np.nanmedian(channels["shaft_speed_rpm"][first:end]))
    band = thresholds["window_speed_band_percent"]
    if 100.0 * speed > band * centre:
        reasons.append(f"speed moves by {100.0 * speed / centre:.1f} %; limit {band:g} %")
    drift, limit = _swing(channels["fluid_temperature_degc"][first:end]), thresholds["window_temperature_drift_k"]
    if drift > limit:
        reasons.append(f"temperature drifts {drift:.1f} K over the stretch; limit {limit:.1f} K")
    share = thresholds["window_steady_percent_full_scale"] / 100.0
    for name, sensor in search.pump.sensors.items():
        if name not in channels:
            continue
        part = channels[name][first:end]
        swing, allowed = _swing(part), share * sensor.full_scale_bar
        if swing > allowed + _NOISE_SIGMAS * _error_of_quarters(part):
            reasons.append(f"mean of {words(name)} varies by {swing:.3f} bar; limit {allowed:.3f} bar")
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


def _window(search: _Search, kind: WindowKind, inside: slice, reason: str | None) -> Window:
    recording = search.recording
    time = recording.time_s
    start_s = float(time[inside.start])
    end_s = float(time[min(inside.stop, len(time) - 1)])
    means: dict[str, Mean] = {}
    for name in _CHANNELS:
        if name not in recording:
            continue
        sensor = search.pump.sensors.get(name)
        resolution = sensor.resolution_bar if sensor else 0.0
        mean = mean_with_error(recording[name][inside], resolution)
        if mean is not None:
            means[name] = mean
    scatter = _scatter(recording["discharge_pressure_bar"][inside])
    bridged = shares_lost(search.blocks.gaps, start_s, end_s)
    warming = warming_rate(recording, start_s, end_s) if "fluid_temperature_degc" not in search.pump.lacks else None
    return Window(kind, start_s, end_s, reason is None, reason, means, scatter, bridged, warming)


def _samples(search: _Search, kind: WindowKind, first: int, end: int) -> slice:
    """Samples of a stretch of blocks, its bounds found to a sample in the blocks on either side of them."""
    edges, time = search.blocks.edges, search.recording.time_s
    places = [max(first - 1, 0), first + 1, end - 1, min(end + 1, len(edges) - 1)]
    low, start, stop, high = (int(i) for i in np.searchsorted(time, edges[places] - 1e-6 * search.blocks.duration))
    broken_before = np.flatnonzero(~_holds(search, kind, slice(low, start)))
    broken_after = np.flatnonzero(~_holds(search, kind, slice(stop, high)))
    begin = low + int(broken_before[-1]) + 1 if len(broken_before) else low
    finish = stop + int(broken_after[0]) if len(broken_after) else high
    return slice(begin, max(finish, begin + 1)) if begin < len(time) else slice(len(time) - 1, len(time))


def _holds(search: _Search, kind: WindowKind, inside: slice) -> NDArray[np.bool_]:
    """Where single samples turn fast enough, untouched, at a known command; nothing holds where nothing was sampled."""
    recording, thresholds = search.recording, search.thresholds
    with np.errstate(invalid="ignore"):
        holds = recording["shaft_speed_rpm"][inside] > LOWEST_SPEED_FRACTION * search.pump.nominal_speed_rpm
        if "flight_control_activity" in recording:
            holds &= ~(recording["flight_control_activity"][inside] > thresholds["window_control_activity"])
        if kind is WindowKind.ZERO_FLOW:
            holds &= _regulates(recording["discharge_pressure_bar"][inside], search.pump, recorded=recording.channels)
        if "commanded_flow_lpm" in recording:
            commanded, limit = recording["commanded_flow_lpm"][inside], thresholds["window_commanded_flow_lpm"]
            holds &= commanded <= limit if kind is WindowKind.ZERO_FLOW else commanded > limit
    return holds


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
