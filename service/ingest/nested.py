"""Nested groups of a file (HDF5, MATLAB) as tables: vectors are columns, single values metadata, each group a table.

A group that holds ``data`` and perhaps ``time`` and ``units`` is one column with a clock of its own, as MATLAB writes
timeseries. A group without a clock takes that of the group that encloses it, for columns of the same length.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from service.ingest.raw import ForeignMetadata, RawFile, Samples, Table, plain
from service.ingest.time_words import TimesAndStart, clock_in, instant, is_time_name
from twin.recording import TIME

MOST_TEXTS = 200_000
"""Entries of a column of text that are handed on, for a mapping to read; longer ones are named as not kept."""
NAMES_OF_ENTRIES = ("name", "Name", "channel", "Channel", "label")
"""Fields by which the entries of an array of structs call themselves."""
_DATA = ("data", "value", "values", "samples")
_TIMES = ("time", "times", "t", "timestamps")
_UNITS = ("units", "unit")


@dataclass(frozen=True, slots=True)
class Leaf:
    """One value of a file.

    Attributes
    ----------
    value
        Samples of shape (n,), texts as a list, or a single text or number; None where it cannot be kept.
    unit
        As the file gives it.
    what
        What it is where it cannot be kept.
    axis
        Dimension scale that the file attaches to it.
    """

    value: Any
    unit: str = ""
    what: str = ""
    axis: "Leaf | None" = None


Tree = dict[str, "Leaf | Tree"]


@dataclass(slots=True)
class _Found:
    tables: list[Table] = field(default_factory=list)
    not_kept: dict[str, str] = field(default_factory=dict)


def leaf_of(array: Any, unit: str = "", axis: Leaf | None = None) -> Leaf:
    """An array of a file as numbers, texts or what it is instead; rows and columns are vectors alike."""
    array = np.asarray(array)
    kind = array.dtype.kind
    if kind in "SUO" and all(isinstance(entry, (str, bytes)) for entry in array.reshape(-1)[:MOST_TEXTS]):
        words = [str(plain(entry)).strip() for entry in array.reshape(-1)[:MOST_TEXTS]]
        if array.size > MOST_TEXTS:
            return Leaf(None, what="text")
        return Leaf(words[0] if len(words) == 1 else words)
    if kind not in "fiub":
        return Leaf(None, what="complex numbers" if kind == "c" else f"of the type {array.dtype}"[:100])
    if array.size == 1:
        return Leaf(plain(array), unit)
    if max(array.shape, default=0) != array.size:
        return Leaf(None, what=matrix(array.shape))
    return Leaf(np.array(array.reshape(-1), dtype=np.float64), unit, axis=axis)


def by_name(name: str, structs: list[Tree]) -> Tree:
    """Entries of an array of structs under what each calls itself, else under their place."""
    found: Tree = {}
    for i, entry in enumerate(structs):
        called = next((leaf for key in NAMES_OF_ENTRIES if isinstance(leaf := entry.get(key), Leaf)), Leaf(None)).value
        place = f"{name}({i + 1})"
        found[called if isinstance(called, str) and called and called not in found else place] = entry
    return found


def matrix(shape: tuple[int, ...]) -> str:
    """What something of more than one dimension is."""
    return f"a matrix of {' x '.join(map(str, shape))}"


def tables_of(tree: Tree, file: RawFile | None = None) -> RawFile:
    """A file's tree as tables, single values at its root as metadata; ``file`` may say more of either."""
    found = _Found()
    metadata = {name: leaf.value for name, leaf in tree.items() if isinstance(leaf, Leaf) and _is_single(leaf)}
    _walk(tree, "", None, found)
    if file is None:
        return RawFile(metadata, tuple(found.tables), not_kept=found.not_kept)
    return RawFile(
        file.metadata | metadata, tuple(found.tables), file.faults, file.not_kept | found.not_kept, file.flags
    )


def _walk(group: Tree, path: str, enclosing: TimesAndStart | None, found: _Found) -> None:
    channels: dict[str, Samples] = {}
    texts: dict[str, list[str | None]] = {}
    times: dict[str, Samples] = {}
    units: dict[str, str] = {}
    children: dict[str, Tree] = {}
    attributes: ForeignMetadata = {}
    own_starts: dict[str, TimesAndStart] = {}
    for name, item in group.items():
        series = _series(item) if isinstance(item, dict) else None
        if series is None and isinstance(item, dict):
            children[name] = item
            continue
        leaf, clock = series or (item, None)
        if not isinstance(leaf, Leaf):
            continue
        if leaf.value is None:
            found.not_kept[f"{path}/{name}" if name in found.not_kept else name] = leaf.what
        elif isinstance(leaf.value, np.ndarray):
            channels[name] = leaf.value
            if leaf.unit:
                units[name] = leaf.unit
            clock = clock or _by_axis(leaf)
            if clock is not None:
                own_starts[name] = clock
        elif isinstance(leaf.value, list):
            texts[name] = leaf.value
        elif path:
            attributes[name] = leaf.value
    clock = _clock(channels, units) or enclosing
    if channels or texts or attributes:
        # clocks of single columns that start at another instant make tables of their own
        starts = [own[1] for own in ([clock] if clock is not None else []) + list(own_starts.values())]
        start = starts[0] if starts else None
        apart = {name for name, own in own_starts.items() if own[1] != start}
        times = {name: own[0] for name, own in own_starts.items() if name not in apart}
        kept = {name: samples for name, samples in channels.items() if name not in apart}
        made = None if clock is None or TIME in channels else clock[0]
        found.tables.append(Table(kept, texts, path, made, start, times, units, attributes))
        for name in apart:
            own = own_starts[name]
            found.tables.append(Table({name: channels[name]}, {}, f"{path}/{name}", own[0], own[1], units=units))
    for name, child in children.items():
        _walk(child, f"{path}/{name}" if path else name, clock, found)


def _is_single(leaf: Leaf) -> bool:
    return leaf.value is not None and not isinstance(leaf.value, (np.ndarray, list))


def _clock(channels: dict[str, Samples], units: dict[str, str]) -> TimesAndStart | None:
    """Clock of a group: ``time_s``, or a column that is called time and says its unit.

    A ``time_s`` that counts since an instant counts from the group's start afterwards.
    """
    if TIME in channels:
        stated = clock_in(channels[TIME], units.get(TIME, ""))
        if stated is None or stated[1] is None:
            return channels[TIME], None
        channels[TIME] = stated[0]
        del units[TIME]
        return stated
    for name, samples in channels.items():
        if is_time_name(name) and name in units:
            clock = clock_in(samples, units[name])
            if clock is not None:
                return clock
    return None


def _by_axis(leaf: Leaf) -> TimesAndStart | None:
    axis = leaf.axis
    if axis is None or not isinstance(axis.value, np.ndarray) or axis.value is leaf.value:
        return None
    return clock_in(axis.value, axis.unit)


def _series(group: Tree) -> tuple[Leaf, TimesAndStart | None] | None:
    """The column that a group of ``data``, ``time`` and ``units`` is, with its clock; None for any other group."""
    lower = {name.lower(): item for name, item in group.items()}
    data = next((item for name in _DATA if isinstance(item := lower.get(name), Leaf)), None)
    if data is None or not isinstance(data.value, (np.ndarray, list)):
        return None
    others = [name for name, item in lower.items() if isinstance(item, Leaf) and isinstance(item.value, np.ndarray)]
    if any(name not in (*_DATA, *_TIMES) for name in others):
        return None
    unit = data.unit or _text(lower, _UNITS) or _text(lower.get("datainfo"), _UNITS)
    leaf = Leaf(data.value, unit, axis=data.axis)
    if isinstance(data.value, list):
        return leaf, None
    time = next((item for name in _TIMES if isinstance(item := lower.get(name), Leaf)), None)
    if time is None or not isinstance(time.value, np.ndarray):
        return leaf, None
    info = lower.get("timeinfo")
    clock = clock_in(time.value, time.unit or _text(info, _UNITS) or "s")
    if clock is None:
        return leaf, None
    return leaf, (clock[0], clock[1] or instant(_text(info, ("startdate",))))


def _text(group: Any, names: tuple[str, ...]) -> str:
    """First text under one of these names, in any case; empty without one."""
    if not isinstance(group, dict):
        return ""
    lower = {name.lower(): item for name, item in group.items()}
    found = (item.value for name in names if isinstance(item := lower.get(name), Leaf))
    return next((value for value in found if isinstance(value, str)), "")
