"""Spectrum of one channel of one record: power spectral density and the orders of the shaft."""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

from detectors.reduction.conditioning import beyond_share, conditioned
from detectors.words.numbers import MOST_MISSING
from service.answers.records import ChannelSpectrum, ShaftOrder
from service.errors import Fault, Invalid
from twin.parameters import PumpType
from twin.recording import TIME, Recording

Samples = NDArray[np.float64]
_SAMPLES_PER_PERIOD = 2.2
"""Samples that a period needs at least: two and a margin for the steepness of any anti-alias filter."""
_LEAST_SAMPLES = 64
"""Shortest segment: 32 frequencies, the fewest that make a picture (our choice)."""
_LEAST_REVOLUTIONS = 10.0
"""Revolutions that tell order 1 from its neighbours by a tenth of an order."""
_LONGEST_SEGMENT = 8192
"""Samples of a segment: about 1 Hz at 10 kHz, as fine as anybody looks (our choice)."""
_LONGEST_STEP = 1.5
"""Step over the median one from which samples are missing: half a step of jitter is none."""
_LONGEST_HOLE = 8.5
"""Steps that rows lost one by one may leave open: one in five at random hardly ever leaves more."""
_SLOWEST_RPM = 60.0
"""Speed below which the shaft stands (our choice: about 1 % of the H225's pump)."""


def channel_spectrum(
    recording: Recording, channel: str, pump: PumpType, start_s: float, end_s: float
) -> ChannelSpectrum:
    """Density (Welch) and orders 1, n and 2 n of one channel in ``start_s <= time < end_s``.

    Orders are a least-squares fit on the shaft's angle, the integral of the speed channel, so that a drifting speed
    does not smear them. There is no mark on the shaft: phases count from the start of the stretch.

    Parameters
    ----------
    recording
        Pressures gauge; of its longest stretch without a gap is made use.
    channel
        Name of the channel.
    pump
        Its number of pistons is the order n.

    Raises
    ------
    Invalid
        when there is no such channel, or the stretch is too short, too slowly sampled, full of holes, or at rest.
    """
    stretch = _stretch(conditioned(recording, pump), channel, start_s, end_s)
    time, samples, speed = stretch.time, stretch.samples, stretch.speed
    rate = 1.0 / float(np.median(np.diff(time)))
    shaft_hz = float(np.mean(speed)) / 60.0
    _check(time, rate, shaft_hz)
    # a density needs even instants, a fit takes what is there: what was drawn between would flatten the lines
    known = np.isfinite(samples)
    unit = channel.rsplit("_", 1)[1] if "_" in channel else ""
    length = min(_LONGEST_SEGMENT, max(_LEAST_SAMPLES, 2 ** int(math.log2(max(len(samples) // 4, 2)))))
    even = np.arange(time[0], time[-1] + 0.5 / rate, 1.0 / rate) if stretch.has_holes else time
    filled = np.interp(even, time[known], samples[known])
    frequency, density = welch(filled, fs=rate, nperseg=min(length, len(filled)), detrend="constant")
    return {
        "channel": channel,
        "start_s": float(time[0]),
        "end_s": float(time[-1]),
        "sample_rate_hz": rate,
        "shaft_speed_rpm": 60.0 * shaft_hz,
        "density": {
            "unit": f"{unit}^2/Hz",
            "frequency_hz": frequency.tolist(),
            "value": density.tolist(),
        },
        "orders": _orders(time[known], samples[known], speed[known], rate, shaft_hz, int(pump.pump.piston.n), unit),
    }


class _Stretch(NamedTuple):
    """Time, samples (NaN where missing) and speed of a stretch; ``has_holes`` where rows are lost inside it."""

    time: Samples
    samples: Samples
    speed: Samples
    has_holes: bool


def _stretch(recording: Recording, channel: str, start_s: float, end_s: float) -> _Stretch:
    """The longest uninterrupted part of a stretch."""
    known = [name for name in recording.channels if name != TIME]
    if channel not in known:
        raise Invalid(
            f"the record has no channel {channel!r}", [Fault("query.channel", f"is not one of {', '.join(known)}")]
        )
    inside = (recording.time_s >= start_s) & (recording.time_s < end_s)
    time = recording.time_s[inside]
    if len(time) < _LEAST_SAMPLES:
        raise _too_short(f"has {len(time)} samples, at least {_LEAST_SAMPLES} are needed")
    steps = np.diff(time)
    step = float(np.median(steps))
    lost = float((steps[steps > _LONGEST_STEP * step] - step).sum())
    # single rows that are lost are bridged like single samples; a gap parts the stretch
    is_bridged = not beyond_share(lost / float(time[-1] - time[0]), len(time))
    longest = _LONGEST_HOLE if is_bridged else _LONGEST_STEP
    breaks = np.flatnonzero(steps > longest * step) + 1
    edges = [0, *breaks.tolist(), len(time)]
    first, last = max(pairwise(edges), key=lambda pair: pair[1] - pair[0])
    part = slice(first, last)
    if last - first < _LEAST_SAMPLES:
        raise _too_short(f"has gaps: its longest part has {last - first} samples, at least {_LEAST_SAMPLES} are needed")
    samples, speed = (recording[name][inside][part] for name in (channel, "shaft_speed_rpm"))
    for name, values in ((channel, samples), ("shaft_speed_rpm", speed)):
        _check_missing(values, name)
    given = np.isfinite(speed)
    even_speed = np.interp(time[part], time[part][given], speed[given])
    return _Stretch(time[part], samples, even_speed, has_holes=lost > 0.0 and is_bridged)


def _check_missing(samples: Samples, name: str) -> None:
    missing = 1.0 - float(np.isfinite(samples).mean())
    if beyond_share(missing, len(samples)):
        raise Invalid(
            f"{100 * missing:.0f} % of {name} are missing in this stretch",
            [Fault(f"channels.{name}", f"more than {100 * MOST_MISSING:.0f} % are missing")],
        )


def _check(time: Samples, rate: float, shaft_hz: float) -> None:
    if shaft_hz * 60.0 < _SLOWEST_RPM:
        fault = Fault("channels.shaft_speed_rpm", f"is {60.0 * shaft_hz:.3g} in the middle")
        raise Invalid("the shaft does not turn in this stretch: choose another with start_s and end_s", [fault])
    if rate < _SAMPLES_PER_PERIOD * shaft_hz:
        fault = Fault(f"channels.{TIME}", f"is sampled at {rate:.4g} Hz")
        raise Invalid(
            f"the record is sampled too slowly: {rate:.4g} Hz show up to {rate / 2:.4g} Hz, and the shaft turns "
            f"at {shaft_hz:.4g} Hz: record with at least {math.ceil(_SAMPLES_PER_PERIOD * shaft_hz)} Hz",
            [fault],
        )
    if float(time[-1] - time[0]) * shaft_hz < _LEAST_REVOLUTIONS:
        raise _too_short(f"holds fewer than {_LEAST_REVOLUTIONS:g} revolutions")


def _too_short(what: str) -> Invalid:
    return Invalid(f"the stretch {what}", [Fault(f"channels.{TIME}", what)])


def _orders(
    time: Samples, samples: Samples, speed: Samples, rate: float, shaft_hz: float, n: int, unit: str
) -> list[ShaftOrder]:
    """Amplitude, its standard error and phase of each order; those above the sampling's reach say so."""
    steps = 0.5 * (speed[1:] + speed[:-1]) * np.diff(time) * (2.0 * math.pi / 60.0)
    angle = np.concatenate(([0.0], np.cumsum(steps)))
    wanted = (1, n, 2 * n)
    seen = [order for order in wanted if rate >= _SAMPLES_PER_PERIOD * order * shaft_hz]
    s = np.linspace(-1.0, 1.0, len(time))
    columns = [np.ones_like(s), s, *(f(order * angle) for order in seen for f in (np.cos, np.sin))]
    design = np.stack(columns, axis=1)
    fit, *_ = np.linalg.lstsq(design, samples, rcond=None)
    error = float(np.std(samples - design @ fit)) * math.sqrt(2.0 / len(samples))
    lines: list[ShaftOrder] = []
    for order in wanted:
        if order in seen:
            i = 2 + 2 * seen.index(order)
            cosine, sine = float(fit[i]), float(fit[i + 1])
            line: ShaftOrder = {
                "order": order,
                "frequency_hz": order * shaft_hz,
                "unit": unit,
                "amplitude": math.hypot(cosine, sine),
                "standard_error": error,
                "phase_deg": math.degrees(math.atan2(-sine, cosine)),
                "reason": None,
            }
        else:
            reason = (
                f"{rate:.4g} Hz are too slow for it: {math.ceil(_SAMPLES_PER_PERIOD * order * shaft_hz)} Hz show it"
            )
            line = {
                "order": order,
                "frequency_hz": order * shaft_hz,
                "unit": unit,
                "amplitude": None,
                "standard_error": None,
                "phase_deg": None,
                "reason": reason,
            }
        lines.append(line)
    return lines
