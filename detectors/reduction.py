"""Reduce a recording to what the analysis keeps: the zero and the windows."""

from collections.abc import Mapping

import numpy as np

from detectors.observation import Reduction, Window, WindowKind
from detectors.windows import LOWEST_SPEED_FRACTION, steady_windows, unchanging_channels
from detectors.zero import pump_off_zero
from twin.parameters import PumpType
from twin.recording import Recording


def reduce_recording(recording: Recording, pump: PumpType, thresholds: Mapping[str, float]) -> Reduction:
    """Zero and windows of one recording; says in a sentence why it adds nothing when no window was accepted."""
    zero, off = pump_off_zero(recording, pump, thresholds)
    windows = tuple(sorted((*off, *steady_windows(recording, pump, thresholds)), key=lambda w: w.start_s))
    flags = []
    if not zero.measured:
        flags.append("no pump-off stretch: the case sensor's offset is unknown on this record")
    if "reservoir_pressure_bar" not in recording:
        flags.append("reservoir pressure not measured")
    accepted = [w for w in windows if w.accepted and w.kind is WindowKind.ZERO_FLOW]
    if accepted:
        stuck = unchanging_channels(recording, accepted[-1], ("discharge_pressure_bar", "case_pressure_bar"))
        flags += [f"{name} does not change at all over the zero-flow window: stuck, or too coarse" for name in stuck]
    return Reduction(zero, windows, None if accepted else _explanation(recording, windows, pump), tuple(flags))


def _explanation(recording: Recording, windows: tuple[Window, ...], pump: PumpType) -> str:
    rejected = [w for w in windows if w.kind is WindowKind.ZERO_FLOW]
    if rejected:
        longest = max(rejected, key=lambda w: w.end_s - w.start_s)
        return (
            f"no steady zero-flow window: the longest candidate, {longest.start_s:.0f} to {longest.end_s:.0f} s, "
            f"was rejected because {longest.reason}"
        )
    speed = recording["shaft_speed_rpm"]
    fastest = float(np.nanmax(speed)) if np.isfinite(speed).any() else 0.0
    needed = LOWEST_SPEED_FRACTION * pump.nominal_speed_rpm
    if fastest < needed:
        return f"no zero-flow window: the pump never reaches {needed:.0f} rpm (fastest {fastest:.0f} rpm)"
    return "no zero-flow window: no stretch at operating speed with untouched controls and regulated pressure"
