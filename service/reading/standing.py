"""How each pump of a fleet stands by its newest record: read once for every state of its history, not for every question."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy.orm import Session

from service.answers.verdicts import Verdict
from service.reading import queries
from service.reading.by_link import ByLink
from service.reading.silence import unusual_from
from service.storage.tables import case_pressure_beyond

_MOST = 20_000
"""Pumps that a process remembers (our choice: some 3 kB each)."""


@dataclass(frozen=True, slots=True)
class Standing:
    """A pump by its newest record, with the parts of its verdict that lists show.

    ``unusual_from`` is the instant from which on its silence is unusual.
    """

    record_id: str
    aircraft: str
    position: str
    records: int
    started_at: datetime | None
    flight_hours: float | None
    unusual_from: datetime
    last_at: datetime
    state: str
    side: str
    since: str | None
    confidence: float
    candidates: list[str]
    advice: str
    probability: float
    case_flow: Any
    case_pressure: Any
    case_pressure_beyond: bool


_kept: ByLink[Standing] = ByLink(_MOST)


def standings(session: Session, pump_ids: Sequence[int]) -> dict[int, Standing]:
    """Standing of every pump that has a record, by the pump's number."""
    return _kept.of(session, pump_ids, lambda ids: _read(session, ids))


def _read(session: Session, pump_ids: Sequence[int]) -> dict[int, Standing]:
    newest, counts = queries.last_assessments(session, pump_ids), queries.n_records(session, pump_ids)
    habits = unusual_from(session, pump_ids)
    flights = queries.flights_of(session, [a.record_id for a in newest.values()])
    found = {}
    for pump_id, last in newest.items():
        flight, verdict = flights.get(last.record_id), last.verdict
        found[pump_id] = Standing(
            record_id=last.record_id,
            aircraft=last.aircraft,
            position=last.position,
            records=counts.get(pump_id, 0),
            started_at=flight.started_at if flight else None,
            flight_hours=flight.flight_hours if flight else None,
            unusual_from=habits[pump_id],
            last_at=last.at,
            **_said(verdict),
        )
    return found


def _said(verdict: Verdict) -> dict[str, Any]:
    """What lists show of a verdict."""
    return {
        "state": verdict["state"],
        "side": verdict["side"],
        "since": verdict["since"],
        "confidence": verdict["confidence"],
        "candidates": verdict["candidates"],
        "advice": verdict["advice"],
        "probability": verdict["probabilities"].get(verdict["state"], 0.0),
        "case_flow": verdict["estimates"].get("case_flow_at_reference_lpm"),
        "case_pressure": verdict.get("case_pressure"),
        "case_pressure_beyond": case_pressure_beyond(verdict),
    }
