"""What a channel mapping makes of a file: names, units and time inside each table, then what needs the one time base."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase

import numpy as np

from service.errors import Fault
from service.ingest.conversion import Conversion
from service.ingest.csv_words import Words, numbers_of
from service.ingest.file_units import in_own_units, unit_of_file
from service.ingest.formulas import Formula
from service.ingest.mapped_time import with_time
from service.ingest.mapping import ChannelMapping, ChannelRule
from service.ingest.raw import ForeignMetadata, RawFile, RawRecord, Samples, Table
from service.ingest.time_base import on_one_base
from twin.recording import REQUIRED_CHANNELS, TIME


@dataclass(slots=True)
class Account:
    """What each part of a mapping did, in sentences by part, for who tries it."""

    steps: list[tuple[str, str]] = field(default_factory=list)

    def note(self, part: str, did: str) -> None:
        """One more sentence."""
        self.steps.append((part, did))


def mapped_record(file: RawFile, mapping: ChannelMapping | None, account: Account | None = None) -> RawRecord:
    """The file as a record on one time base, with all that a mapping says applied."""
    account = account or Account()
    if mapping is None:
        return on_one_base(in_own_units(file))
    return _finished(on_one_base(mapped(file, mapping, account)), mapping, account)


def mapped(file: RawFile, mapping: ChannelMapping, account: Account | None = None) -> RawFile:
    """The file with its channels, time and metadata under our names and in our units; foreign channels stay as they are."""
    account = account or Account()
    file = _chosen(file, mapping, account)
    faults, references = list(file.faults), dict(file.references)
    rules = _usable(file, mapping, faults)
    tables = []
    words = Words.of(mapping.dialect) if mapping.dialect else None
    for table in file.tables:
        own = [rule for rule in rules if rule.source in _held(table) and _is_of(rule, table)]
        tables.append(_renamed(table, own, rules, faults, references, words, account))
    for rule in mapping.channels:
        if rule.source is None and rule.reference is not None:
            references[rule.channel] = rule.reference
    named = _metadata(file, mapping, account)
    made = replace(
        file,
        metadata=named,
        tables=tuple(tables),
        faults=faults,
        flags=list(file.flags),
        references=references,
    )
    if mapping.time is not None:
        made = with_time(made, mapping.time, account.note)
    elif any(rule.channel == TIME for rule in rules):
        made = replace(made, tables=_from_start(made.tables))
    made.metadata.update(mapping.constants)
    for name, value in mapping.constants.items():
        account.note("constants", f"{name} is {value}")
    return in_own_units(made, {rule.channel for rule in rules})


def _chosen(file: RawFile, mapping: ChannelMapping, account: Account) -> RawFile:
    """The tables that are read, without the columns that are left out."""
    tables, faults = file.tables, list(file.faults)
    if mapping.tables:
        names = [table.name for table in tables]
        tables = tuple(t for t in tables if any(fnmatchcase(t.name, wanted) for wanted in mapping.tables))
        account.note("tables", f"{len(tables)} of {len(names)} tables are read: {', '.join(t.name for t in tables)}")
        if not tables:
            faults.append(Fault("tables", f"none is called so; the file has {', '.join(names[:20]) or 'none'}"))
    if mapping.leave_out:
        gone = [name for table in tables for name in _held(table) if _is_left_out(name, mapping)]
        tables = tuple(_without(table, {n for n in _held(table) if _is_left_out(n, mapping)}) for table in tables)
        account.note("leave_out", f"leaves out {len(gone)} columns{': ' if gone else ''}{', '.join(gone[:20])}")
    return replace(file, tables=tables, faults=faults)


def _is_left_out(name: str, mapping: ChannelMapping) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in mapping.leave_out)


def _without(table: Table, names: set[str]) -> Table:
    return replace(
        table,
        channels={n: v for n, v in table.channels.items() if n not in names},
        texts={n: v for n, v in table.texts.items() if n not in names},
        times={n: v for n, v in table.times.items() if n not in names},
        units={n: v for n, v in table.units.items() if n not in names},
    )


def _held(table: Table) -> dict[str, None]:
    return dict.fromkeys((*table.channels, *table.texts))


def _is_of(rule: ChannelRule, table: Table) -> bool:
    return rule.table is None or fnmatchcase(table.name, rule.table)


def _usable(file: RawFile, mapping: ChannelMapping, faults: list[Fault]) -> list[ChannelRule]:
    """Rules whose source is in the file; a required channel without one and a channel from two places are faults."""
    held = {name for table in file.tables for name in _held(table)}
    sources = {rule.source for rule in mapping.channels}
    rules = []
    for rule in mapping.channels:
        refers_to_itself = rule.formula is not None and rule.channel in Formula(rule.formula).names
        if rule.channel in held and rule.channel not in sources and not refers_to_itself:
            text = f"is in the file, and the mapping takes it from {rule.origin} as well"
            faults.append(Fault(f"channels.{rule.channel}", text))
            continue
        if rule.source is None:
            continue
        places = [t for t in file.tables if rule.source in _held(t) and _is_of(rule, t)]
        if len(places) > 1 and rule.channel != TIME:
            names = ", ".join(t.name or "one without a name" for t in places)
            text = f"is in {len(places)} tables ({names}): say the `table` of the rule for {rule.channel}"
            faults.append(Fault(f"channels.{rule.source}", text))
        elif places:
            rules.append(rule)
        elif rule.channel in REQUIRED_CHANNELS and rule.channel not in held:
            known = ", ".join(list(dict.fromkeys(n for t in file.tables for n in _held(t)))[:20])
            text = f"is not in the file; the mapping takes {rule.channel} from it; the file has {known}"
            faults.append(Fault(f"channels.{rule.origin}", text))
    return rules


def _renamed(
    table: Table,
    own: Sequence[ChannelRule],
    rules: Sequence[ChannelRule],
    faults: list[Fault],
    references: dict[str, str],
    words: Words | None,
    account: Account,
) -> Table:
    """One table with its channels under our names and in our units."""
    taken = {rule.channel for rule in rules} - {rule.channel for rule in own}
    kept = _without(table, {str(rule.source) for rule in own})
    # a channel that a rule takes from another table leaves its name to it
    prefix = f"{table.name}." if table.name else "other "
    channels = {prefix + n if n in taken else n: v for n, v in kept.channels.items()}
    times, units = dict(kept.times), dict(kept.units)
    for rule in own:
        source = str(rule.source)
        if source in table.channels:
            samples = np.asarray(table.channels[source])
        else:
            samples, bad = numbers_of(source, table.texts[source], words)
            faults += bad
        found, word = _conversion(table, rule, faults)
        channels[rule.channel] = found.applied(samples * rule.scale + rule.offset)
        reference = rule.pressure_reference or found.reference
        if reference is not None:
            references[rule.channel] = reference
        if source in table.times:
            times[rule.channel] = table.times[source]
        units.pop(rule.channel, None)
        account.note(f"channels.{rule.channel}", _said(rule, word, reference, channels[rule.channel]))
    return replace(kept, channels=channels, times=times, units=units)


def _conversion(table: Table, rule: ChannelRule, faults: list[Fault]) -> tuple[Conversion, str | None]:
    """Conversion by the rule's unit, else by the file's; two units that differ are a fault."""
    source = str(rule.source)
    of_file = unit_of_file(table.units.get(source), rule.channel)
    if rule.unit is None:
        if of_file is None:
            return rule.conversion, None
        return of_file, f"{table.units[source]} (as the file says)"
    # a scale makes another unit of the samples, whatever the file calls theirs
    ours = rule.conversion
    if of_file is not None and rule.scale == 1.0 and not _agree(ours, of_file):
        text = f"is in {table.units[source]!r} by the file and in {rule.unit!r} by the mapping"
        faults.append(Fault(f"channels.{source}", text))
    return ours, rule.unit


def _agree(one: Conversion, other: Conversion) -> bool:
    return (
        bool(np.isclose(one.slope, other.slope, rtol=1e-3))
        and abs(one.intercept - other.intercept) < 1e-6
        and (None in (one.reference, other.reference) or one.reference == other.reference)
    )


def _said(rule: ChannelRule, unit: str | None, reference: str | None, samples: Samples) -> str:
    known = samples[np.isfinite(samples)]
    spans = f", {known.min():.4g} to {known.max():.4g}" if len(known) else ", no number among them"
    missing = f", {len(samples) - len(known)} missing" if len(known) < len(samples) else ""
    scaled = f", times {rule.scale:g} plus {rule.offset:g}" if (rule.scale, rule.offset) != (1.0, 0.0) else ""
    words = f"from {rule.origin}{scaled}{f' in {unit}' if unit else ''}{f', {reference}' if reference else ''}"
    return f"{words}: {len(samples)} samples{missing}{spans}"


def _from_start(tables: Sequence[Table]) -> tuple[Table, ...]:
    """Time from the first sample: a foreign clock counts from midnight, or from when it was switched on."""
    firsts = [t.channels[TIME][0] for t in tables if TIME in t.channels and len(t.channels[TIME])]
    first = min((f for f in firsts if np.isfinite(f)), default=0.0)
    return tuple(replace(t, channels={n: v - first if n == TIME else v for n, v in t.channels.items()}) for t in tables)


def _metadata(file: RawFile, mapping: ChannelMapping, account: Account) -> ForeignMetadata:
    """Metadata under our names; those of a group by ``group.name``, or by name alone where no other group has it."""
    of_groups: ForeignMetadata = {}
    for table in file.tables:
        for name, value in table.attributes.items():
            of_groups.setdefault(name, value)
            of_groups[f"{table.name}.{name}"] = value
    found: ForeignMetadata = dict(mapping.defaults)
    for name, value in file.metadata.items():
        found[mapping.metadata.get(name, name)] = value
    for foreign, ours in mapping.metadata.items():
        if foreign not in file.metadata and foreign in of_groups:
            found[ours] = of_groups[foreign]
        if ours in found:
            account.note("metadata", f"{ours} is {str(found[ours])[:80]}, from {foreign}")
    for name, value in mapping.defaults.items():
        if name not in file.metadata and found[name] == value:
            account.note("defaults", f"{name} is {value}: the file does not say it")
    return found


def _finished(record: RawRecord, mapping: ChannelMapping, account: Account) -> RawRecord:
    """A record with what needs its time base: gaps filled, delays taken off, constants and formulas."""
    channels, faults = dict(record.channels), list(record.faults)
    time = channels.get(TIME)
    if time is None:
        return record
    for i, rule in enumerate(mapping.channels):
        name = rule.channel
        if rule.value is not None and name not in record.channels:
            number = float(rule.conversion.applied(np.array([rule.value * rule.scale + rule.offset]))[0])
            channels[name] = np.full(len(time), number)
            account.note(f"channels.{name}", f"is the constant {number:g}")
        elif rule.formula is not None and not any(f.where == f"channels.{name}" for f in record.faults):
            _compute(rule, i, channels, faults, account)
        if name in channels and len(channels[name]) == len(time):
            if rule.between is not None:
                channels[name], n_filled = _filled(time, channels[name], rule)
                account.note(f"channels.{name}", f"{n_filled} samples between others: {rule.between}")
            if rule.delay_s:
                channels[name] = _earlier(time, channels[name], rule.delay_s)
                account.note(f"channels.{name}", f"is moved {rule.delay_s:g} s earlier")
    return replace(record, channels=channels, faults=faults)


def _compute(
    rule: ChannelRule, place: int, channels: dict[str, Samples], faults: list[Fault], account: Account
) -> None:
    formula = Formula(str(rule.formula))
    lacking = [name for name in formula.names if name not in channels]
    if lacking:
        text = f"needs {', '.join(lacking)}, which the record has not at this place; it has {', '.join(channels)}"
        faults.append(Fault(f"mapping.channels.{place}.formula", text[:600]))
        return
    lengths = {len(channels[name]) for name in formula.names}
    if len(lengths) > 1:
        faults.append(Fault(f"mapping.channels.{place}.formula", "takes channels of unequal length"))
        return
    samples = rule.conversion.applied(formula(channels) * rule.scale + rule.offset)
    channels[rule.channel] = samples
    account.note(f"channels.{rule.channel}", _said(rule, rule.unit, rule.reference, samples))


def _filled(time: Samples, samples: Samples, rule: ChannelRule) -> tuple[Samples, int]:
    """Missing samples from the known ones around them, where these are no further apart than the rule says."""
    known = np.flatnonzero(np.isfinite(samples) & np.isfinite(time))
    wanted = np.flatnonzero(~np.isfinite(samples) & np.isfinite(time))
    if len(known) < 2 or not len(wanted):
        return samples, 0
    after = np.searchsorted(known, wanted)
    inside = (after > 0) & (after < len(known)) if rule.between == "linear" else after > 0
    wanted, after = wanted[inside], after[inside]
    before, following = known[after - 1], known[np.minimum(after, len(known) - 1)]
    age = time[wanted] - time[before] if rule.between == "hold" else time[following] - time[before]
    near = age <= rule.between_s
    wanted, before, following = wanted[near], before[near], following[near]
    filled = samples.copy()
    filled[wanted] = samples[before]
    if rule.between == "linear":
        with np.errstate(all="ignore"):
            share = (time[wanted] - time[before]) / (time[following] - time[before])
        filled[wanted] += np.nan_to_num(share) * (samples[following] - samples[before])
    return filled, len(wanted)


def _earlier(time: Samples, samples: Samples, delay_s: float) -> Samples:
    """What the channel was when it happened: linear between samples, NaN beyond the ends and beside missing ones."""
    known = np.isfinite(time)
    if known.sum() < 2 or (np.diff(time[known]) <= 0.0).any():
        return samples
    shifted = np.full(len(samples), np.nan)
    shifted[known] = np.interp(time[known] + delay_s, time[known], samples[known], left=np.nan, right=np.nan)
    return shifted
