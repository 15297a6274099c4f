"""Judged chunks as compressed files, each named after everything that it depends on."""

import functools
import hashlib
import os
import zipfile
from dataclasses import fields
from pathlib import Path

import numpy as np

from detectors.evaluation.study import Outcome
from detectors.judgement.version import twin_version
from detectors.words.thresholds import effective
from service.studies.evaluation.plan import Chunk
from twin.pumps import pump_type
from twin.sources import sources_hash

_NAMES = tuple(f.name for f in fields(Outcome))


def key(chunk: Chunk) -> str:
    """Name of a chunk's result; another row, reality, seed, twin, threshold or source gives another name."""
    forecasts = None if chunk.row.limit is None else _forecast_sources()
    depends = (chunk, twin_version(pump_type(chunk.pump_type)), sorted(effective({}).items()), _sources(), forecasts)
    return hashlib.sha256(repr(depends).encode()).hexdigest()[:24]


def kept(folder: Path, chunk: Chunk) -> Outcome | None:
    """Result of a chunk; None if it is missing, or damaged: it is then worked out again."""
    try:
        with np.load(_path(folder, chunk), allow_pickle=False) as archive:
            return Outcome(**{name: archive[name] for name in _NAMES})
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None


def keep(folder: Path, chunk: Chunk, outcome: Outcome) -> None:
    """Write a chunk's result; a reader never sees half a file."""
    path = _path(folder, chunk)
    partial = path.with_suffix(f".{os.getpid()}.part")
    with partial.open("wb") as file:
        np.savez_compressed(file, **{name: getattr(outcome, name) for name in _NAMES})
    partial.replace(path)


def is_kept(folder: Path, chunk: Chunk) -> bool:
    """Whether a readable result is there."""
    return kept(folder, chunk) is not None


def _path(folder: Path, chunk: Chunk) -> Path:
    return folder / f"{key(chunk)}.npz"


@functools.cache
def _forecast_sources() -> str:
    """Hash of what forecasts are made by."""
    return sources_hash(
        "detectors.prognosis.passage", "service.reading.forecast", "service.studies.evaluation.forecasts"
    )


@functools.cache
def _sources() -> str:
    """Hash of the judge's and the simulator's sources with the fitted numbers that they read."""
    return sources_hash("detectors.evaluation.small_steps")
