"""MDF4 (ASAM): one channel group, metadata among the header's common properties; needs the extra ``mdf4``."""

import io
from typing import Any

import numpy as np

from service.errors import Fault, Undecodable, UnknownType
from service.ingest.file_formats import MDF4
from service.ingest.raw import Limits, RawFile, Table, check_size
from twin.recording import TIME


def parsed(content: bytes, limits: Limits) -> RawFile:
    """Read an MDF4 record; the cycle count is read from the channel group before anything is decoded.

    The master channel stands in for ``time_s`` where the group has no channel of that name.

    Raises
    ------
    UnknownType
        when asammdf is not installed.
    Undecodable, TooLarge
        when it is no MDF4 file, holds several groups of channels, or is larger than the limits.
    """
    if not MDF4.begins(content):
        raise Undecodable("the body is not an MDF4 file", [Fault("body", "no MDF 4 mark at its start")])
    try:
        from asammdf import MDF  # noqa: PLC0415 - an extra
    except ImportError:
        raise UnknownType("reading MDF4 needs the extra: pip install 'casedrain[mdf4]'") from None
    with MDF(io.BytesIO(content), raise_on_multiple_occurrences=False) as file:
        return _read(file, limits)


def _read(file: Any, limits: Limits) -> RawFile:
    filled = [i for i, group in enumerate(file.groups) if group.channel_group.cycles_nr and len(group.channels) > 1]
    if len(filled) != 1:
        fault = Fault("body", f"holds {len(filled)} channel groups with samples")
        raise Undecodable("an MDF4 record is one channel group", [fault])
    index = filled[0]
    group = file.groups[index]
    check_size(int(group.channel_group.cycles_nr), len(group.channels), limits)
    master = file.masters_db.get(index)
    channels: dict[str, Any] = {}
    faults: list[Fault] = []
    time = None
    for place, channel in enumerate(group.channels):
        if place == master:
            continue
        signal = file.get(group=index, index=place)
        time = signal.timestamps
        samples = np.asarray(signal.samples)
        if channel.name in channels:
            faults.append(Fault(f"channels.{channel.name}", "appears twice"))
        elif samples.ndim != 1 or samples.dtype.kind not in "fiu":
            faults.append(Fault(f"channels.{channel.name}", f"holds {samples.dtype}, not one row of numbers"))
        else:
            channels[channel.name] = _with_gaps(samples, signal.invalidation_bits)
    if TIME not in channels and time is not None:
        channels[TIME] = np.array(time, dtype=np.float64)
    header = file.header
    metadata = {"mdf_start_time": header.start_time.isoformat(), **dict(header._common_properties)}
    return RawFile(
        {str(k): v for k, v in metadata.items() if isinstance(v, (str, int, float))}, (Table(channels),), faults
    )


def _with_gaps(samples: Any, invalid: Any) -> Any:
    values = np.array(samples, dtype=np.float64)
    if invalid is not None:
        values[np.asarray(invalid, dtype=bool)] = np.nan
    return values
