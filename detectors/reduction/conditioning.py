"""A recording made ready for reduction: single spikes out, slow channels held or interpolated, what is lost counted.

Everything here goes by time and never by sample, so that jitter, lost rows and channels of unequal rates change nothing
but what they cost.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from detectors.reduction.statistics import SPIKE_SIGMAS
from detectors.words.numbers import MAD_TO_SIGMA, MOST_MISSING
from twin.parameters import PumpType
from twin.recording import Recording

Samples = NDArray[np.float64]
Mask = NDArray[np.bool_]

LONGEST_AGE_S: Mapping[str, float] = {
    "shaft_speed_rpm": 10.0,
    "flight_control_activity": 10.0,
    "commanded_flow_lpm": 10.0,
    "fluid_temperature_degc": 60.0,
    "reservoir_pressure_bar": 60.0,
}
"""How far apart two samples of a condition may lie for the time between them to count as known [s] (estimates: a rotor and
a pair of hands take seconds to change anything, a tank of fluid minutes). Pressures that are judged are never made up."""
_HELD = ("flight_control_activity", "commanded_flow_lpm")
"""Conditions that change in steps: a sample stands until the next one."""
_RESERVOIR = "reservoir_pressure_bar"
_FEWEST_KNOWN = 3
"""Samples of a reservoir pressure that say anything about the rest of the record (estimate)."""
_WORTH_A_WORD_S = 10.0
"""Lost time of the reservoir pressure that the record tells of [s]: as long as the shortest pump-off stretch."""
_AGE_IN_STEPS = 2.5
"""Steps of a slow record that one lost sample may open up, jitter included."""
_GAP_IN_STEPS = 1.5
"""Own intervals of a channel from which the time between two samples holds a lost one; jitter stays below."""
_SHORTEST_GAP_S = 0.6
"""Time without a sample that loses nothing (estimate: stamps that are 0.2 s off either way open it up at 5 Hz)."""
_LONG_GAP_IN_STEPS = 3.5
"""Own intervals from which a gap is one thing, not samples that happened to be lost in a row."""
_SPIKE_WIDTH = 5
"""Samples of a running median: it sees past two false neighbours."""
_SMALLEST_SPIKE = {"shaft_speed_rpm": 0.01, "fluid_temperature_degc": 1.0}
"""Smallest spike: share of the nominal speed, K (estimates: half of what a window may move by)."""
_SIGMAS_OF_SHARE = 3.0
"""Errors of a counted share: samples that are lost at random, one in five, are not always one in five."""


@dataclass(frozen=True, slots=True)
class Gaps:
    """Where one channel has lost samples: ``starts`` and ``ends`` of the gaps [s], shape (k,), at its own ``step`` [s]."""

    starts: Samples
    ends: Samples
    step: float

    def lost(self, start_s: float, end_s: float) -> float:
        """Time without a sample between two instants [s]."""
        return float(self._inside(start_s, end_s).sum())

    def too_many(self, start_s: float, end_s: float) -> bool:
        """True where more is lost than the stated share: single samples but for the scatter of a random share."""
        whole = end_s - start_s
        inside = self._inside(start_s, end_s)
        lost = float(inside.sum())
        if whole <= 0.0 or lost <= MOST_MISSING * whole:
            return False
        in_long_gaps = float(inside[self.ends - self.starts > _LONG_GAP_IN_STEPS * self.step].sum())
        return in_long_gaps > MOST_MISSING * whole or beyond_share(lost / whole, whole / self.step)

    def _inside(self, start_s: float, end_s: float) -> Samples:
        inside: Samples = np.maximum(np.minimum(self.ends, end_s) - np.maximum(self.starts, start_s), 0.0)
        return inside


def beyond_share(lost: float, n: float) -> bool:
    """Whether a lost share is above the stated one, but for the scatter of a share at random among ``n`` samples."""
    return lost > MOST_MISSING + _SIGMAS_OF_SHARE * math.sqrt(MOST_MISSING * (1.0 - MOST_MISSING) / n)


def conditioned(recording: Recording, pump: PumpType) -> Recording:
    """The recording with its conditions known between their samples.

    Single spikes of speed and temperature are taken out; speed, temperature and reservoir pressure are interpolated,
    control activity and commanded flow are held, each up to ``LONGEST_AGE_S`` (and 2.5 steps of a slow record). Samples
    that are there stay as they are, bit for bit; the judged pressures and flows are left alone. The reservoir pressure is
    known throughout or not at all.
    """
    if len(recording) < 2:
        return recording
    time = recording.time_s
    slow = _AGE_IN_STEPS * float(np.median(np.diff(time)))
    channels = dict(recording.channels)
    for name, age in LONGEST_AGE_S.items():
        if name not in channels:
            continue
        samples = channels[name]
        if name in _SMALLEST_SPIKE:
            smallest = _SMALLEST_SPIKE[name] * (pump.nominal_speed_rpm if name == "shaft_speed_rpm" else 1.0)
            samples = without_single_spikes(samples, smallest)
        channels[name] = _known_between(time, samples, max(age, slow), held=name in _HELD)
    flags = recording.flags
    if _RESERVOIR in channels:
        measured = int(np.isfinite(recording[_RESERVOIR]).sum())
        flags = (*flags, *_reservoir_throughout(time, channels, measured))
    return Recording(channels, recording.attributes, flags)


def _reservoir_throughout(time: Samples, channels: dict[str, Samples], measured: int) -> list[str]:
    """Give the reservoir pressure a value at every instant, or take the channel away; says which, where it matters.

    Zero and windows are differences to it: measured in one and nominal in the other, it would be taken for the pump's.
    """
    samples = channels[_RESERVOIR]
    known = np.isfinite(samples)
    if known.all():
        return []
    if measured < _FEWEST_KNOWN:
        del channels[_RESERVOIR]
        return []
    lost = gaps_of(time, samples).lost(float(time[0]), float(time[-1]))
    channels[_RESERVOIR] = np.where(known, samples, np.interp(time, time[known], samples[known]))
    if lost < _WORTH_A_WORD_S:
        return []
    return [
        f"reservoir pressure is missing for {lost:.3g} of {time[-1] - time[0]:.3g} s: taken from its nearest samples"
    ]


def without_single_spikes(samples: Samples, smallest: float) -> Samples:
    """Samples, shape (n,), with NaN where one or two stand out of their neighbours by 6 sigma and by ``smallest``."""
    known = np.flatnonzero(np.isfinite(samples))
    if len(known) < _SPIKE_WIDTH:
        return samples
    x = samples[known]
    off = np.abs(x - median_filter(x, _SPIKE_WIDTH, mode="nearest"))
    noise = MAD_TO_SIGMA * float(np.median(np.abs(np.diff(x)))) / math.sqrt(2.0)
    spikes = off > max(smallest, SPIKE_SIGMAS * noise)
    # runs of three and more are no spikes: the running median has lost its way there
    spikes &= ~_in_long_runs(spikes)
    if not spikes.any():
        return samples
    clean = samples.copy()
    clean[known[spikes]] = np.nan
    return clean


def _in_long_runs(mask: Mask) -> Mask:
    found = np.zeros(len(mask), dtype=np.bool_)
    for first, end in stretches(mask):
        if end - first > _SPIKE_WIDTH // 2:
            found[first:end] = True
    return found


def _known_between(time: Samples, samples: Samples, age: float, *, held: bool) -> Samples:
    known = np.isfinite(samples)
    if known.all() or not known.any():
        return samples
    t, x = time[known], samples[known]
    step = float(np.median(np.diff(t))) if len(t) > 1 else age
    empty = np.flatnonzero(~known)
    at = time[empty]
    after = np.searchsorted(t, at)
    before = np.maximum(after - 1, 0)
    inside = (after > 0) & (after < len(t))
    between = t[np.minimum(after, len(t) - 1)] - t[before]
    # before the first and after the last sample a value stands for one more of its own intervals
    reach = np.where(after == 0, t[0] - at, at - t[-1])
    usable = np.where(inside, between <= age * (1.0 + 1e-9), reach <= min(step, age) * (1.0 + 1e-9))
    values = x[before] if held else np.interp(at, t, x)
    filled = samples.copy()
    filled[empty[usable]] = values[usable]
    return filled


def gaps_of(time: Samples, samples: Samples) -> Gaps:
    """Gaps of a channel against its own median interval; both shapes (n,), NaN where nothing was sampled."""
    t = time[np.isfinite(samples)]
    if len(t) < 2:
        whole = (time[:1], time[-1:]) if len(time) else (time, time)
        return Gaps(whole[0], whole[1], float(time[-1] - time[0]) if len(time) else 0.0)
    # ends of the record count: what is missing there is missing
    edges = np.concatenate(([time[0]], t, [time[-1]]))
    steps = np.diff(edges)
    step = float(np.median(steps[1:-1]))
    wide = np.flatnonzero(steps > max(_GAP_IN_STEPS * step, _SHORTEST_GAP_S))
    inner = (wide > 0) & (wide < len(steps) - 1)
    half = np.where(inner, 0.5 * step, 0.0)
    return Gaps(edges[wide] + half, edges[wide + 1] - half, step)


def stretches(mask: Mask) -> list[tuple[int, int]]:
    """Runs of True in ``mask``, shape (n,), as (first, one past the last) pairs in order."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], mask, [False])).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def bridged_stretches(
    mask: Mask, unknown: Mask, places: Samples, gaps: Sequence[Gaps], shortest_gap_s: float
) -> list[tuple[int, int]]:
    """Runs of True with the unknown between them bridged as long as no channel has lost more than the stated share.

    Parameters
    ----------
    mask, unknown
        What holds and what nobody knows, shape (n,) each.
    places
        Instant at which each place begins and the last one ends [s], shape (n + 1,).
    gaps
        Lost samples of the channels that decide.
    shortest_gap_s
        Unknown runs shorter than this are jitter and part nothing [s].
    """
    todo = []
    for first, end in stretches(mask | unknown):
        inside = np.flatnonzero(mask[first:end])
        if len(inside):
            todo.append((first + int(inside[0]), first + int(inside[-1]) + 1))
    found = []
    while todo:
        first, end = todo.pop()
        holes = [(a + first, b + first) for a, b in stretches(unknown[first:end] & ~mask[first:end])]
        long = [(a, b) for a, b in holes if places[b] - places[a] >= shortest_gap_s]
        if not long or not any(g.too_many(float(places[first]), float(places[end])) for g in gaps):
            found.append((first, end))
            continue
        a, b = max(long, key=lambda hole: places[hole[1]] - places[hole[0]])
        todo += [(first, a), (b, end)]
    return sorted(found)


def shares_lost(gaps: Mapping[str, Gaps], start_s: float, end_s: float) -> str | None:
    """What a stretch has lost and to what: ``3 of 120 s bridged: case pressure``; None where nothing is."""
    lost = {name: g.lost(start_s, end_s) for name, g in gaps.items()}
    most = max(lost.values(), default=0.0)
    if most <= 0.0:
        return None
    named = ", ".join(words(name) for name, seconds in lost.items() if seconds > 0.0)
    return f"{most:.3g} of {end_s - start_s:.3g} s bridged: {named}"


def words(name: str) -> str:
    """A channel's name without its unit."""
    return name.rsplit("_", 1)[0].replace("_", " ")
