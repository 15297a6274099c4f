"""Samples of several clocks on one base of time: each at the nearest instant, none moved far, none invented."""

import numpy as np
from numpy.typing import NDArray

from service.ingest.raw import Samples

_NEAR = 0.75
"""Share of a period within which a sample of a clock as fast as ours has an instant near, for all its jitter."""
_AS_DENSE = 1.5
"""Our step in periods of another clock up to which each of its samples has an instant of its own among ours."""
_FARTHEST_S = 1.0
"""Nothing is moved by more than this, but for a base that is slower itself."""


class Base:
    """Times of a record [s]: one clock as it is, and instants of others where that has no sample near."""

    def __init__(self, times: Samples, period_s: float) -> None:
        self.times = times
        self._period_s = period_s
        self._own = np.ones(len(times), dtype=bool)
        self._sorted: tuple[NDArray[np.intp], Samples] | None = None

    def __len__(self) -> int:
        return len(self.times)

    def lengthen(self, times: Samples, period_s: float) -> None:
        """Take in those times of another clock that no instant is near to; of a faster clock one in each of our periods."""
        times = np.sort(times[np.isfinite(times)])
        extra = times[~self._places_near(times, period_s)[1]]
        if not len(extra):
            return
        if period_s < self._period_s < np.inf:
            steps = np.floor((extra - extra[0]) / self._period_s)
            extra = extra[np.concatenate(([True], np.diff(steps) > 0.0))]
        # the base keeps its own order, whatever that is: who repairs a record must see it
        so_far = np.fmax.accumulate(self.times) if len(self.times) else self.times
        places = np.searchsorted(so_far, extra)
        self.times = np.insert(self.times, places, extra)
        self._own = np.insert(self._own, places, False)
        self._sorted = None

    def own(self, samples: Samples) -> Samples:
        """Samples of the base's own clock: the same array where the base is that clock and nothing else."""
        if self._own.all():
            return samples
        spread = np.full(len(self.times), np.nan)
        spread[self._own] = samples
        return spread

    def nearest(self, times: Samples, period_s: float) -> "Places":
        """Where samples of another clock go."""
        index, near, distance = self._places_near(times, period_s)
        # the last that is written to an instant stays: the nearest one
        order = np.argsort(-distance[near], kind="stable")
        return Places(np.flatnonzero(near)[order], index[near][order], len(self.times))

    def _places_near(self, times: Samples, period_s: float) -> tuple[NDArray[np.intp], NDArray[np.bool_], Samples]:
        """Index of the nearest instant, whether it is near, and how far it is [s], shape of ``times`` each.

        Near is what one of our own steps spans, and where we are no sparser than the other clock is, half of its steps:
        two clocks of one rate share their instants, but nothing is drawn to the edge of a gap.
        """
        if self._sorted is None:
            order = np.argsort(self.times, kind="stable")
            order = order[np.isfinite(self.times[order])]
            self._sorted = order, self.times[order]
        order, known = self._sorted
        if not len(known):
            return np.zeros(len(times), np.intp), np.zeros(len(times), bool), np.full(len(times), np.inf)
        after = np.searchsorted(known, times)
        inside = (after > 0) & (after < len(known))
        after = np.clip(after, 0, len(known) - 1)
        before = np.maximum(after - 1, 0)
        with np.errstate(invalid="ignore"):
            place = np.where(np.abs(times - known[before]) <= np.abs(known[after] - times), before, after)
            distance = np.abs(known[place] - times)
            near = distance <= self._reach_s
            as_dense = inside & (known[after] - known[before] <= _AS_DENSE * period_s)
            near |= as_dense & (distance <= min(_NEAR * period_s, _FARTHEST_S))
        return order[place], near & np.isfinite(times), distance

    @property
    def _reach_s(self) -> float:
        return _NEAR * self._period_s if np.isfinite(self._period_s) else 0.0


class Places:
    """Which samples of a clock go to which instants of a base."""

    def __init__(self, taken: NDArray[np.intp], to: NDArray[np.intp], length: int) -> None:
        self._taken, self._to, self._length = taken, to, length

    def spread(self, samples: Samples) -> tuple[Samples, int]:
        """Samples at their instants, NaN elsewhere, and how many of those that are numbers found no place."""
        spread = np.full(self._length, np.nan)
        there = np.isfinite(samples[self._taken])
        spread[self._to[there]] = samples[self._taken[there]]
        return spread, int(np.isfinite(samples).sum() - np.isfinite(spread).sum())
