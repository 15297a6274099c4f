"""From bytes and request to a checked record: the one entrance of every upload."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np

from service.errors import Fault, Invalid
from service.ingest.mapped import mapped_record
from service.ingest.mapping import ChannelMapping
from service.ingest.metadata import EARLIEST, RecordMetadata, TypeLookup, built_in, checked_metadata
from service.ingest.parse import parsed
from service.ingest.raw import Limits, RawFile, RawRecord
from service.ingest.repair import repaired
from service.ingest.validation import channel_faults
from twin.pumps import PUMP_TYPES
from twin.recording import Recording

__all__ = ["DEFAULT_PUMP_TYPE", "DecodedRecord", "Limits", "checked", "decode"]
DEFAULT_PUMP_TYPE = "h225"
_MOST_SHOWN, _LONGEST_SHOWN = 200, 100
"""Columns that were not kept, by name: how many are listed, and how much of each name."""
RegisteredType = Callable[[str | None, str], str | None]
FullScales = Callable[[RecordMetadata], Mapping[str, float]]
"""Full scale [bar] of the sensors that the aircraft of a record has of its own by then, by channel."""


@dataclass(frozen=True, slots=True)
class DecodedRecord:
    """A checked record: gauge pressures, equal lengths, increasing time."""

    metadata: RecordMetadata
    recording: Recording


def _no_registry(_operator: str | None, _serial: str) -> str | None:
    return None


def no_sensors(_metadata: RecordMetadata) -> Mapping[str, float]:
    """Nothing is registered: the pump type's own sensors."""
    return {}


def decode(
    content: bytes,
    content_type: str,
    content_encoding: str,
    overrides: Mapping[str, Any],
    limits: Limits,
    registered_type: RegisteredType = _no_registry,
    mapping: ChannelMapping | None = None,
    types: TypeLookup = built_in,
) -> DecodedRecord:
    """Decode and check one upload in this process; what comes from a network is parsed by ``ParserPool`` instead.

    Parameters
    ----------
    content, content_type, content_encoding
        As uploaded.
    overrides
        Metadata from the request, which win over those of the file.
    limits
        Bounds on inflation and rows.
    registered_type
        Pump type that is registered for (operator, serial), if any.
    mapping
        Names and units of a foreign file.
    types
        Pump types that the record may name.

    Raises
    ------
    Undecodable, UnknownType, TooLarge, Invalid
        with every fault found.
    """
    dialect = mapping.dialect if mapping is not None else None
    return checked(
        parsed(content, content_type, content_encoding, limits, dialect),
        overrides,
        registered_type,
        mapping,
        types=types,
    )


def checked(
    file: RawFile,
    overrides: Mapping[str, Any],
    registered_type: RegisteredType = _no_registry,
    mapping: ChannelMapping | None = None,
    now: datetime | None = None,
    types: TypeLookup = built_in,
    full_scales: FullScales | None = no_sensors,
) -> DecodedRecord:
    """A parsed file with its mapping applied, on one time base, and everything about it checked.

    Parameters
    ----------
    file, overrides, registered_type, mapping
        As for ``decode``.
    now
        The record must not lie in the future of this instant; None takes the clock's.
    types
        Pump types that the record may name.
    full_scales
        The aircraft's own sensors. None for a record that was taken once: what later rules hold unlikely of its
        units and instants stays history.

    Raises
    ------
    Invalid
        with every fault found.
    """
    raw = repaired(mapped_record(file, mapping))
    named = {**raw.metadata, **overrides}
    owner = str(named["operator"]) if named.get("operator") else None
    earliest = None if full_scales is None else EARLIEST
    metadata, faults = checked_metadata(named, now, lambda name: types(owner, name) is not None, earliest)
    scales: Mapping[str, float] | None = None
    if full_scales is not None:
        scales = full_scales(metadata) if metadata else {}
    kind = named.get("pump_type")
    if not kind and metadata is not None:
        kind = registered_type(metadata.operator, metadata.pump_serial)
    pump = (types(owner, str(kind)) if kind else None) or PUMP_TYPES[DEFAULT_PUMP_TYPE]
    if "absolute" in raw.references.values() and not named.get("ambient_pressure_bar"):
        faults.append(Fault("ambient_pressure_bar", "is needed: the mapping says that a pressure is absolute"))
    channels = _gauge(raw, metadata)
    with np.errstate(all="ignore"):  # damaged files hold numbers that overflow any sum; they are faults, not warnings
        found = channel_faults(RawRecord(raw.metadata, channels), pump, scales)
    explained = {fault.where for fault in raw.faults}
    faults += raw.faults + [f for f in found if f.problem != "is missing" or f.where not in explained]
    if faults or metadata is None:
        raise Invalid(f"the record has {len(faults)} fault(s); nothing of it was stored", faults)
    foreign = {k: v for k, v in metadata.foreign.items() if isinstance(v, (str, int, float))}
    if raw.not_kept:
        foreign["not_kept"] = _listed(raw.not_kept)
    return DecodedRecord(metadata, Recording(channels, foreign, tuple(raw.flags)))


def _listed(not_kept: Mapping[str, str]) -> str:
    """What was not kept in a sentence, the rest of very much as a count."""
    told = [f"{name[:_LONGEST_SHOWN]} ({what[:_LONGEST_SHOWN]})" for name, what in not_kept.items()]
    more = len(told) - _MOST_SHOWN
    return ", ".join(told if more <= 0 else [*told[:_MOST_SHOWN], f"and {more} more"])


def _gauge(raw: RawRecord, metadata: RecordMetadata | None) -> dict[str, np.ndarray]:
    """Channels with gauge pressures, whatever reference the record or its mapping states."""
    if metadata is None:
        return dict(raw.channels)
    return {
        name: samples - metadata.ambient_pressure_bar
        if name.endswith("_pressure_bar") and raw.references.get(name, metadata.pressure_reference) == "absolute"
        else samples
        for name, samples in raw.channels.items()
    }
