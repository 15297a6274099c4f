"""A channel mapping proposed for a file: by names, units and behaviour of its columns, each with its certainty.

It is a proposal: a person confirms it, and nothing is stored.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from service.answers.documents import JsonObject
from service.answers.mappings import MappingSuggestion, SuggestedChannel
from service.answers.problems import ProblemError
from service.bodies import is_storable
from service.errors import Invalid
from service.ingest.behaviour import GUESSES, Mask, guessed_unit, running, seen
from service.ingest.channel_words import metadata_of, spoken_for, unit_in
from service.ingest.decode import DEFAULT_PUMP_TYPE, checked
from service.ingest.file_units import measures_something_else, unit_of_file
from service.ingest.mapping import CHANNELS, ChannelMapping
from service.ingest.metadata import TEXTS_REQUIRED
from service.ingest.raw import ForeignMetadata, RawFile, Samples, Table
from service.ingest.suggested_time import ChannelFound, TimeFound, time_of
from service.ingest.text_look import Look
from twin.pumps import PUMP_TYPES
from twin.recording import REQUIRED_CHANNELS, TIME

_KIND = PUMP_TYPES[DEFAULT_PUMP_TYPE]
_ENOUGH = 0.3
_ENOUGH_UNNAMED = 0.2
_UNNAMED = re.compile(r"(column )?\d+")
_PERCENT = 0.01
_UNUSUAL = 0.1
_LONGEST_NAME = 100
_SURE = 0.8
_CLOSE = 0.15
_ATMOSPHERE = (0.85, 1.15)
_Value = TypeVar("_Value")


@dataclass(slots=True)
class _Candidate:
    """A column that may be a channel."""

    channel: str
    source: str
    table: Table
    score: float
    unit: str | None
    because: list[str] = field(default_factory=list)
    scale: float = 1.0


def suggestion(file: RawFile, text: Look | None, named: ForeignMetadata | None = None) -> MappingSuggestion:
    """What a file seems to need.

    Parameters
    ----------
    file
        The file, read as ``text`` says where it is text.
    text
        How the text is written; None for other formats.
    named
        Metadata that the request says.
    """
    file = _nameable(file)
    told = list(text.could_not_tell) if text else []
    clock = time_of(file, told)
    taken = set(clock.columns)
    chosen, candidates = _assigned(file, taken)
    channels = [_rule(c, file) for c in chosen.values() if not _is_ours(c)]
    document: JsonObject = {"channels": channels}
    if text is not None:
        document["csv"] = text.rule.model_dump(mode="json", exclude_defaults=True)
    if clock.rule is not None:
        document["time"] = clock.rule
    elif clock.channel is not None and clock.channel["source"] != TIME:
        channels.insert(0, clock.channel)
    metadata = _metadata(file)
    if metadata:
        document["metadata"] = metadata
    _tell(file, chosen, clock, metadata, {**(named or {})}, told)
    if text is not None and text.preamble:
        told.append(f"lines before the header are not read as metadata, the first is {text.preamble[0][:80]!r}")
    document = {name: value for name, value in document.items() if value}
    mapping = ChannelMapping.model_validate(document)
    faults: list[ProblemError] = []
    try:
        checked(file, named or {}, mapping=mapping)
    except Invalid as problem:
        faults = [{"where": f.where, "problem": f.problem} for f in problem.errors]
    return {
        "mapping": document,
        "channels": [_told(name, chosen, candidates, clock) for name in CHANNELS if _is_worth_telling(name, chosen)],
        "could_not_tell": list(dict.fromkeys(told)),
        "looked_at": [*(text.notes if text else []), *clock.notes],
        "faults": faults,
    }


def _nameable(file: RawFile) -> RawFile:
    """The file without columns and metadata whose names no mapping can hold."""

    def kept(values: Mapping[str, _Value]) -> dict[str, _Value]:
        return {n: v for n, v in values.items() if 0 < len(n) <= _LONGEST_NAME and is_storable(n)}

    tables = tuple(
        replace(
            t,
            channels=kept(t.channels),
            texts=kept(t.texts),
            attributes=kept(t.attributes),
            name=t.name if is_storable(t.name) and len(t.name) <= _LONGEST_NAME else "",
        )
        for t in file.tables
    )
    return replace(file, tables=tables, metadata=kept(file.metadata))


def _is_ours(candidate: _Candidate) -> bool:
    return candidate.source == candidate.channel


def _is_worth_telling(name: str, chosen: dict[str, _Candidate]) -> bool:
    return name in chosen or name in REQUIRED_CHANNELS


def _assigned(file: RawFile, taken: set[str]) -> tuple[dict[str, _Candidate], list[_Candidate]]:
    """The best column of each channel, no column twice; speed first, as it says when the pump runs."""
    columns = [(t, n, s) for t in file.tables for n, s in t.channels.items() if n not in taken]
    everywhere: dict[int, Mask] = {id(t): running(None, None, len(s)) for t, _, s in columns}
    first = [_candidate("shaft_speed_rpm", t, n, s, everywhere[id(t)]) for t, n, s in columns]
    speed = max((c for c in first if c is not None), key=lambda c: c.score, default=None)
    fast = speed if speed is not None and speed.score >= _least(speed) else None
    runs = {
        id(t): running(t.channels[fast.source] if fast and t is fast.table else None, _largest(t), len(s))
        for t, _, s in columns
    }
    made = (_candidate(c, t, n, s, runs[id(t)]) for c in CHANNELS if c != TIME for t, n, s in columns)
    candidates = sorted((c for c in made if c is not None), key=lambda c: -c.score)
    chosen: dict[str, _Candidate] = {}
    used: set[tuple[int, str]] = set()
    for candidate in candidates:
        place = (id(candidate.table), candidate.source)
        if candidate.score >= _least(candidate) and candidate.channel not in chosen and place not in used:
            chosen[candidate.channel] = candidate
            used.add(place)
    return chosen, candidates


def _largest(table: Table) -> Samples | None:
    """The column that speaks most for a discharge pressure, to tell when the pump runs."""
    named = [(spoken_for(n, "discharge_pressure_bar"), n) for n in table.channels]
    best = max(named, default=(0.0, ""))
    return table.channels[best[1]] if best[0] > 0.0 else None


def _candidate(channel: str, table: Table, name: str, samples: Samples, runs: Mask) -> _Candidate | None:
    """What speaks for a column as a channel; None where its unit or its values speak against it."""
    spoken, scale = spoken_for(name, channel), 1.0
    stated = table.units.get(name) or unit_in(name)
    if name == channel:
        stated = stated or None
    because = [f"its name speaks for it ({spoken:.0%})"] if spoken else []
    of_file = unit_of_file(stated, channel)
    measured = ("bar" in channel) or ("lpm" in channel) or ("rpm" in channel) or ("degc" in channel)
    score = 0.5 * spoken
    if of_file is not None and measured:
        behaviour = seen(channel, of_file.applied(samples), runs, _KIND)
        score += 0.2
        because.append(f"{stated} is a unit of it")
        unit = stated
    elif stated is not None and channel == "shaft_speed_rpm" and _is_share(stated):
        scale, unit = _KIND.nominal_speed_rpm / 100.0, None
        behaviour = seen(channel, samples * scale, runs, _KIND)
        because.append(f"{stated} of the nominal speed, {_KIND.nominal_speed_rpm:g} rpm, is a guess")
    elif stated is not None and measures_something_else(stated, channel):
        return None
    elif name == channel or channel not in GUESSES:
        unit, behaviour = None, seen(channel, samples, runs, _KIND)
    else:
        unit, behaviour = guessed_unit(channel, samples, runs, _KIND)
        if spoken == 0.0 and unit != GUESSES[channel][0]:
            score -= (
                _UNUSUAL  # neither a name nor a unit: only the values speak, and units to choose from make them speak
            )
        if behaviour.fits > 0.0:
            because.append(f"its unit is not said; in {unit} it behaves like one")
    if spoken == 0.0 and (of_file is None or not measured) and channel not in GUESSES:
        return None
    because.append(behaviour.what)
    if name == channel:
        score = 0.97 if behaviour.fits >= 0.0 else 0.6
    elif behaviour.fits < 0.0:
        score += 0.4 * behaviour.fits
    else:
        score += 0.35 * behaviour.fits
    return _Candidate(channel, name, table, score, unit, because, scale)


def _is_share(unit: str) -> bool:
    """Whether a unit is percent."""
    found = unit_of_file(unit, "flight_control_activity")
    return found is not None and found.slope == _PERCENT


def _least(candidate: _Candidate) -> float:
    """Score from which a candidate is taken: where columns have no names, what they do has to do."""
    return _ENOUGH_UNNAMED if _UNNAMED.fullmatch(candidate.source) else _ENOUGH


def _rule(candidate: _Candidate, file: RawFile) -> ChannelFound:
    rule: ChannelFound = {"source": candidate.source, "channel": candidate.channel}
    if candidate.scale != 1.0:
        rule["scale"], rule["unit"] = candidate.scale, "rpm"
    said = candidate.table.units.get(candidate.source)
    if candidate.unit is not None and said != candidate.unit:
        rule["unit"] = candidate.unit
    if sum(candidate.source in t.channels for t in file.tables) > 1 and candidate.table.name:
        rule["table"] = candidate.table.name
    return rule


def _told(name: str, chosen: dict[str, _Candidate], candidates: list[_Candidate], clock: TimeFound) -> SuggestedChannel:
    if name == TIME:
        return {
            "channel": TIME,
            "source": ", ".join(clock.columns) or clock.by_format,
            "unit": (clock.channel or {}).get("unit"),
            "certainty": round(clock.certainty, 2),
            "because": clock.notes,
            "alternatives": [],
        }
    found = chosen.get(name)
    others = [c for c in candidates if c.channel == name and (found is None or c.source != found.source)]
    if found is None:
        return {
            "channel": name,
            "source": None,
            "unit": None,
            "certainty": 0.0,
            "because": ["no column seems to be it"],
            "alternatives": [c.source for c in others[:3] if c.score > 0.1],
        }
    taken = {c.source for c in chosen.values()}
    rivals = [c for c in others if c.score > found.score - _CLOSE and c.source not in taken]
    certainty = min(0.99, found.score) - (0.25 if rivals else 0.0)
    return {
        "channel": name,
        "source": found.source,
        "unit": found.unit,
        "certainty": round(max(0.05, certainty), 2),
        "because": found.because,
        "alternatives": [c.source for c in rivals[:3]],
    }


def _metadata(file: RawFile) -> dict[str, str]:
    """Foreign names of metadata that seem to be ours; of groups where the file has them not."""
    found: dict[str, str] = {}
    places = [(name, name) for name in file.metadata]
    places += [(name, f"{t.name}.{name}" if t.name else name) for t in file.tables for name in t.attributes]
    held = {name for name, _ in places}
    for name, place in places:
        ours = metadata_of(name)
        if ours is not None and ours != name and ours not in held and ours not in found.values():
            found[place] = ours
    return found


def _tell(
    file: RawFile,
    chosen: dict[str, _Candidate],
    clock: TimeFound,
    metadata: dict[str, str],
    named: ForeignMetadata,
    told: list[str],
) -> None:
    """What a person has to say."""
    told += [
        f"no column seems to be {name}: name its source, give a constant `value`, or a `formula`"
        for name in REQUIRED_CHANNELS
        if name not in chosen and name != TIME
    ]
    told += [
        f"{name} from {candidate.source} is not certain: {'; '.join(candidate.because)}"
        for name, candidate in chosen.items()
        if candidate.score < _SURE
    ]
    known = {*file.metadata, *metadata.values(), *named, *(n for t in file.tables for n in t.attributes)}
    lacking = [name for name in (*TEXTS_REQUIRED, "started_at") if name not in known]
    if clock.says_start and "started_at" in lacking:
        lacking.remove("started_at")
    if lacking:
        told.append(
            f"the file does not say {', '.join(lacking)}: give them with the upload, as `defaults`, or by a pattern of "
            "the file's name (`file_name`)"
        )
    for name in ("case_pressure_bar", "reservoir_pressure_bar"):
        found = chosen.get(name)
        level = _at_rest(found, chosen.get("shaft_speed_rpm")) if found else None
        if level is not None and _ATMOSPHERE[0] < level < _ATMOSPHERE[1]:
            told.append(f"{name} is {level:.3g} bar at rest: if that is absolute, say pressure_reference absolute")


def _at_rest(found: _Candidate, speed: _Candidate | None) -> float | None:
    """Level of a pressure at rest [bar]; None where its unit says a reference or nothing rests."""
    converted = unit_of_file(found.unit or "bar", found.channel)
    if converted is None or converted.reference is not None or speed is None or speed.table is not found.table:
        return None
    samples = converted.applied(found.table.channels[found.source])
    speeds = found.table.channels[speed.source]
    if len(speeds) != len(samples) or not np.isfinite(speeds).any():
        return None
    rests = np.abs(np.nan_to_num(speeds)) < 0.05 * float(np.nanmax(np.abs(speeds)))
    known = samples[rests & np.isfinite(samples)]
    return float(np.median(known)) if len(known) else None
