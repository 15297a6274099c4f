"""JSON: metadata beside ``channels``, an object of equally long arrays."""

import gc
import json
import re
from collections import Counter
from typing import Any

import numpy as np

from service.answers.documents import JsonObject
from service.errors import Fault, TooLarge, Undecodable
from service.ingest.csv_words import KNOWN_CHANNELS, MISSING
from service.ingest.raw import (
    METADATA,
    MOST_FAULTS_OF_A_KIND,
    MOST_METADATA,
    Limits,
    RawFile,
    Table,
    capped,
    check_columns,
    check_size,
)
from twin.recording import OPTIONAL_CHANNELS

_HALF_A_WORD = re.compile(r"[\w.+-]{0,20}\s*")
_REPEATED = "\0repeated"
"""Key under which an object remembers the names that it was given twice; no name of a channel holds a NUL."""
_NUMBERS = {int, float, type(None)}


def parsed(content: bytes, limits: Limits) -> RawFile:
    """Read a JSON record; every bad sample of a known channel becomes a fault with its channel and index.

    Arrays of other names refuse nothing: one that holds words or truth values is among ``texts`` of the table.

    Raises
    ------
    Undecodable
        when it is not a JSON object.
    TooLarge
        when it is larger than the limits.
    """
    try:
        document = _loaded(content)
    except (ValueError, RecursionError) as error:
        if _is_cut(error):
            fault = Fault("body", f"ends after {len(content)} bytes in the middle of a value")
            raise Undecodable("the JSON ends before it is whole: upload the whole file", [fault]) from None
        raise Undecodable("the body is not JSON", [Fault("body", str(error)[:200])]) from None
    if not isinstance(document, dict):
        raise Undecodable("the body must be a JSON object", [Fault("body", f"is a {type(document).__name__}")])
    metadata = {k: v for k, v in document.items() if k != "channels"}
    if len(metadata) > MOST_METADATA:
        raise TooLarge(f"the file has {len(metadata)} metadata, more than {MOST_METADATA}")
    raw = document.get("channels")
    if not isinstance(raw, dict):
        what = "is missing" if raw is None else f"is a {type(raw).__name__}, not an object of arrays"
        return RawFile(metadata, (Table({}),), [Fault("channels", what)])
    faults = [Fault(f"channels.{name}", "appears twice") for name in raw.pop(_REPEATED, [])]
    metadata_twice = metadata.pop(_REPEATED, [])
    faults += [Fault(name, "appears twice") for name in metadata_twice]
    for name in METADATA:
        if isinstance(metadata.get(name), (list, dict)):
            faults.append(Fault(name, f"is a {type(metadata[name]).__name__}, not a single value"))
    check_columns(len(raw))
    table = Table({})
    not_kept: dict[str, str] = {}
    for name, samples in raw.items():
        if samples is None and name in OPTIONAL_CHANNELS:
            samples = []  # noqa: PLW2901 - nothing, however it is said
        if isinstance(samples, list):
            check_size(len(samples), len(raw), limits)
            faults += _take(table, name, samples)
        elif name in KNOWN_CHANNELS:
            faults.append(Fault(f"channels.{name}", f"is a {type(samples).__name__}, not an array"))
        else:
            not_kept[name] = f"a {type(samples).__name__}, not an array"
    return RawFile(metadata, (table,), faults, not_kept)


def _is_cut(error: Exception) -> bool:
    """Whether reading failed at the end of the text, not before."""
    if not isinstance(error, json.JSONDecodeError):
        return False
    is_open = error.msg.startswith("Unterminated string")
    return is_open or (len(error.doc) > 1 and _HALF_A_WORD.fullmatch(error.doc, error.pos) is not None)


def _loaded(content: bytes) -> Any:
    was_on = gc.isenabled()
    gc.disable()  # a document has no cycles, and looking for some costs more than reading it
    try:
        return json.loads(content, object_pairs_hook=_unique)
    finally:
        if was_on:
            gc.enable()


def _unique(pairs: list[tuple[str, Any]]) -> JsonObject:
    found = dict(pairs)
    if len(found) < len(pairs):
        found[_REPEATED] = sorted(name for name, n in Counter(name for name, _ in pairs).items() if n > 1)
    return found


def _take(table: Table, name: str, samples: list[Any]) -> list[Fault]:
    """Take over one array: as numbers, or as texts where a foreign one holds anything else."""
    if set(map(type, samples)) <= _NUMBERS:
        try:
            table.channels[name] = np.array(samples, dtype=np.float64)
            return []
        except OverflowError:  # an integer beyond every float
            pass
    values, faults = _numbers(name, samples)
    if faults and name not in KNOWN_CHANNELS:
        table.texts[name] = [None if v is None else v if isinstance(v, str) else json.dumps(v)[:200] for v in samples]
        return []
    table.channels[name] = values
    return faults


def _numbers(name: str, samples: list[Any]) -> tuple[Any, list[Fault]]:
    values = np.full(len(samples), np.nan)
    faults: list[Fault] = []
    n_bad = 0
    for i, sample in enumerate(samples):
        if isinstance(sample, (int, float)) and not isinstance(sample, bool):
            try:
                values[i] = sample
            except OverflowError:
                values[i] = np.inf if sample > 0 else -np.inf
        elif sample is not None and not (isinstance(sample, str) and sample.strip().lower() in MISSING):
            n_bad += 1
            if n_bad <= MOST_FAULTS_OF_A_KIND:
                faults.append(Fault(f"channels.{name}[{i}]", f"{json.dumps(sample)[:40]} is not a number"))
    return values, capped(faults, n_bad - MOST_FAULTS_OF_A_KIND, "samples that are not numbers", f"channels.{name}")
