"""What a record shows beside its reduction: how long it lasts, whether its samples came before, what looks odd in it."""

import hashlib
from dataclasses import dataclass, replace

import numpy as np

from detectors.words.observation import Reduction
from service.ingest.doubts import doubts
from service.ingest.scales import scale_remarks
from twin.parameters import PumpType
from twin.recording import REQUIRED_CHANNELS, TIME, Recording


@dataclass(frozen=True, slots=True)
class Traits:
    """Traits of one recording.

    Attributes
    ----------
    last_s
        Time of its last sample [s].
    samples_hash
        SHA-256 of its required channels in our units, gauge, from its own first sample on: the same flight in another
        file format, or under another name, has the same.
    remarks
        What looks like another unit or reference and may be right all the same.
    """

    last_s: float
    samples_hash: str
    remarks: tuple[str, ...]


def without_evidence(reduction: Reduction) -> Reduction:
    """A reduction that says nothing: of a record that repeats the samples of another, or whose date is wrong."""
    said = "its samples are those of another flight, or its date is wrong"
    return replace(reduction, windows=(), explanation=said, spectrum=None, droop=None, behaviours={})


def traits_of(recording: Recording, pump: PumpType) -> Traits:
    """Traits of a recording."""
    hashed = hashlib.sha256()
    for name in REQUIRED_CHANNELS:
        if name not in recording.channels:
            hashed.update(b"no channel")
            continue
        samples = recording[name] - recording.time_s[0] if name == TIME else recording[name]
        # single precision: what one format rounds and another does not is the same sample. No negative zero, one NaN
        single = np.asarray(samples, np.float32) + np.float32(0.0)
        single[np.isnan(single)] = np.nan
        hashed.update(single.tobytes())
    remarks = scale_remarks(recording.channels, pump) + doubts(recording.channels, pump)
    return Traits(float(recording.time_s[-1]), hashed.hexdigest(), remarks)
