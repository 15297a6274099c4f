"""From files to a verdict without a server or a database: the same ingest, the same fold."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import timedelta
from pathlib import Path
from typing import Any

from detectors.curve.points import Curve, damage_identification_curve, latest_condition
from detectors.expectation.residuals import window_residuals
from detectors.judgement.succession import Judged, assess_together
from detectors.judgement.version import twin_version
from detectors.reduction.recording import reduce_recording
from detectors.words.observation import History, Observation, Residual
from detectors.words.thresholds import effective
from detectors.words.verdict import Assessment
from service.answers.verdicts import Verdict
from service.errors import Problem
from service.history.codec import trend_to_json, verdict_to_json
from service.history.contradictions import Said, copies, names_alike, remarks_on
from service.history.setting import DEFAULT_CIRCUIT
from service.history.traits import Traits, traits_of, without_evidence
from service.identity import software
from service.ingest.decode import DEFAULT_PUMP_TYPE, Limits, decode
from service.ingest.file_names import named_by
from service.ingest.mapping import ChannelMapping
from service.ingest.metadata import RecordMetadata, TypeLookup, built_in
from service.ingest.upload_files import content_type_of
from service.reading.forecast import crossed
from service.reading.queries import TrendOfRecord
from service.storage.raw_store import content_hash
from twin.parameters import Circuit, PumpType
from twin.pumps import circuit_parameters, pump_type


@dataclass(frozen=True, slots=True)
class AnalysedFile:
    """One good file: its pump, what it was reduced to, and the residuals of its zero-flow window."""

    path: Path
    serial: str
    observation: Observation
    residuals: dict[str, Residual]
    said: Said
    remarks: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class AnalysedPump:
    """All files of one pump, folded; ``verdict`` is the last one as the API would give it."""

    serial: str
    files: tuple[AnalysedFile, ...]
    assessments: tuple[Assessment, ...]
    verdict: Verdict
    curve: Curve


@dataclass(frozen=True, slots=True)
class OfflineAnalysis:
    """Pumps found in the files, and the files that were refused with the reason."""

    pumps: tuple[AnalysedPump, ...]
    refused: tuple[tuple[Path, Problem], ...]


def analyse_files(
    paths: Sequence[Path],
    limits: Limits,
    named: Callable[[Path], Mapping[str, Any]] | None = None,
    instead: PumpType | None = None,
    mapping: ChannelMapping | None = None,
) -> OfflineAnalysis:
    """Analyse files of any number of pumps; a bad file costs its neighbours nothing.

    Parameters
    ----------
    paths, limits
        Files, and how much each may hold.
    named
        Metadata of a file that win over its own; it may raise a ``Problem``.
    instead
        Pump type that all are judged by, whatever they name.
    mapping
        Channel mapping that the files need.
    """
    types: TypeLookup = built_in if instead is None else lambda _operator, _name: instead
    circuit = circuit_parameters(DEFAULT_CIRCUIT)
    by_pump: dict[tuple[str, str], dict[str, AnalysedFile]] = {}
    refused: list[tuple[Path, Problem]] = []
    for path in paths:
        content = path.read_bytes()
        try:
            given = {} if named is None else {name: str(value) for name, value in named(path).items()}
            overrides = named_by(mapping.name_pattern if mapping else None, path.name, given)
            decoded = decode(content, content_type_of(path), "", overrides, limits, mapping=mapping, types=types)
        except Problem as problem:
            refused.append((path, problem))
            continue
        metadata = decoded.metadata
        kind = instead or pump_type(metadata.pump_type or DEFAULT_PUMP_TYPE)
        reduction = reduce_recording(decoded.recording, kind, effective({}, kind))
        traits = traits_of(decoded.recording, kind)
        observation = Observation(
            record_id=content_hash(content)[:32],
            at=metadata.started_at,
            aircraft=metadata.aircraft,
            position=metadata.position,
            flight_id=metadata.flight_id,
            reduction=reduction,
            flight_hours=metadata.flight_hours,
            segment=metadata.segment or None,
        )
        window = reduction.zero_flow
        residuals = window_residuals(window, reduction.zero, kind, circuit) if window else {}
        files = by_pump.setdefault((metadata.pump_serial, kind.name), {})
        said = _said(metadata, observation.record_id, traits)
        files[observation.record_id] = AnalysedFile(
            path, metadata.pump_serial, observation, residuals, said, traits.remarks
        )
    gathered: list[_Gathered] = []
    for (serial, name), files in sorted(by_pump.items()):
        kind = instead or pump_type(name)
        own = [f.said for f in files.values()]
        again = copies(own)
        observations = tuple(
            replace(f.observation, reduction=without_evidence(f.observation.reduction)) if i in again else f.observation
            for i, f in files.items()
        )
        gathered.append((serial, kind, files, History(observations), _flags(files, own)))
    pumps = []
    for (serial, kind, files, history, flags), judged in zip(gathered, _together(gathered, circuit), strict=True):
        observations, thresholds, assessments = history.observations, effective({}, kind), judged.assessments
        condition = latest_condition(observations, kind)
        curve = damage_identification_curve(history, kind, circuit, thresholds, condition, others=judged.others)
        verdict = _verdict(assessments, files, kind, thresholds)
        verdict["quality"]["flags"] += flags
        pumps.append(AnalysedPump(serial, tuple(files.values()), assessments, verdict, curve))
    return OfflineAnalysis(tuple(pumps), tuple(refused))


_Gathered = tuple[str, PumpType, dict[str, AnalysedFile], History, list[str]]
"""Serial, type, files, history and flags of a pump."""


def _together(gathered: Sequence[_Gathered], circuit: Circuit) -> list[Judged]:
    """Pumps of one type judged together, as a service does it, in the order given."""
    found: dict[int, Judged] = {}
    for name in {kind.name for _, kind, *_ in gathered}:
        places = [i for i, (_, kind, *_) in enumerate(gathered) if kind.name == name]
        kind = gathered[places[0]][1]
        judged = assess_together([gathered[i][3] for i in places], kind, circuit, effective({}, kind))
        found |= dict(zip(places, judged, strict=True))
    return [found[i] for i in range(len(gathered))]


def _said(metadata: RecordMetadata, record_id: str, traits: Traits) -> Said:
    names = (metadata.flight_id, metadata.segment, metadata.aircraft, metadata.position)
    until = metadata.started_at + timedelta(seconds=traits.last_s)
    hours, samples = metadata.flight_hours, traits.samples_hash
    return Said(record_id, metadata.pump_serial, *names, metadata.started_at, until, hours, samples)


def _flags(files: Mapping[str, AnalysedFile], own: Sequence[Said]) -> list[str]:
    """Remarks on the files of one pump, counted, as a stored verdict has them."""
    found = remarks_on(own, {}, ())
    counts = Counter(words for i, f in files.items() for words in (*f.remarks, *found.get(i, ())))
    flags = [f"{words} ({n} record{'s' if n > 1 else ''})" for words, n in sorted(counts.items())]
    return names_alike(own) + flags


def _verdict(
    assessments: Sequence[Assessment],
    files: Mapping[str, AnalysedFile],
    kind: PumpType,
    thresholds: Mapping[str, float],
) -> Verdict:
    """The last verdict with its chance of crossing, by thresholds that nobody has set (version 0)."""
    rows = []
    for assessment in assessments:
        seen = files[assessment.record_id].observation
        state, trend = assessment.verdict.state.value, trend_to_json(assessment.trend)
        rows.append(TrendOfRecord(seen.at, seen.aircraft, seen.position, seen.flight_hours, state, trend))
    last = verdict_to_json(assessments[-1].verdict, twin_version(kind), 0, software().to_json())
    return crossed(last, rows, (), thresholds)
