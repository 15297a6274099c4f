"""A stretch of a recording as a picture shows it: thinned without losing extremes; of long records kept at ingest."""

import json
import zlib
from functools import cache

import numpy as np
from numpy.typing import NDArray
from typing_extensions import TypedDict

from service.answers.records import ChannelSamples
from service.errors import Fault, Invalid
from twin.recording import TIME, Recording
from twin.sources import sources_hash

Samples = NDArray[np.float64]
POINTS = 1000
"""About so many samples of each channel in the copy that is kept: what a first view asks for."""
_LONG = 20_000
"""Values of a record from which on its copy is kept: fewer are decoded faster than anybody notices (our choice)."""
_UNITS = frozenset({"bar", "rpm", "degc", "lpm"})


class Stretch(TypedDict):
    """Samples of every channel over a stretch of a record, times in s from its start, pressures gauge."""

    start_s: float
    end_s: float
    samples: int
    thinned: bool
    channels: list[ChannelSamples]


def stretch_of(recording: Recording, start_s: float, end_s: float, points: int) -> Stretch:
    """Samples of every channel in ``start_s <= time < end_s``, about ``points`` of each.

    A channel of more samples is shown by the lowest and the highest of each of ``points / 2`` bins of equal time, and by
    its first and last; a bin without a sample is a gap.

    Raises
    ------
    Invalid
        when the stretch is empty or holds no sample.
    """
    if not start_s < end_s:
        raise Invalid("the stretch is empty", [Fault("query.to", "is not after from")])
    part = recording.between(start_s, end_s)
    if len(part) == 0:
        first, last = float(recording.time_s[0]), float(recording.time_s[-1])
        fault = Fault("query.from", f"the record goes from {first:g} to {last:g} s")
        raise Invalid("the record has no sample in this stretch", [fault])
    time = part.time_s
    edges = _edges(time, points) if len(time) > points else None
    return {
        "start_s": float(time[0]),
        "end_s": float(time[-1]),
        "samples": len(time),
        "thinned": edges is not None,
        "channels": [_channel(name, time, part[name], edges) for name in part.channels if name != TIME],
    }


def overview_of(recording: Recording) -> bytes | None:
    """The whole recording thinned to ``POINTS``, as it is kept; None where it is short enough to be decoded again."""
    if len(recording) * len(recording.channels) < _LONG:
        return None
    found = stretch_of(recording, -np.inf, np.inf, POINTS)
    return zlib.compress(json.dumps([_sources(), found], allow_nan=False, separators=(",", ":")).encode())


def kept_overview(content: bytes | None) -> Stretch | None:
    """A copy that was kept; None without one, or where other code has made it."""
    if content is None:
        return None
    made_by, found = json.loads(zlib.decompress(content))
    return found if made_by == _sources() else None


@cache
def _sources() -> str:
    return sources_hash(__name__)


def _edges(time: Samples, points: int) -> NDArray[np.intp]:
    """Place of the first sample of each bin of equal time, and the number of samples behind the last one."""
    borders = np.linspace(time[0], time[-1], max(points // 2, 1) + 1)[1:-1]
    return np.concatenate([[0], np.searchsorted(time, borders), [len(time)]])


def _channel(name: str, time: Samples, samples: Samples, edges: NDArray[np.intp] | None) -> ChannelSamples:
    known = np.isfinite(samples)
    if edges is None:
        times, values = time.tolist(), [float(v) if ok else None for v, ok in zip(samples, known, strict=True)]
    else:
        times, values = _thinned(time, samples, known, edges)
    return {
        "channel": name,
        "unit": name.rsplit("_", 1)[1] if name.rsplit("_", 1)[-1] in _UNITS else "-",
        "missing": len(samples) - int(known.sum()),
        "time_s": times,
        "value": values,
    }


def _thinned(
    time: Samples, samples: Samples, known: NDArray[np.bool_], edges: NDArray[np.intp]
) -> tuple[list[float], list[float | None]]:
    """Lowest and highest sample of each bin in their order, and null where a bin holds none."""
    places = np.flatnonzero(known)
    bins = np.searchsorted(edges, places, side="right") - 1
    held, starts = np.unique(bins, return_index=True)
    chosen = places[[0, -1]] if len(places) else places
    if len(places):
        of_bin = np.repeat(np.arange(len(held)), np.diff(np.append(starts, len(places))))
        for extreme in (np.minimum, np.maximum):
            meets = samples[places] == extreme.reduceat(samples[places], starts)[of_bin]
            # the first of those that are equal
            _, first = np.unique(of_bin[meets], return_index=True)
            chosen = np.append(chosen, places[meets][first])
    chosen = np.unique(chosen)
    borders = np.linspace(time[0], time[-1], len(edges))
    empty = np.setdiff1d(np.arange(len(edges) - 1), held)
    points: list[tuple[float, float | None]] = list(zip(time[chosen].tolist(), samples[chosen].tolist(), strict=True))
    points += [(float(0.5 * (borders[k] + borders[k + 1])), None) for k in empty]
    points.sort(key=lambda point: point[0])
    return [at for at, _ in points], [value for _, value in points]
