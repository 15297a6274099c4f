"""Faults of recorders that cost nothing to mend: repeated rows, neighbours out of order, a clock that jumped.

What is mended is said, a sentence each; what would have to be guessed is left to be refused.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from service.ingest.instants import spread
from service.ingest.raw import RawRecord, Samples
from twin.recording import OPTIONAL_CHANNELS, TIME

_FARTHEST_NEIGHBOUR = 8
"""Rows by which a row may stand out of order (estimate: a recorder's buffer; what is farther off is a clock)."""
_MOST_JUMPS = 3
"""Times that a clock may be set back in one record (estimate: more is no clock)."""
_UNEVEN_IN_STEPS = 0.35
"""Mean departure from the usual step from which rows are two stretches laid on each other (these depart by a half, rows
whose stamps jitter by a fifth of a step by an eighth)."""
_MOST_UNTIMED = 0.05
"""Share of rows whose time may be missing and is taken from their neighbours (estimate: far from guessing)."""
_COARSE_SHARE = 0.45
"""Share of repeated instants from which the clock is too coarse for its rows, and not the rows repeated: two to an instant are
half of them."""


def repaired(raw: RawRecord) -> RawRecord:
    """The record in order of time, each instant once, with a flag for everything that was mended.

    Rows are only moved where their times say where to. A clock that was set back goes on from where it was, by its usual
    step; a single stamp far off and a record that starts over are left to be refused. Optional channels without a single
    number are left out: an empty column is a sensor that is not there.
    """
    flags = list(raw.flags)
    channels = dict(raw.channels)
    for name in OPTIONAL_CHANNELS:
        if name in channels and np.isnan(channels[name]).all():
            del channels[name]
            flags.append(f"{name} holds no number at all: taken as not recorded")
    time = channels.get(TIME)
    if time is not None and len(time) > 1 and all(len(c) == len(time) for c in channels.values()):
        channels[TIME] = _timed(time, flags)
        channels = _in_order(channels, flags)
        channels = _once(channels, flags)
    return replace(raw, channels=channels, flags=flags)


def _timed(time: Samples, flags: list[str]) -> Samples:
    """Single missing times from their neighbours'."""
    known = np.isfinite(time)
    n = int((~known).sum())
    if n == 0 or np.isinf(time).any() or n > max(1.0, _MOST_UNTIMED * len(time)):
        return time
    index = np.arange(len(time))
    filled = np.interp(index, index[known], time[known])
    # before the first and beyond the last known time rows stand by the usual step
    first, last = np.flatnonzero(known)[[0, -1]]
    step = _step(time[known])
    filled[:first] = time[first] - step * np.arange(first, 0, -1)
    filled[last + 1 :] = time[last] + step * np.arange(1, len(time) - last)
    flags.append(f"{_rows(n)} without a time: taken from the neighbours")
    return filled


def _in_order(channels: dict[str, Samples], flags: list[str]) -> dict[str, Samples]:
    time = channels[TIME]
    if not np.isfinite(time).all() or (np.diff(time) >= 0.0).all():
        return channels
    order = np.argsort(time, kind="stable")
    copies = order[1:][_alike(channels, order[:-1], order[1:])]
    if len(copies):
        kept = np.ones(len(time), dtype=np.bool_)
        kept[copies] = False
        flags.append(f"{_rows(len(copies))} sent again: left out")
        return _in_order({name: samples[kept] for name, samples in channels.items()}, flags)
    back = np.flatnonzero(np.diff(time) < 0.0)
    moved = np.abs(order - np.arange(len(time)))
    step = _step(time)
    # a clock that was set back says the same stretch twice: its rows, in order, come at uneven steps
    between = np.diff(time[order])[(moved[1:] > 0) | (moved[:-1] > 0)]
    uneven = float(np.mean(np.abs(between - step))) > _UNEVEN_IN_STEPS * step
    if moved.max() <= _FARTHEST_NEIGHBOUR and not (uneven and len(back) <= _MOST_JUMPS):
        flags.append(f"{_rows(int((moved > 0).sum()))} out of order: put in order of time")
        return {name: samples[order] for name, samples in channels.items()}
    # one stamp that is off, and a second recording behind the first, are not a clock that was set back: refused
    returns = time[np.minimum(back + 2, len(time) - 1)] > time[back]
    if len(back) > _MOST_JUMPS or returns.any() or (time[back + 1] <= time[0] + 0.5 * step).any():
        return channels
    mended = time.copy()
    for i in back:
        jump = float(mended[i] + step - mended[i + 1])
        flags.append(
            f"the clock was set back by {jump - step:.4g} s after {mended[i]:.6g} s: taken to go on from there"
        )
        mended[i + 1 :] += jump
    return {**channels, TIME: mended}


def _alike(channels: dict[str, Samples], one: NDArray[np.intp], other: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Where two rows say the same, time and all."""
    same = np.ones(len(one), dtype=np.bool_)
    for samples in channels.values():
        a, b = samples[one], samples[other]
        same &= (a == b) | (np.isnan(a) & np.isnan(b))
    return same


def _once(channels: dict[str, Samples], flags: list[str]) -> dict[str, Samples]:
    """Every instant once: rows that repeat one are left out, rows that a coarse clock throws together are spread."""
    time = channels[TIME]
    if not np.isfinite(time).all():
        return channels
    again = np.flatnonzero(np.diff(time) == 0.0) + 1
    if len(again) == 0 or (np.diff(time) < 0.0).any():
        return channels
    same = np.ones(len(again), dtype=np.bool_)
    for name, samples in channels.items():
        if name != TIME:
            a, b = samples[again], samples[again - 1]
            same &= (a == b) | np.isnan(a) | np.isnan(b)
    if len(again) > _COARSE_SHARE * len(time) and same.mean() < _COARSE_SHARE:
        flags.append("the clock is coarser than the rows: rows of one instant spread evenly up to the next")
        return {**channels, TIME: spread(time)}
    first = np.concatenate(([True], np.diff(time) > 0.0))
    starts = np.flatnonzero(first)
    kept = {name: samples[first] for name, samples in channels.items()}
    for name, samples in kept.items():
        # a row that repeats another may hold what that one lacks
        for place in np.flatnonzero(np.isnan(samples)):
            end = starts[place + 1] if place + 1 < len(starts) else len(time)
            known = channels[name][starts[place] : end]
            known = known[np.isfinite(known)]
            if len(known):
                samples[place] = known[0]
    differing = int((~same).sum())
    words = f", {_rows(differing)} of them with other samples" if differing else ""
    flags.append(f"{_rows(len(again))} at an instant that another row has{words}: left out")
    return kept


def _step(time: Samples) -> float:
    steps = np.diff(time)
    forward = steps[steps > 0.0]
    return float(np.median(forward)) if len(forward) else 1.0


def _rows(n: int) -> str:
    return f"{n} row{'s' if n != 1 else ''}"
