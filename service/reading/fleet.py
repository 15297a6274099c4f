"""The fleet as stored answers show it: pumps with where they sit and how they are."""

from datetime import UTC, datetime

from sqlalchemy.orm import Session

from service.access.security import Principal
from service.answers import pumps as answers
from service.answers.words import instant
from service.reading import queries
from service.reading.ranking import by_state
from service.reading.silence import Silence, silent_pumps
from service.storage.tables import Pump, StoredAssessment, case_pressure_beyond


def pump_documents(session: Session, rows: list[Pump]) -> list[answers.Pump]:
    """Pumps as the API shows them, with where they were last seen and how they are."""
    ids = [row.id for row in rows]
    newest, counts = queries.last_assessments(session, ids), queries.n_records(session, ids)
    silent = silent_pumps(session, ids, datetime.now(UTC))
    flights = queries.flights_of(session, [assessment.record_id for assessment in newest.values()])
    found = []
    for row in rows:
        last = newest.get(row.id)
        flight = flights.get(last.record_id) if last is not None else None
        found.append(_pump(session, row, last, flight, counts.get(row.id, 0), silent.get(row.id)))
    return found


def _pump(
    session: Session,
    row: Pump,
    newest: StoredAssessment | None,
    last: queries.Flight | None,
    n_records: int,
    silence: Silence | None,
) -> answers.Pump:
    verdict = queries.verdict(session, row) if newest is None else newest.verdict
    return {
        "serial": row.serial,
        "operator": row.operator,
        "pump_type": row.pump_type,
        "confirmed": row.confirmed,
        "aircraft": newest.aircraft if newest else None,
        "position": newest.position if newest else None,
        "records": n_records,
        "last_record_at": instant(last.started_at) if last else None,
        "flight_hours": last.flight_hours if last else None,
        "silent": silence is not None,
        "silence_unusual_from": instant(silence.unusual_from) if silence else None,
        "state": verdict["state"],
        "side": verdict["side"],
        "since": verdict["since"],
        "confidence": verdict["confidence"],
        "candidates": verdict["candidates"],
        "advice": verdict["advice"],
        "case_pressure_beyond": case_pressure_beyond(verdict),
    }


def fleet(session: Session, asker: Principal) -> list[answers.Pump]:
    """All pumps that the asker may see, the most urgent first."""
    return sorted(pump_documents(session, list(session.scalars(queries.pumps(asker)))), key=by_state)
