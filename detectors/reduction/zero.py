"""Zero of the case sensor: while the pump is off it must read the reservoir."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from detectors.reduction.conditioning import Gaps, bridged_stretches, gaps_of, shares_lost
from detectors.reduction.declared import fitted_channels
from detectors.reduction.statistics import mean_with_error, without_spikes
from detectors.words.observation import Mean, Window, WindowKind, Zero
from twin.parameters import PumpType
from twin.recording import OPTIONAL_CHANNELS, Recording

PUMP_OFF_SPEED_FRACTION = 0.05
SETTLING_AFTER_SHUTDOWN_S = 30.0
UNMEASURED_RESERVOIR_SD_BAR = 0.10
"""Estimate: reservoir pressure against its nominal value on the ground, where no sensor tells."""

_AT_REST = ("case_pressure_bar", "reservoir_pressure_bar", "fluid_temperature_degc")
"""Channels whose means a pump-off stretch keeps."""


def pump_off_zero(
    recording: Recording,
    pump: PumpType,
    thresholds: Mapping[str, float],
    good: Sequence[tuple[float, float]] = (),
) -> tuple[Zero, tuple[Window, ...]]:
    """Zero of the case sensor on a conditioned record, and every pump-off stretch as a window.

    Gaps inside a stretch are bridged up to the stated share. The first settled stretch counts (before the run-up the
    line has rested longest); after a shutdown the pressure is given time to decay. Without one, the offset is unknown
    with the sensor's prior spread; so it is where the case pressure was not recorded there. A stretch that lies within
    one of ``good`` [s] is taken as it stands.
    """
    unknown_zero = Zero(0.0, pump.population["case_zero_bar"].value, measured=False)
    speed = np.abs(recording["shaft_speed_rpm"])
    with np.errstate(invalid="ignore"):
        off = speed < PUMP_OFF_SPEED_FRACTION * pump.nominal_speed_rpm
    unknown = ~np.isfinite(speed)
    time = recording.time_s
    asked = [n for n in ("shaft_speed_rpm", "case_pressure_bar") if n in fitted_channels(pump)]
    gaps = [gaps_of(time, recording[name]) for name in asked]
    running = ~off & ~unknown
    found = bridged_stretches(off, unknown, np.append(time, time[-1:]), gaps, 0.0)
    kept = [n for n in _AT_REST if n in recording and (n in OPTIONAL_CHANNELS or n in fitted_channels(pump))]
    lost = {n: gaps_of(time, recording[n]) for n in kept} if found else {}
    windows = []
    zero = unknown_zero
    for first, end in found:
        has_run = bool(running[:first].any())
        part = _vouched_part(time, first, end, good)
        window, offset = _pump_off_window(
            recording,
            pump,
            thresholds,
            part or (first, end),
            lost,
            settles=has_run and not part,
            vouched=part is not None,
        )
        windows.append(window)
        if window.accepted and offset is not None and not zero.measured:
            zero = offset
    return zero, tuple(windows)


def _vouched_part(
    time: NDArray[np.float64], first: int, end: int, good: Sequence[tuple[float, float]]
) -> tuple[int, int] | None:
    """Samples of the first good stretch that lies within a stretch of a pump that stands; None without one."""
    for a, b in good:
        start, stop = (int(i) for i in np.searchsorted(time, (a, np.nextafter(b, np.inf))))
        if first <= start < stop <= end:
            return start, stop
    return None


def _pump_off_window(
    recording: Recording,
    pump: PumpType,
    thresholds: Mapping[str, float],
    bounds: tuple[int, int],
    lost: Mapping[str, Gaps],
    *,
    settles: bool,
    vouched: bool,
) -> tuple[Window, Zero | None]:
    """One stretch of a pump that stands; ``settles`` where it has run before and the line still empties.

    ``lost`` are the gaps of the channels whose means it keeps. Where somebody has ``vouched`` for it, neither its length
    nor its drift counts.
    """
    first, end = bounds
    time = recording.time_s
    start_s, end_s = float(time[first]), float(time[end - 1])
    if settles:
        start_s = min(start_s + SETTLING_AFTER_SHUTDOWN_S, end_s)
    inside = slice(int(np.searchsorted(time, start_s)), end)
    means: dict[str, Mean] = {}
    for name in lost:
        mean = mean_with_error(recording[name][inside], _resolution(pump, name))
        if mean is not None:
            means[name] = mean
    shortest = thresholds["pump_off_minimum_duration_s"]
    bridged = shares_lost(lost, start_s, end_s)

    def rejected(reason: str) -> tuple[Window, None]:
        return Window(WindowKind.PUMP_OFF, start_s, end_s, False, reason, means, bridged=bridged), None

    # half a step is what jitter may take from a stretch that is just long enough
    if not vouched and end_s - start_s + 0.5 * float(np.median(np.diff(time))) < shortest:
        return rejected(f"lasts {end_s - start_s:.0f} s; at least {shortest:.0f} s are needed")
    if "case_pressure_bar" not in means:
        # the pump stands all the same; only what the case sensor reads then, nobody knows
        return Window(WindowKind.PUMP_OFF, start_s, end_s, True, None, means, bridged=bridged), None
    measured = "reservoir_pressure_bar" in means
    difference = recording["case_pressure_bar"][inside].copy()
    if measured:
        difference -= recording["reservoir_pressure_bar"][inside]
    else:
        difference -= pump.nominal_reservoir_pressure_bar
    sensor = pump.sensors["case_pressure_bar"]
    resolution = sensor.repeatability_bar
    halves = np.array_split(without_spikes(difference, resolution), 2)
    a, b = (mean_with_error(half, resolution) for half in halves)
    offset = mean_with_error(difference, resolution)
    if a is None or b is None or offset is None:
        return rejected("too few samples of case and reservoir pressure together")
    drift, allowed = abs(b.mean - a.mean), 0.01 * sensor.full_scale_bar
    if drift > allowed and not vouched:
        return rejected(f"case pressure has not settled: it moves by {drift:.3f} bar; limit {allowed:.3f} bar")
    spread = UNMEASURED_RESERVOIR_SD_BAR if not measured else resolution
    sd = math.hypot(offset.standard_error, resolution, spread)
    window = Window(WindowKind.PUMP_OFF, start_s, end_s, True, None, means, bridged=bridged)
    return window, Zero(offset.mean, sd, measured=True)


def _resolution(pump: PumpType, name: str) -> float:
    sensor = pump.sensors.get(name)
    return sensor.resolution_bar if sensor else 0.0
