"""Checks of the channels: every fault with its place; units that cannot be right by their medians, not by spikes."""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from service.errors import Fault
from service.ingest.raw import MOST_FAULTS_OF_A_KIND, RawRecord, capped
from service.ingest.scales import scale_faults
from twin.parameters import PumpType
from twin.recording import OPTIONAL_CHANNELS, REQUIRED_CHANNELS, TIME

Samples = NDArray[np.float64]

SHORTEST = 2
LONGEST_S = 48.0 * 3600.0
"""A record is one flight or one ground run; what spans more has a clock that jumped, and would cost room for every second
of the jump."""
_STRETCHES = 10
_SHORTEST_STRETCH = 10
_LARGEST_RATE_CHANGE = 3.0
# medians outside these cannot be what the name says; generous, so that a broken sensor is not taken for a unit
_LIMITS: dict[str, tuple[float, float]] = {
    "fluid_temperature_degc": (-60.0, 180.0),
    "reservoir_pressure_bar": (-1.1, 20.0),
    "case_pressure_bar": (-1.1, 50.0),
    "discharge_pressure_bar": (-1.1, 700.0),
    "shaft_speed_rpm": (-100.0, 20_000.0),
    "case_flow_lpm": (-5.0, 100.0),
    "discharge_flow_lpm": (-5.0, 200.0),
    "commanded_flow_lpm": (-5.0, 200.0),
}


def channel_faults(
    raw: RawRecord, pump: PumpType, full_scales: Mapping[str, float] | None = MappingProxyType({})
) -> list[Fault]:
    """Every fault of the channels: missing, empty, unequal, unordered, in a wrong unit.

    ``full_scales`` are those [bar] of the aircraft's own sensors by channel; None asks nothing of units: what has been
    taken once is read as it is for ever.
    """
    needed = [n for n in REQUIRED_CHANNELS if n not in pump.lacks]
    faults = [Fault(f"channels.{n}", "is missing") for n in needed if n not in raw.channels]
    known = [n for n in (*REQUIRED_CHANNELS, *OPTIONAL_CHANNELS) if n in raw.channels]
    lengths = {n: len(raw.channels[n]) for n in raw.channels}
    if len(set(lengths.values())) > 1:
        usual = lengths.get(TIME, max(lengths.values()))
        faults += [
            Fault(f"channels.{n}", f"has {k} samples, {TIME if TIME in lengths else 'another channel'} has {usual}")
            for n, k in lengths.items()
            if k != usual
        ]
    if TIME in raw.channels:
        time = raw.channels[TIME]
        found = _time_faults(time)
        pressure = raw.channels.get("discharge_pressure_bar")
        if not found and pressure is not None and len(pressure) == len(time):
            found = _sampling_faults(time, pressure)
        faults += found
    for name in known:
        samples = raw.channels[name]
        if name == TIME or len(samples) == 0:
            continue
        if np.isinf(samples).any():
            faults.append(Fault(f"channels.{name}[{int(np.argmax(np.isinf(samples)))}]", "is infinite"))
        if np.isnan(samples).all():
            faults.append(Fault(f"channels.{name}", "holds no number at all"))
    if full_scales is None:
        return faults
    return faults + unit_faults({n: raw.channels[n] for n in known}, pump, full_scales)


def _time_faults(time: Samples) -> list[Fault]:
    if len(time) < SHORTEST:
        return [Fault(f"channels.{TIME}", f"has {len(time)} samples; at least {SHORTEST} are needed")]
    faults = []
    if not np.isfinite(time).all():
        places = np.flatnonzero(~np.isfinite(time))
        faults.append(Fault(f"channels.{TIME}[{int(places[0])}]", f"is not a number ({len(places)} such samples)"))
    steps = np.flatnonzero(np.diff(time) <= 0.0)
    backwards = [
        Fault(f"channels.{TIME}[{int(i) + 1}]", f"does not increase: {time[i + 1]:g} s after {time[i]:g} s")
        for i in steps[:MOST_FAULTS_OF_A_KIND]
    ]
    faults += capped(backwards, len(steps) - MOST_FAULTS_OF_A_KIND, "steps back in time", f"channels.{TIME}")
    if not faults and time[-1] - time[0] > LONGEST_S:
        gap = int(np.argmax(np.diff(time)))
        text = (
            f"spans {(time[-1] - time[0]) / 3600.0:.4g} h, a record at most {LONGEST_S / 3600.0:g} h; "
            f"its largest gap is {(time[gap + 1] - time[gap]) / 3600.0:.4g} h after sample {gap}"
        )
        faults.append(Fault(f"channels.{TIME}", text))
    return faults


def _sampling_faults(time: Samples, pressure: Samples) -> list[Fault]:
    """A sampling rate of the pressure that changes for good; single gaps, jitter and other channels' rates do not."""
    time = time[np.isfinite(pressure)]
    if len(time) < _STRETCHES * _SHORTEST_STRETCH:
        return []
    steps = np.diff(time)
    length = len(steps) // _STRETCHES
    periods = np.median(steps[: _STRETCHES * length].reshape(_STRETCHES, length), axis=1)
    change = np.flatnonzero(
        np.maximum(periods[1:], periods[:-1]) >= _LARGEST_RATE_CHANGE * np.minimum(periods[1:], periods[:-1])
    )
    if len(change) == 0:
        return []
    i = int(change[0])
    text = (
        f"sampling jumps from {1.0 / periods[i]:.4g} Hz to {1.0 / periods[i + 1]:.4g} Hz about here: "
        "upload the parts as segments"
    )
    return [Fault(f"channels.{TIME}[{(i + 1) * length}]", text)]


def unit_faults(
    channels: dict[str, Samples], pump: PumpType, full_scales: Mapping[str, float] = MappingProxyType({})
) -> list[Fault]:
    """Channels that cannot be in the unit of their name, with a guess at the unit they are in.

    ``full_scales`` are those [bar] of the aircraft's own sensors by channel, where they are stated.
    """
    faults = scale_faults(channels, pump, full_scales)
    told = {fault.where for fault in faults}
    for name, (low, high) in _LIMITS.items():
        level = _median(channels.get(name))
        if level is None or f"channels.{name}" in told:
            continue
        if not low <= level <= high:
            text = f"is {level:g} in the middle, which cannot be {_unit(name)}{_guess(name, level)}"
            faults.append(Fault(f"channels.{name}", text))
    return faults


def _median(samples: Samples | None) -> float | None:
    if samples is None:
        return None
    known = samples[np.isfinite(samples)]
    return float(np.median(known)) if len(known) else None


def _unit(name: str) -> str:
    return {"bar": "bar", "degc": "degC", "rpm": "rpm", "lpm": "L/min"}[name.rsplit("_", 1)[1]]


def _guess(name: str, level: float) -> str:
    if name == "fluid_temperature_degc" and 230.0 < level < 420.0:
        return ": it looks like K"
    if name.endswith("_bar"):
        if abs(level) > 2.0e4:
            return ": it looks like Pa"
        if name == "case_pressure_bar" and 100.0 < level < 260.0:
            return ": it looks like discharge pressure, or kPa"
        if name == "discharge_pressure_bar" and level > 1000.0:
            return ": it looks like psi or kPa"
    return ""
