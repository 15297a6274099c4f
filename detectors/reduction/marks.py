"""Stretches of a record that an engineer has judged: bad samples are no evidence, a good stretch is a window."""

from collections.abc import Sequence

import numpy as np

from detectors.words.observation import Mark, Window, WindowKind
from twin.recording import TIME, Recording


def without_bad(recording: Recording, marks: Sequence[Mark]) -> Recording:
    """The recording with no samples where it is marked bad, both bounds included; all else stays as it is."""
    time = recording.time_s
    bad = np.zeros(len(time), dtype=np.bool_)
    for mark in marks:
        if not mark.good:
            bad |= (time >= mark.start_s) & (time <= mark.end_s)
    if not bad.any():
        return recording
    channels = {
        n: samples if n == TIME else np.where(bad, np.nan, samples) for n, samples in recording.channels.items()
    }
    return Recording(channels, recording.attributes, recording.flags)


def with_good(found: Sequence[Window], good: Sequence[Window]) -> tuple[Window, ...]:
    """Windows in time order, those that overlap a good stretch of their kind replaced by it."""
    kept = [w for w in found if not any(_overlap(w, g) for g in good)]
    return tuple(sorted((*kept, *good), key=lambda w: w.start_s))


def remarks(marks: Sequence[Mark], windows: Sequence[Window]) -> list[str]:
    """What is said of the marks of a record: how much is out, and good stretches that cannot be windows."""
    bad = sum(m.end_s - m.start_s for m in marks if not m.good)
    said = [f"{bad:.3g} s marked bad by an engineer"] if bad > 0.0 else []
    for mark in marks:
        if not mark.good:
            continue
        inside = [w for w in windows if w.accepted and mark.start_s <= w.start_s <= mark.end_s]
        where = f"{mark.start_s:.6g} to {mark.end_s:.6g} s"
        said.append(
            f"{where} marked good by an engineer"
            if inside
            else f"{where} marked good is no window: the pump neither stands nor holds a regulated pressure there"
        )
    return said


def _overlap(one: Window, other: Window) -> bool:
    same = (one.kind is WindowKind.PUMP_OFF) == (other.kind is WindowKind.PUMP_OFF)
    return same and one.start_s < other.end_s and other.start_s < one.end_s
