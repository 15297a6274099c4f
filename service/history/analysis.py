"""What one record says by itself: reduced, compared with the twin, and the key of all that this depends on."""

import hashlib
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from detectors.expectation.residuals import window_residuals
from detectors.reduction.recording import reduce_recording
from detectors.words.flights import Outline
from detectors.words.observation import Observation, Window, WindowKind
from service.history.codec import reduction_from_json, reduction_to_json, residuals_to_json
from service.history.placement import Place
from service.history.setting import Setting
from service.storage.tables import Record
from service.thresholds.layers import Effective
from twin.parameters import PumpType
from twin.recording import Recording
from twin.version import twin_version

_WINDOW_KEYS = ("window_", "pump_off_")


@dataclass(frozen=True, slots=True)
class RecordAnalysis:
    """One record reduced, as it is stored; ``key`` names what it depends on besides the bytes."""

    key: str
    reduction: dict[str, Any]
    residuals: dict[str, Any]


def keep_analysis(row: Record, analysis: RecordAnalysis) -> None:
    """Write an analysis into its record's row."""
    row.reduction, row.residuals, row.reduced_with = analysis.reduction, analysis.residuals, analysis.key


def analysed(recording: Recording, kind: PumpType, setting: Setting, thresholds: Effective) -> RecordAnalysis:
    """Reduce a recording and compare its windows with the twin."""
    pump, circuit = setting.pump_type(kind), setting.circuit_parameters
    reduction = reduce_recording(recording, pump, thresholds.values)
    residuals = {
        str(i): residuals_to_json(window_residuals(window, reduction.zero, pump, circuit))
        for i, window in enumerate(reduction.windows)
        if _is_comparable(window)
    }
    key = analysis_key(kind, setting, thresholds)
    return RecordAnalysis(key, reduction_to_json(reduction), residuals)


def analysis_key(kind: PumpType, setting: Setting, thresholds: Effective) -> str:
    """Key of everything that a record's reduction and residuals depend on besides its bytes."""
    windows = sorted((k, v) for k, v in thresholds.values.items() if k.startswith(_WINDOW_KEYS))
    parts = (twin_version(kind), setting, windows)
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]


def _is_comparable(window: Window) -> bool:
    return window.accepted and window.kind is not WindowKind.PUMP_OFF


def observation_of(row: Record, place: Place, reduction: dict[str, Any]) -> Observation:
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


def observation_at(outline: Outline, reduction: dict[str, Any], flight_hours: float | None) -> Observation:
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
