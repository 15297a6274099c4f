"""TDMS (LabVIEW): one group of channels, metadata among the properties; needs the extra ``tdms``."""

import io
from typing import Any

import numpy as np

from service.errors import Fault, Undecodable, UnknownType
from service.ingest.file_formats import TDMS
from service.ingest.raw import Limits, RawFile, Table, check_size, plain
from twin.recording import TIME


def parsed(content: bytes, limits: Limits) -> RawFile:
    """Read a TDMS record; lengths are read from the metadata before anything is decoded.

    A waveform's start and increment stand in for ``time_s`` where the group has no channel of that name.

    Raises
    ------
    UnknownType
        when npTDMS is not installed.
    Undecodable, TooLarge
        when it is no TDMS file, holds several groups, or is larger than the limits.
    """
    if not TDMS.begins(content):
        raise Undecodable("the body is not a TDMS file", [Fault("body", "no TDSm mark at its start")])
    try:
        from nptdms import TdmsFile  # noqa: PLC0415 - an extra
    except ImportError:
        raise UnknownType("reading TDMS needs the extra: pip install 'casedrain[tdms]'") from None
    with TdmsFile.open(io.BytesIO(content)) as file:
        groups = [group for group in file.groups() if group.channels()]
        if len(groups) != 1:
            raise Undecodable("a TDMS record is one group of channels", [Fault("body", f"holds {len(groups)} groups")])
        return _read(file, groups[0], limits)


def _read(file: Any, group: Any, limits: Limits) -> RawFile:
    members = group.channels()
    check_size(max(len(channel) for channel in members), len(members), limits)
    channels: dict[str, Any] = {}
    faults: list[Fault] = []
    metadata = {**file.properties, **group.properties}
    for channel in members:
        if channel.dtype.kind not in "fiu":
            faults.append(Fault(f"channels.{channel.name}", f"holds {channel.dtype}, not numbers"))
            continue
        channels[channel.name] = np.array(channel[:], dtype=np.float64)
        if TIME not in channels and "wf_increment" in channel.properties:
            channels[TIME] = np.array(channel.time_track(), dtype=np.float64)
        if "wf_start_time" in channel.properties:
            metadata.setdefault("wf_start_time", channel.properties["wf_start_time"])
    return RawFile({name: plain(value) for name, value in metadata.items()}, (Table(channels),), faults)
