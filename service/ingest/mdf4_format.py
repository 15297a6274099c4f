"""MDF4 (ASAM): every channel group on its own master, metadata among the header's properties; needs the extra ``mdf4``.

Invalid samples are missing ones; conversions of the file are applied, formulas where they are plain arithmetic (the
reader's library would evaluate any text of a stranger); enumerations are texts.
"""

import io
from collections import Counter
from datetime import datetime
from typing import Any

import numpy as np

from service.errors import Fault, Undecodable, UnknownType
from service.ingest.file_formats import MDF4
from service.ingest.formulas import Formula
from service.ingest.mdf4_blocks import check_links
from service.ingest.nested import MOST_TEXTS
from service.ingest.raw import Limits, RawFile, Samples, Table, check_size, plain
from service.ingest.time_words import clock_in
from twin.recording import OPTIONAL_CHANNELS, REQUIRED_CHANNELS

_OURS = (*REQUIRED_CHANNELS, *OPTIONAL_CHANNELS)
_ALL_INVALID, _MAY_BE_INVALID = 1, 2
_BUS = 2 | 4
_ALGEBRAIC = 3
_TIME = 1
_VIRTUAL = (3, 6)
"""Types of channels that have no bytes in a record: a count of records serves."""
_ANY_LENGTH = 1
_STRINGS = range(6, 10)
_OUTSIDE = "outside the records of its group: the file is damaged"
_ASTRAY = "made of samples that are not there: the file is damaged"
_FARTHEST = 1 << 40
_OPERANDS = ("X", "X1", "x")
"""What the formula of a conversion calls the sample."""


def parsed(content: bytes, limits: Limits) -> RawFile:
    """Read an MDF4 record; cycle counts are read from the channel groups before anything is decoded.

    Raises
    ------
    UnknownType
        when asammdf is not installed.
    Undecodable, TooLarge
        when it is no MDF4 file, its links run in circles, or it is larger than the limits.
    """
    if not MDF4.begins(content):
        raise Undecodable("the body is not an MDF4 file", [Fault("body", "no MDF 4 mark at its start")])
    try:
        from asammdf import MDF  # noqa: PLC0415 - an extra
    except ImportError:
        raise UnknownType("reading MDF4 needs the extra: pip install 'casedrain[mdf4]'") from None
    check_links(content)
    with MDF(io.BytesIO(content), raise_on_multiple_occurrences=False) as file:
        return _Reader(getattr(file, "_mdf", file), limits).file()


class _Reader:
    """One open file, group by group."""

    def __init__(self, file: Any, limits: Limits) -> None:
        self._file, self._limits = file, limits
        self._faults: list[Fault] = []
        self._not_kept: dict[str, str] = {}

    def file(self) -> RawFile:
        """All groups that have samples."""
        groups = [(i, group) for i, group in enumerate(self._file.groups) if group.channel_group.cycles_nr]
        sizes = [(int(group.channel_group.cycles_nr), len(group.channels)) for _, group in groups]
        if sizes:
            check_size(max(rows for rows, _ in sizes), 1, self._limits)
            check_size(1, sum(rows * columns for rows, columns in sizes), self._limits)
        names = self._names(groups)
        tables = []
        for index, group in groups:
            if group.channel_group.flags & _BUS:
                self._not_kept |= {channel.name: "traffic of a bus" for channel in group.channels}
            else:
                tables.append(self._table(index, group, names[index]))
        header = self._file.header
        metadata = {"mdf_start_time": header.start_time.isoformat(), **dict(header._common_properties)}
        kept = {str(name): value for name, value in metadata.items() if isinstance(value, (str, int, float))}
        return RawFile(kept, tuple(tables), self._faults, self._not_kept)

    def _names(self, groups: list[tuple[int, Any]]) -> dict[int, str]:
        """What to call each group: as the recorder does where that tells them apart."""
        said = {i: str(group.channel_group.acq_name or "").strip() for i, group in groups}
        often = Counter(said.values())
        return {i: name if name and often[name] == 1 else f"{name} group {i + 1}".strip() for i, name in said.items()}

    def _table(self, index: int, group: Any, name: str) -> Table:
        master = self._file.masters_db.get(index)
        has_clock = self._has_clock(group, master)
        wanted = {place: channel for place, channel in enumerate(group.channels) if self._can_be_read(group, place)}
        parts: dict[int, list[Any]] = {place: [] for place in wanted}
        times: list[Any] = []
        for fragment in self._file._load_data(group):
            for place in [p for p, channel in wanted.items() if _leads_astray(group.channel_group, channel, fragment)]:
                self._leave_out(wanted.pop(place).name, _ASTRAY)
            for place, channel in wanted.items():
                parts[place].append(self._samples(index, place, channel, fragment))
            if has_clock:
                times.append(np.asarray(self._file.get_master(index, data=fragment, one_piece=True)))
        channels: dict[str, Samples] = {}
        texts: dict[str, list[str | None]] = {}
        units: dict[str, str] = {}
        for place, channel in wanted.items():
            called = self._once(channel.name, channels, texts)
            if called is None:
                continue
            self._keep(called, channel, parts[place], channels, texts)
            unit = str((channel.conversion and channel.conversion.unit) or channel.unit or "").strip()
            if called in channels and unit:
                units[called] = unit
        time = np.concatenate(times).astype(np.float64) if times else None
        if time is not None and master is not None:
            master_channel = group.channels[master]
            unit = str(master_channel.unit or "s").strip()
            clock = clock_in(time, unit)
            time = time if clock is None else clock[0]
            channels.pop(master_channel.name, None) if master_channel.name == "time_s" else None
        return Table(channels, texts, name, time, self._start(), units=units)

    def _start(self) -> datetime | None:
        start = self._file.header.start_time
        return start if isinstance(start, datetime) else None

    def _has_clock(self, group: Any, master: int | None) -> bool:
        if master is not None and _lies_outside(group.channel_group, group.channels[master]):
            name = group.channels[master].name
            if name not in _OURS:  # one of ours is told of as a channel
                self._faults.append(Fault(f"channels.{name}", f"is {_OUTSIDE}"))
            return False
        remote = bool(group.channel_group.flags & 8)
        return remote or (master is not None and group.channels[master].sync_type == _TIME)

    def _can_be_read(self, group: Any, place: int) -> bool:
        """Whether a channel is a row of values; what is none is named, or a fault where a record needs it."""
        channel, depends = group.channels[place], group.channel_dependencies[place]
        if _lies_outside(group.channel_group, channel):
            self._leave_out(channel.name, _OUTSIDE)
        elif depends:
            self._leave_out(channel.name, "an array" if not isinstance(depends[0], tuple) else "a structure")
        elif _has_formula(channel.conversion) and _arithmetic(channel.conversion) is None:
            self._leave_out(channel.name, "converted by a formula that is more than arithmetic: save it converted")
        elif channel.data_type > _STRINGS[-1]:
            self._leave_out(channel.name, "bytes")
        else:
            return True
        return False

    def _leave_out(self, name: str, what: str) -> None:
        if name in _OURS:
            self._faults.append(Fault(f"channels.{name}", f"is {what}"))
        else:
            self._not_kept[name] = what

    def _once(self, name: str, *held: Any) -> str | None:
        """Name of a channel in its group; ours may stand there once, others are told apart by a number."""
        if not any(name in names for names in held):
            return name
        if name in _OURS:
            self._faults.append(Fault(f"channels.{name}", "appears twice"))
            return None
        n = 2
        while any(f"{name} ({n})" in names for names in held):
            n += 1
        return f"{name} ({n})"

    def _samples(self, index: int, place: int, channel: Any, fragment: Any) -> Any:
        """Converted samples of a piece of a group; invalid numbers are NaN, invalid texts None."""
        raw = self._file.get(
            group=index, index=place, data=fragment, samples_only=True, raw=True, ignore_invalidation_bits=True
        )[0]
        raw = np.asarray(raw)
        values = raw if channel.conversion is None else _converted(channel.conversion, raw)
        invalid = np.full(len(values), bool(channel.flags & _ALL_INVALID))
        if channel.flags & _MAY_BE_INVALID:
            bits = self._file.get_invalidation_bits(index, channel.pos_invalidation_bit, fragment, one_piece=True)
            if bits is not None:
                invalid |= np.asarray(bits, dtype=bool)
        if values.ndim == 1 and values.dtype.kind in "fiub":
            values = np.array(values, dtype=np.float64)
            values[invalid] = np.nan
        elif values.ndim == 1 and values.dtype.kind in "SUO":
            values = np.array(values, dtype=object)
            values[invalid] = None
        return values

    def _keep(
        self,
        name: str,
        channel: Any,
        parts: list[Any],
        channels: dict[str, Samples],
        texts: dict[str, list[str | None]],
    ) -> None:
        values = parts[0] if len(parts) == 1 else np.concatenate(parts) if parts else np.empty(0)
        if values.ndim != 1:
            self._leave_out(name, f"an array of {' x '.join(map(str, values.shape[1:]))}")
        elif values.dtype.kind == "f":
            channels[name] = values
        elif values.dtype.kind == "O" and len(values) <= MOST_TEXTS:
            texts[name] = [None if word is None else str(plain(word)).strip("\0 ") for word in values]
        else:
            what = "complex numbers" if values.dtype.kind == "c" else "text" if values.dtype.kind == "O" else "bytes"
            self._leave_out(name, what)


def _lies_outside(group: Any, channel: Any) -> bool:
    """Whether a channel, or the bit that says it is invalid, lies beyond its group's records.

    The library would take the bytes that stand in memory after them: what others sent before, or none of ours.
    """
    if channel.channel_type in _VIRTUAL:
        return False
    bits = max(64, channel.bit_count) if channel.channel_type == _ANY_LENGTH else channel.bit_count
    end = channel.byte_offset + (channel.bit_offset + bits + 7) // 8
    unmarked = channel.flags & _MAY_BE_INVALID and channel.pos_invalidation_bit >= 8 * group.invalidation_bytes_nr
    return bool(end > group.samples_byte_nr or unmarked)


def _leads_astray(group: Any, channel: Any, fragment: Any) -> bool:
    """Whether places of samples of any length run backwards or beyond any file, where the library reads without looking."""
    if channel.channel_type != _ANY_LENGTH:
        return False
    if not fragment.is_record:
        return True
    width = group.samples_byte_nr + group.invalidation_bytes_nr
    n = len(fragment.data) // width
    records = np.frombuffer(fragment.data, np.uint8, n * width).reshape(n, width)
    first = channel.byte_offset
    places = np.ascontiguousarray(records[:, first : first + 8]).view("<u8").reshape(-1)
    return bool(places.max(initial=0) > _FARTHEST or (places[1:] < places[:-1]).any())


def _converted(conversion: Any, raw: Any) -> Any:
    formula = _arithmetic(conversion)
    if formula is None:
        return np.asarray(conversion.convert(raw))
    samples = raw.astype(np.float64)
    return formula(dict.fromkeys(_OPERANDS, samples))


def _arithmetic(conversion: Any) -> Formula | None:
    """The formula of a conversion where it is arithmetic of the sample alone; its library would evaluate any text."""
    if getattr(conversion, "conversion_type", 0) != _ALGEBRAIC:
        return None
    try:
        formula = Formula(str(conversion.formula).strip("\0 "))
    except ValueError:
        return None
    return formula if set(formula.names) <= set(_OPERANDS) else None


def _has_formula(conversion: Any) -> bool:
    """Whether a conversion, or one that it refers to, is a text to be computed; circles have been refused before."""
    waiting, seen = [conversion], set()
    while waiting:
        one = waiting.pop()
        if one is None or isinstance(one, (bytes, str)) or id(one) in seen:
            continue
        seen.add(id(one))
        if getattr(one, "conversion_type", 0) == _ALGEBRAIC:
            return True
        waiting += (getattr(one, "referenced_blocks", None) or {}).values()
    return False
