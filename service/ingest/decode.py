"""From bytes and request to a checked record: the one entrance of every upload."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from service.errors import Fault, Invalid, Undecodable, UnknownType
from service.ingest import csv_format, hdf5_format, json_format, parquet_format
from service.ingest.inflate import GZIP_MAGIC, inflated
from service.ingest.metadata import RecordMetadata, checked_metadata
from service.ingest.raw import RawRecord
from service.ingest.validation import channel_faults
from twin.pumps import PUMP_TYPES, pump_type
from twin.recording import Recording

_ADAPTERS: tuple[ModuleType, ...] = (parquet_format, hdf5_format, json_format, csv_format)
"""One file per format; the order is that of recognition by first bytes, CSV being what remains."""
_GZIP_TYPES = ("application/gzip", "application/x-gzip")
_ANY_TYPE = "application/octet-stream"
DEFAULT_PUMP_TYPE = "h225"


@dataclass(frozen=True, slots=True)
class Limits:
    """How much one upload may hold."""

    inflated_bytes: int
    rows: int


@dataclass(frozen=True, slots=True)
class DecodedRecord:
    """A checked record: gauge pressures, equal lengths, increasing time."""

    metadata: RecordMetadata
    recording: Recording


def decode(
    content: bytes,
    content_type: str,
    content_encoding: str,
    overrides: Mapping[str, Any],
    limits: Limits,
    registered_type: Callable[[str | None, str], str | None] = lambda _operator, _serial: None,
) -> DecodedRecord:
    """Decode and check one upload.

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

    Raises
    ------
    Undecodable, UnknownType, TooLarge, Invalid
        with every fault found.
    """
    if not content:
        raise Undecodable("the body is empty: send the record's bytes", [Fault("body", "is empty")])
    raw = _parsed(content, content_type, content_encoding, limits)
    metadata, faults = checked_metadata({**raw.metadata, **overrides})
    named = {**raw.metadata, **overrides}
    kind = named.get("pump_type")
    if not kind and metadata is not None:
        kind = registered_type(metadata.operator, metadata.pump_serial)
    pump = pump_type(str(kind) if kind in PUMP_TYPES else DEFAULT_PUMP_TYPE)
    channels = _gauge(raw, metadata)
    faults += raw.faults + channel_faults(RawRecord(raw.metadata, channels), pump)
    if faults or metadata is None:
        raise Invalid(f"the record has {len(faults)} fault(s); nothing of it was stored", faults)
    foreign = {k: v for k, v in metadata.foreign.items() if isinstance(v, (str, int, float))}
    return DecodedRecord(metadata, Recording(channels, foreign))


def _parsed(content: bytes, content_type: str, content_encoding: str, limits: Limits) -> RawRecord:
    kind = content_type.partition(";")[0].strip().lower()
    encoding = content_encoding.strip().lower()
    if encoding not in ("", "identity", "gzip", "x-gzip"):
        raise UnknownType(f"content encoding {encoding!r} is not understood: send gzip or none")
    known = [t for a in _ADAPTERS for t in a.CONTENT_TYPES]
    if kind not in (*known, *_GZIP_TYPES, _ANY_TYPE):
        offered = ", ".join([*known, _GZIP_TYPES[0], _ANY_TYPE])
        fault = Fault("content-type", f"{kind or 'none'} is not one of {offered}")
        raise UnknownType(f"content type {kind or '(none)'} is not understood; send one of {offered}", [fault])
    zipped = kind in _GZIP_TYPES or encoding in ("gzip", "x-gzip")
    if zipped and not content.startswith(GZIP_MAGIC):
        raise Undecodable("the body is said to be gzip and is not", [Fault("body", "no gzip mark at its start")])
    if zipped or (kind == _ANY_TYPE and content.startswith(GZIP_MAGIC)):
        content = inflated(content, limits.inflated_bytes)
        if not content.strip():
            raise Undecodable("the gzip file is empty", [Fault("body", "is empty")])
    for adapter in _ADAPTERS:
        if kind in adapter.CONTENT_TYPES:
            return _read(adapter, content, limits)
    return _read(next(a for a in _ADAPTERS if a.recognises(content)), content, limits)


def _read(adapter: ModuleType, content: bytes, limits: Limits) -> RawRecord:
    raw: RawRecord = adapter.parsed(content, limits.rows)
    return raw


def _gauge(raw: RawRecord, metadata: RecordMetadata | None) -> dict[str, np.ndarray]:
    """Channels with gauge pressures, whatever reference the record states."""
    if metadata is None or metadata.pressure_reference == "gauge":
        return dict(raw.channels)
    return {
        name: samples - metadata.ambient_pressure_bar if name.endswith("_pressure_bar") else samples
        for name, samples in raw.channels.items()
    }
