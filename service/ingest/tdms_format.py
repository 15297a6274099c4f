"""TDMS (LabVIEW): groups of channels, each waveform on its own start and increment; needs the extra ``tdms``."""

import io
import math
from collections import Counter
from collections.abc import Container
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from service.errors import Fault, TooLarge, Undecodable, UnknownType
from service.ingest.file_formats import TDMS
from service.ingest.nested import MOST_TEXTS
from service.ingest.raw import Limits, RawFile, Samples, Table, check_size, plain
from service.ingest.tdms_scales import scale_fault, scaled_unit
from service.ingest.time_words import clock_of_instants, is_time_name, texts_of_instants
from twin.recording import OPTIONAL_CHANNELS, REQUIRED_CHANNELS, TIME

_START, _OFFSET, _STEP = "wf_start_time", "wf_start_offset", "wf_increment"
_LEAD_IN = 28
_MOST_SEGMENTS = 100_000
_FARTHEST = timedelta(hours=48)
_UNITS = ("unit_string", "NI_UnitDescription", "units", "unit", "Unit")


def parsed(content: bytes, limits: Limits) -> RawFile:
    """Read a TDMS record; lengths are read from the metadata before anything is decoded.

    Raises
    ------
    UnknownType
        when npTDMS is not installed.
    Undecodable, TooLarge
        when it is no TDMS file, or is larger than the limits.
    """
    if not TDMS.begins(content):
        raise Undecodable("the body is not a TDMS file", [Fault("body", "no TDSm mark at its start")])
    try:
        from nptdms import TdmsFile  # noqa: PLC0415 - an extra
    except ImportError:
        raise UnknownType("reading TDMS needs the extra: pip install 'casedrain[tdms]'") from None
    _check_segments(content)
    described = TdmsFile.read_metadata(io.BytesIO(content))
    lengths = [len(channel) for group in described.groups() for channel in group.channels()]
    if lengths:
        check_size(max(lengths), 1, limits)
        check_size(1, sum(lengths), limits)
    # in one go: a channel at a time, interleaved samples would be read once for every channel
    file = TdmsFile.read(io.BytesIO(content))
    not_kept: dict[str, str] = {}
    cut = bool(file.file_status.incomplete_final_segment)
    flags = ["the file was cut short in its last segment; what was whole before is kept"] if cut else []
    scales = _unscaled(file)
    tables = tuple(t for group in file.groups() if group.channels() for t in _tables(group, not_kept, scales, cut=cut))
    metadata = {name: plain(value) for name, value in file.properties.items()}
    for table in tables:
        if table.start is not None:
            metadata.setdefault(_START, table.start.isoformat().replace("+00:00", "Z"))
    ours = (*REQUIRED_CHANNELS, *OPTIONAL_CHANNELS)
    faults = [Fault(f"channels.{name}", words) for (_, name), words in scales.items() if name in ours]
    not_kept |= {name: words for (_, name), words in scales.items() if name not in ours}
    lost = {n for t in tables for n, samples in t.channels.items() if not np.isfinite(samples).any()}
    if cut and lost.intersection(REQUIRED_CHANNELS):
        text = "was cut short in its last segment, before what is missing was written: copy it again from the recorder"
        faults.append(Fault("body", text))
    if cut:
        told = "was lost: the file was cut short before its samples were written"
        flags += [f"{name} {told}" for name in sorted(lost - {*REQUIRED_CHANNELS})]
        flags += [words for group in file.groups() for words in _cut_within(group)]
    return RawFile(metadata, tables, faults, not_kept, flags)


def _check_segments(content: bytes) -> None:
    """Count the segments by their lead-ins: each costs the reader some time, however little it holds."""
    place = n = 0
    while place + _LEAD_IN <= len(content):
        onward = int.from_bytes(content[place + 12 : place + 20], "little")
        place += _LEAD_IN + onward
        n += 1
        if n > _MOST_SEGMENTS:
            raise TooLarge(f"the TDMS file has more than {_MOST_SEGMENTS} segments: defragment it")


def _unscaled(file: Any) -> dict[tuple[str, str], str]:
    """Channels by group and name whose scale cannot be followed, and why; the reader would hand out counts."""
    found: dict[tuple[str, str], str] = {}
    for group in file.groups():
        for channel in group.channels():
            words = scale_fault((channel.properties, group.properties, file.properties))
            if words is None:
                try:
                    channel[:1]
                except KeyError as missing:
                    words = f"has a scale without {missing.args[0]}: save it scaled"
                except Exception as error:  # steps raise whatever their numbers lead them to, and bare exceptions
                    words = f"has a scale that cannot be computed ({error}): save it scaled"
            if words is not None:
                found[group.name, channel.name] = words
    return found


def _tables(group: Any, not_kept: dict[str, str], unscaled: Container[tuple[str, str]], *, cut: bool) -> list[Table]:
    """A group as a table, and as more where channels of it start at instants that have nothing to do with each other."""
    channels: dict[str, Samples] = {}
    texts: dict[str, list[str | None]] = {}
    units: dict[str, str] = {}
    clocks: dict[str, tuple[Samples, datetime | None]] = {}
    instants = None
    for channel in group.channels():
        if (group.name, channel.name) in unscaled:
            continue
        name, kind = channel.name, channel.dtype.kind
        if kind == "M":
            values = channel[:].astype("datetime64[us]")
            if is_time_name(name) or instants is None:
                instants = (name, values)
            _say(name, values, texts, not_kept)
        elif kind in "fiub":
            values = np.array(channel[:], dtype=np.float64)
            channels[name] = values
            unit = next((str(channel.properties[key]).strip() for key in _UNITS if key in channel.properties), "")
            unit = unit or scaled_unit((channel.properties, group.properties))
            if unit:
                units[name] = unit
            clock = _waveform(channel.properties, len(values))
            if clock is not None:
                clocks[name] = clock
        elif kind in "OSU" and len(channel) <= MOST_TEXTS:
            texts[name] = [str(word) for word in channel[:]]
        else:
            not_kept[name] = "text" if kind in "OSU" else "complex numbers" if kind == "c" else "of no numeric type"
    attributes = {name: plain(value) for name, value in group.properties.items()}
    if TIME in channels:  # the group's own column is what its author meant to be read
        n = len(channels[TIME])
        if cut:
            channels = {name: _of_length(values, n) for name, values in channels.items()}
        clocks = {name: clock for name, clock in clocks.items() if len(channels[name]) != n}
    if not clocks:
        time, start = (None, None) if TIME in channels else _of_instants(instants, channels)
        return [Table(channels, texts, group.name, time, start, {}, units, attributes)]
    time, start = _usual(clocks)
    times, apart = {}, []
    for name, (own, own_start) in clocks.items():
        if own_start == start:
            times[name] = own
        elif own_start is None or start is None or abs(own_start - start) > _FARTHEST:
            samples = {name: channels.pop(name)}
            apart.append(Table(samples, {}, group.name, own, own_start, units=units))
        else:
            times[name] = own + (own_start - start).total_seconds()
    return [Table(channels, texts, group.name, time, start, times, units, attributes), *apart]


def _cut_within(group: Any) -> list[str]:
    """The channel of a group that the end of the file cuts: alone with its length, and shorter than is usual there."""
    lengths = {channel.name: len(channel) for channel in group.channels()}
    often = Counter(lengths.values())
    usual = max(often, key=lambda n: (often[n], n), default=0)
    return [
        f"{name} has {n} of {usual} samples: the file was cut short within them"
        for name, n in lengths.items()
        if 0 < n < usual and often[n] == 1
    ]


def _of_length(values: Samples, n: int) -> Samples:
    """The first n samples, missing ones after them where there are fewer."""
    return np.concatenate((values[:n], np.full(max(0, n - len(values)), np.nan)))


def _say(name: str, values: Any, texts: dict[str, list[str | None]], not_kept: dict[str, str]) -> None:
    if len(values) <= MOST_TEXTS:
        texts[name] = texts_of_instants(values, utc=True)
    else:
        not_kept[name] = "instants"


def _of_instants(instants: tuple[str, Any] | None, channels: dict[str, Samples]) -> tuple[Any, datetime | None]:
    """The group's clock where one of its channels holds the instants of the others."""
    if instants is None or not is_time_name(instants[0]):
        return None, None
    clock = clock_of_instants(instants[1], utc=True)
    lengths = Counter(map(len, channels.values()))
    return clock if clock is not None and len(instants[1]) in lengths else (None, None)


def _waveform(properties: Any, n: int) -> tuple[Samples, datetime | None] | None:
    """Times of a waveform's samples [s] and their zero's instant (TDMS keeps UTC); None where it states no increment."""
    step, offset = properties.get(_STEP), properties.get(_OFFSET, 0.0)
    if not isinstance(step, (int, float)) or not math.isfinite(step) or step <= 0.0:
        return None
    if not isinstance(offset, (int, float)) or not math.isfinite(offset):
        offset = 0.0
    start = properties.get(_START)
    if isinstance(start, np.datetime64):
        start = start.astype("datetime64[us]").astype(datetime)
    if not isinstance(start, datetime):
        return offset + np.arange(n) * step, None
    return offset + np.arange(n) * step, start.replace(tzinfo=UTC) if start.tzinfo is None else start


def _usual(clocks: dict[str, tuple[Samples, datetime | None]]) -> tuple[Samples, datetime | None]:
    """The most usual clock of a group with its start."""
    keys = {name: (len(times), start, times[:2].tobytes()) for name, (times, start) in clocks.items()}
    usual = Counter(keys.values()).most_common(1)[0][0]
    return clocks[next(name for name, key in keys.items() if key == usual)]
