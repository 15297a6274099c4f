"""JSON: metadata beside ``channels``, an object of equally long arrays."""

import json
from typing import Any

import numpy as np

from service.errors import Fault, Undecodable
from service.ingest.raw import METADATA, MOST_FAULTS_OF_A_KIND, Limits, RawFile, Table, capped, check_size

_REPEATED = "\0repeated"
"""Key under which an object remembers the names that it was given twice; no name of a channel holds a NUL."""


def parsed(content: bytes, limits: Limits) -> RawFile:
    """Read a JSON record; every bad sample becomes a fault with its channel and index.

    Raises
    ------
    Undecodable
        when it is not a JSON object.
    TooLarge
        when it is larger than the limits.
    """
    try:
        document = json.loads(content, object_pairs_hook=_unique)
    except (ValueError, RecursionError) as error:
        raise Undecodable("the body is not JSON", [Fault("body", str(error)[:200])]) from None
    if not isinstance(document, dict):
        raise Undecodable("the body must be a JSON object", [Fault("body", f"is a {type(document).__name__}")])
    metadata = {k: v for k, v in document.items() if k != "channels"}
    raw = document.get("channels")
    if not isinstance(raw, dict):
        what = "is missing" if raw is None else f"is a {type(raw).__name__}, not an object of arrays"
        return RawFile(metadata, (Table({}),), [Fault("channels", what)])
    channels: dict[str, Any] = {}
    faults = [Fault(f"channels.{name}", "appears twice") for name in raw.pop(_REPEATED, [])]
    metadata_twice = metadata.pop(_REPEATED, [])
    faults += [Fault(name, "appears twice") for name in metadata_twice]
    for name in METADATA:
        if isinstance(metadata.get(name), (list, dict)):
            faults.append(Fault(name, f"is a {type(metadata[name]).__name__}, not a single value"))
    for name, samples in raw.items():
        if not isinstance(samples, list):
            faults.append(Fault(f"channels.{name}", f"is a {type(samples).__name__}, not an array"))
            continue
        check_size(len(samples), len(raw), limits)
        channels[name], bad = _numbers(name, samples)
        faults += bad
    return RawFile(metadata, (Table(channels),), faults)


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        names = [name for name, _ in pairs]
        found[_REPEATED] = sorted({name for name in names if names.count(name) > 1})
    return found


def _numbers(name: str, samples: list[Any]) -> tuple[Any, list[Fault]]:
    values = np.full(len(samples), np.nan)
    faults: list[Fault] = []
    n_bad = 0
    for i, sample in enumerate(samples):
        if isinstance(sample, (int, float)) and not isinstance(sample, bool):
            try:
                values[i] = sample
            except OverflowError:
                values[i] = np.inf
        elif sample is not None:
            n_bad += 1
            if n_bad <= MOST_FAULTS_OF_A_KIND:
                faults.append(Fault(f"channels.{name}[{i}]", f"{json.dumps(sample)[:40]} is not a number"))
    return values, capped(faults, n_bad - MOST_FAULTS_OF_A_KIND, "samples that are not numbers", f"channels.{name}")
