"""What one record says by itself: reduced, compared with the twin, and the key of all that this depends on."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

from detectors.words.flights import Outline
from detectors.words.observation import Mark, Observation
from service.answers.records import Residual as ResidualAnswer
from service.answers.records import StoredReduction
from service.history import reduced
from service.history.codec import reduction_from_json
from service.history.placement import Place
from service.history.setting import Setting
from service.history.traits import Traits, traits_of
from service.identity import software
from service.storage.tables import Record
from service.thresholds.layers import Effective
from twin.parameters import PumpType
from twin.recording import Recording
from twin.version import numbers_hash

_WINDOW_KEYS = ("window_", "pump_off_")


@dataclass(frozen=True, slots=True)
class RecordAnalysis:
    """One record reduced, as it is stored; ``key`` names what it depends on besides the bytes."""

    key: str
    reduction: StoredReduction
    residuals: dict[str, dict[str, ResidualAnswer]]
    traits: Traits


def keep_analysis(row: Record, analysis: RecordAnalysis) -> None:
    """Write an analysis into its record's row, in the name of this software."""
    row.reduction, row.residuals, row.reduced_with = analysis.reduction, analysis.residuals, analysis.key
    row.reduced_by = dict(software().to_json())
    traits = analysis.traits
    row.samples_hash, row.remarks = traits.samples_hash, list(traits.remarks)
    row.finished_at = None if row.started_at is None else row.started_at + timedelta(seconds=traits.last_s)


def analysed(
    recording: Recording, kind: PumpType, setting: Setting, thresholds: Effective, marks: Sequence[Mark] = ()
) -> RecordAnalysis:
    """Reduce a recording, as far as its marks let it count, and compare its windows with the twin."""
    pump = setting.pump_type(kind)
    made = reduced.reduced(recording, pump, setting.circuit_parameters, thresholds.values, marks)
    key = marked_key(analysis_key(kind, setting, thresholds), marks)
    return RecordAnalysis(key, made.reduction, made.residuals, traits_of(recording, pump))


def marked_key(key: str, marks: Sequence[Mark]) -> str:
    """Key of a record with its marks, in the order of ``marks_of``: that of one without them where it has none."""
    return key if not marks else hashlib.sha256(f"{key} {list(map(repr, marks))}".encode()).hexdigest()[:16]


def analysis_key(kind: PumpType, setting: Setting, thresholds: Effective) -> str:
    """Key of everything that a record's reduction and residuals depend on besides its bytes.

    Sources of the code that makes them, every number of the pump type as its aircraft has it, surroundings, and
    thresholds of windows.
    """
    pump = setting.pump_type(kind)
    windows = sorted((k, v) for k, v in thresholds.values.items() if k.startswith(_WINDOW_KEYS))
    numbers = (numbers_hash(pump), pump.pump.fluid, setting.circuit_parameters)
    parts = (reduced.sources(), kind.name, numbers, setting, windows)
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]


def observation_of(row: Record, place: Place, reduction: StoredReduction) -> Observation:
    """What a stored record tells a history, at the place where the pump really sat."""
    started_at: datetime | None = row.started_at
    if started_at is None:
        raise RuntimeError(f"record {row.id} counts without a start")
    return Observation(
        record_id=row.id,
        at=started_at,
        aircraft=place.aircraft,
        position=place.position,
        flight_id=row.flight_id or "",
        reduction=reduction_from_json(reduction),
        flight_hours=row.flight_hours,
        segment=row.segment or None,
    )


def observation_at(outline: Outline, reduction: StoredReduction, flight_hours: float | None) -> Observation:
    """What a record tells a history, from its outline and its reduction as it is stored."""
    return Observation(
        record_id=outline.record_id,
        at=outline.at,
        aircraft=outline.aircraft,
        position=outline.position,
        flight_id=outline.flight_id,
        reduction=reduction_from_json(reduction),
        flight_hours=flight_hours,
        segment=outline.segment,
    )
