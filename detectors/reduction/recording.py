"""Reduce a recording to what the analysis keeps: the zero, the windows, the spectrum of what is sampled fast, the droop."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from detectors.reduction.behaviour import behaviours
from detectors.reduction.conditioning import conditioned
from detectors.reduction.declared import with_stand_ins
from detectors.reduction.load_steps import droop_from_rest
from detectors.reduction.marks import remarks, with_good, without_bad
from detectors.reduction.spectrum import spectrum
from detectors.reduction.windows import LOWEST_SPEED_FRACTION, marked_windows, steady_windows, unchanging_channels
from detectors.reduction.zero import pump_off_zero
from detectors.words.numbers import LOWEST_PRESSURE_SHARE
from detectors.words.observation import Mark, Reduction, Window, WindowKind
from detectors.words.signature import Spectrum
from twin.parameters import PumpType
from twin.recording import Recording


def reduce_recording(
    recording: Recording, pump: PumpType, thresholds: Mapping[str, float], marks: Sequence[Mark] = ()
) -> Reduction:
    """Zero, windows, spectrum and droop of one recording; says in a sentence why it adds nothing when no window was accepted.

    What ``marks`` call bad is no evidence; what they call good is a window whether or not it is steady.
    """
    recording = conditioned(with_stand_ins(without_bad(recording, marks), pump), pump)
    good = [(m.start_s, m.end_s) for m in marks if m.good]
    zero, off = pump_off_zero(recording, pump, thresholds, good)
    steady = with_good(steady_windows(recording, pump, thresholds), marked_windows(recording, pump, thresholds, good))
    windows = tuple(sorted((*off, *steady), key=lambda w: w.start_s))
    flags = [*recording.flags, *remarks(marks, windows)]
    if not zero.measured:
        off_without_case = any(w.accepted for w in off)
        why = "no case pressure while the pump stood" if off_without_case else "no pump-off stretch"
        flags.append(f"{why}: the case sensor's offset is unknown on this record")
    if "reservoir_pressure_bar" not in recording:
        flags.append("reservoir pressure not measured")
    accepted = [w for w in windows if w.accepted and w.kind is WindowKind.ZERO_FLOW]
    if accepted:
        stuck = unchanging_channels(recording, accepted[-1], ("discharge_pressure_bar", "case_pressure_bar"))
        flags += [f"{name} does not change at all over the zero-flow window: stuck, or too coarse" for name in stuck]
    explanation = None if accepted else _explanation(recording, windows, pump)
    window = accepted[-1] if accepted else None
    lines = _spectrum(recording, window, pump, thresholds)
    return Reduction(
        zero,
        windows,
        explanation,
        tuple(flags),
        lines,
        droop_from_rest(recording, pump),
        behaviours(recording, pump),
    )


def _spectrum(
    recording: Recording, window: Window | None, pump: PumpType, thresholds: Mapping[str, float]
) -> Spectrum | None:
    """Spectrum of the zero-flow window; of the whole record where it is a burst, shorter than any window."""
    if window is not None:
        return spectrum(recording, window.start_s, window.end_s, pump)
    time = recording.time_s
    if len(time) < 2 or float(time[-1] - time[0]) >= thresholds["window_minimum_duration_s"]:
        return None
    regulated = pump.limits["zero_flow_pressure_low_bar"].value * LOWEST_PRESSURE_SHARE
    for name, lowest in (
        ("shaft_speed_rpm", LOWEST_SPEED_FRACTION * pump.nominal_speed_rpm),
        ("discharge_pressure_bar", regulated),
    ):
        known = recording[name][np.isfinite(recording[name])]
        # five in a hundred may be spikes; a run-up or a load step is no burst at constant load
        if len(known) == 0 or float(np.percentile(known, 5)) < lowest:
            return None
    return spectrum(recording, float(time[0]), math.nextafter(float(time[-1]), math.inf), pump)


def _explanation(recording: Recording, windows: tuple[Window, ...], pump: PumpType) -> str:
    rejected = [w for w in windows if w.kind is WindowKind.ZERO_FLOW]
    if rejected:
        longest = max(rejected, key=lambda w: w.end_s - w.start_s)
        return (
            f"no steady zero-flow window: the longest candidate, {longest.start_s:.0f} to {longest.end_s:.0f} s, "
            f"was rejected because {longest.reason}"
        )
    if any(w.accepted and w.kind is WindowKind.CONSTANT_FLOW for w in windows):
        return "no zero-flow window: windows at constant flow count beside one at zero flow in the same record only"
    speed = recording["shaft_speed_rpm"]
    fastest = float(np.nanmax(speed)) if np.isfinite(speed).any() else 0.0
    needed = LOWEST_SPEED_FRACTION * pump.nominal_speed_rpm
    if fastest < needed:
        return f"no zero-flow window: the pump never reaches {needed:.0f} rpm (fastest {fastest:.0f} rpm)"
    return "no zero-flow window: no stretch at operating speed with untouched controls and regulated pressure"
