"""The fleet as stored answers show it: pumps with where they sit and how they are."""

from datetime import UTC, datetime

from sqlalchemy.orm import Session

from service.access.security import Principal
from service.answers import pumps as answers
from service.answers.verdicts import Verdict
from service.answers.words import instant
from service.history.verdicts import empty_verdict
from service.pump_types.parameter_sets import held_type
from service.reading import queries
from service.reading.ranking import by_state
from service.reading.silence import Silence, silent_pumps
from service.storage.tables import Pump, StoredAssessment, case_pressure_beyond
from service.thresholds.layers import thresholds_of_many


def pump_documents(session: Session, rows: list[Pump]) -> list[answers.Pump]:
    """Pumps as the API shows them, with where they were last seen and how they are."""
    ids = [row.id for row in rows]
    newest, counts = queries.last_assessments(session, ids), queries.n_records(session, ids)
    silent = silent_pumps(session, ids, datetime.now(UTC))
    flights = queries.flights_of(session, [assessment.record_id for assessment in newest.values()])
    empty = _empty_verdicts(session, [row for row in rows if row.id not in newest])
    found = []
    for row in rows:
        last = newest.get(row.id)
        flight = flights.get(last.record_id) if last is not None else None
        verdict = empty[row.id] if last is None else last.verdict
        found.append(_pump(row, last, verdict, flight, counts.get(row.id, 0), silent.get(row.id)))
    return found


def _empty_verdicts(session: Session, rows: list[Pump]) -> dict[int, Verdict]:
    """Verdicts of pumps without records, by the pump's number; alike for pumps of a type with the same thresholds."""
    found: dict[int, Verdict] = {}
    known: dict[tuple[str, str, int, float], Verdict] = {}
    thresholds = thresholds_of_many(session, rows) if rows else {}
    for row in rows:
        holds = thresholds[row.id]
        place = (row.operator, row.pump_type, holds.version, holds.values["baseline_records"])
        if place not in known:
            known[place] = empty_verdict(held_type(session, row.operator, row.pump_type), holds)
        found[row.id] = known[place]
    return found


def _pump(
    row: Pump,
    newest: StoredAssessment | None,
    verdict: Verdict,
    last: queries.Flight | None,
    n_records: int,
    silence: Silence | None,
) -> answers.Pump:
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
