"""Channels of one record over time, thinned without losing extremes, with windows and the twin's values."""

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from service.answers.records import ChannelSamples, RecordChannels, TwinValue
from service.errors import Fault, Invalid
from service.reading.queries import windows_of
from service.storage.tables import Record
from twin.recording import TIME, Recording

Samples = NDArray[np.float64]


def record_channels(row: Record, recording: Recording, start_s: float, end_s: float, points: int) -> RecordChannels:
    """Samples of every channel in ``start_s <= time < end_s``, about ``points`` of each, and what the analysis saw there.

    Parameters
    ----------
    row
        A record that is decoded; windows and the twin's values are those stored with it.
    recording
        Its channels, pressures gauge.
    points
        A channel of more samples is shown by the lowest and the highest of each of ``points / 2`` bins of equal time, and
        by its first and last; a bin without a sample is a gap.

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
    windows = [w for w in windows_of(row) if w["start_s"] < end_s and w["end_s"] > start_s]
    zero = (row.reduction or {}).get("zero", {})
    return {
        "record_id": row.id,
        "start_s": float(time[0]),
        "end_s": float(time[-1]),
        "samples": len(time),
        "thinned": edges is not None,
        "channels": [_channel(name, time, part[name], edges) for name in part.channels if name != TIME],
        "windows": windows,
        "twin": [
            _twin_value(channel, window["start_s"], window["end_s"], residual["twin"], zero.get("offset_bar"))
            for window in windows
            for channel, residual in window["residuals"].items()
            if residual["twin"] is not None
        ],
    }


def _twin_value(channel: str, start_s: float, end_s: float, twin: float, zero: float | None) -> TwinValue:
    offset = zero if channel == "case_pressure_bar" and zero is not None else 0.0
    return {"channel": channel, "start_s": start_s, "end_s": end_s, "value": twin, "as_measured": twin + offset}


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


_UNITS = frozenset({"bar", "rpm", "degc", "lpm"})


def _thinned(
    time: Samples, samples: Samples, known: NDArray[np.bool_], edges: NDArray[np.intp]
) -> tuple[list[float], list[float | None]]:
    """Lowest and highest sample of each bin in their order, and null where a bin holds none."""
    low, high = np.where(known, samples, math.inf), np.where(known, samples, -math.inf)
    places: set[int] = {int(i) for i in np.flatnonzero(known)[[0, -1]]} if known.any() else set()
    gaps: dict[int, float] = {}
    borders = np.linspace(time[0], time[-1], len(edges))
    for k, (first, last) in enumerate(pairwise(edges.tolist())):
        if first < last and known[first:last].any():
            places |= {int(first + low[first:last].argmin()), int(first + high[first:last].argmax())}
        else:
            gaps[k] = float(0.5 * (borders[k] + borders[k + 1]))
    points: list[tuple[float, float | None]] = [(float(time[i]), float(samples[i])) for i in places]
    points += [(at, None) for at in gaps.values()]
    points.sort(key=lambda point: point[0])
    return [at for at, _ in points], [value for _, value in points]
