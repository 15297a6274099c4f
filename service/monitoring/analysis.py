"""What one record says, and the fold over everything that is known of its pump."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from detectors.assessment import assess
from detectors.observation import History, Observation, Window, WindowKind
from detectors.reduction import reduce_recording
from detectors.residuals import window_residuals
from detectors.verdict import SIDE_OF, UNINFORMED, Assessment, Quality, State, Verdict
from detectors.wording import advice
from service.alarms.ledger import follow
from service.monitoring.codec import (
    reduction_from_json,
    reduction_to_json,
    residuals_to_json,
    trend_to_json,
    verdict_to_json,
)
from service.tables import ANALYSED, Pump, Record, StoredAssessment
from service.threshold_layers import Effective, effective_thresholds, pump_scopes
from twin.parameters import Circuit
from twin.pumps import circuit_parameters, pump_type
from twin.recording import Recording
from twin.version import twin_version

CIRCUIT = "shared_return"
"""Circuit of every aircraft until a registry of aircraft says otherwise."""


@dataclass(frozen=True, slots=True)
class RecordAnalysis:
    """One record reduced, as it is stored."""

    reduction: dict[str, Any]
    residuals: dict[str, Any]


def thresholds_of(session: Session, operator: str, serial: str, kind: str) -> Effective:
    """Effective thresholds of one pump."""
    return effective_thresholds(session, pump_scopes(operator, serial, kind))


def analysed(recording: Recording, kind: str, thresholds: Effective) -> RecordAnalysis:
    """Reduce a recording and compare its windows with the twin."""
    pump, circuit = pump_type(kind), circuit_parameters(CIRCUIT)
    reduction = reduce_recording(recording, pump, thresholds.values)
    residuals = {
        str(i): residuals_to_json(window_residuals(window, reduction.zero, pump, circuit))
        for i, window in enumerate(reduction.windows)
        if _is_comparable(window)
    }
    return RecordAnalysis(reduction_to_json(reduction), residuals)


def _is_comparable(window: Window) -> bool:
    return window.accepted and window.kind is not WindowKind.PUMP_OFF


def refold(session: Session, pump: Pump) -> None:
    """Fold the pump's history anew and store an assessment per record.

    The caller holds the pump's row lock (Postgres) or the write transaction (SQLite), so that two uploads for one
    pump follow each other.
    """
    thresholds = thresholds_of(session, pump.operator, pump.serial, pump.pump_type)
    version = twin_version(pump_type(pump.pump_type))
    assessments = fold(session, pump, thresholds)
    session.execute(delete(StoredAssessment).where(StoredAssessment.pump_id == pump.id))
    session.add_all(
        StoredAssessment(
            record_id=a.record_id,
            pump_id=pump.id,
            at=a.at,
            state=a.verdict.state.value,
            trend=trend_to_json(a.trend),
            verdict=verdict_to_json(a.verdict, version, thresholds.version),
        )
        for a in assessments
    )
    follow(session, pump, thresholds.values)


def fold(
    session: Session, pump: Pump, thresholds: Effective, reductions: Mapping[str, dict[str, Any]] | None = None
) -> tuple[Assessment, ...]:
    """Assess a pump's stored history without writing; ``reductions`` by record stand in for the stored ones."""
    rows = session.scalars(select(Record).where(Record.pump_id == pump.id, Record.status == ANALYSED)).all()
    observations = tuple(observation_of(row, (reductions or {}).get(row.id)) for row in rows)
    return assess(History(observations), pump_type(pump.pump_type), circuit_parameters(CIRCUIT), thresholds.values)


def observation_of(row: Record, reduction: dict[str, Any] | None = None) -> Observation:
    """What a stored record tells a history."""
    started_at: datetime | None = row.started_at
    document = row.reduction if reduction is None else reduction
    if started_at is None or document is None:
        raise RuntimeError(f"record {row.id} counts as analysed without a reduction")
    return Observation(
        # the content decides the order of records of the same instant, not the order of their arrival
        record_id=row.id,
        at=started_at,
        aircraft=row.aircraft or "",
        position=row.position or "",
        flight_id=row.flight_id or "",
        reduction=reduction_from_json(document),
        flight_hours=row.flight_hours,
        segment=row.segment or None,
    )


def empty_verdict(kind: str, thresholds: Effective) -> dict[str, Any]:
    """Verdict of a pump without records."""
    missing = int(thresholds.values["baseline_records"])
    state = State.INSUFFICIENT_DATA
    verdict = Verdict(
        state=state,
        side=SIDE_OF[state],
        since=None,
        confidence=max(UNINFORMED.values()),
        probabilities=UNINFORMED,
        candidates=(),
        secondary=None,
        sensor=None,
        estimates={},
        minimum_detectable={},
        quality=Quality(0, 0, "nominal", ()),
        advice=advice(state, (), {}, thresholds.values["case_flow_limit_lpm"], missing),
        resolving_measurement=None,
    )
    return verdict_to_json(verdict, twin_version(pump_type(kind)), thresholds.version)


def circuit_of(_pump: Pump) -> Circuit:
    """Circuit that the pump works in."""
    return circuit_parameters(CIRCUIT)
