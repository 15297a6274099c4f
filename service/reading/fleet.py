"""The fleet as stored answers show it: pumps with where they sit and how they are."""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime

from sqlalchemy.orm import Session

from service.access.security import Principal
from service.answers import pumps as answers
from service.answers.verdicts import Verdict
from service.history.verdicts import empty_verdict
from service.pump_types.parameter_sets import held_type
from service.reading import queries
from service.reading.queries import Listed
from service.reading.ranking import by_state
from service.reading.silence import removed
from service.reading.standing import Standing, standings
from service.storage.tables import Pump, case_pressure_beyond
from service.thresholds.layers import thresholds_of_many


def pump_documents(session: Session, rows: Sequence[Pump | Listed]) -> list[answers.Pump]:
    """Pumps as the API shows them, with where they were last seen and how they are."""
    return pumps_standing(session, rows)[0]


def pumps_standing(session: Session, rows: Sequence[Pump | Listed]) -> tuple[list[answers.Pump], dict[int, Standing]]:
    """The same with what they were made of, for whoever asks on."""
    found = standings(session, rows)
    silent = _silent(session, found)
    empty = _empty_verdicts(session, [row for row in rows if row.id not in found])
    shown = []
    for row in rows:
        standing = found.get(row.id)
        if standing is None:
            shown.append(_without_records(row, empty[row.id]))
        else:
            shown.append(_pump(row, standing, row.id in silent))
    return shown, found


def silent_pumps(session: Session, rows: Sequence[Pump | Listed]) -> frozenset[int]:
    """Pumps that are silent now, of those given."""
    return _silent(session, standings(session, rows))


def _silent(session: Session, found: Mapping[int, Standing]) -> frozenset[int]:
    now = datetime.now(UTC)
    quiet = [i for i, standing in found.items() if standing.is_silent(now)]
    return frozenset(quiet) - removed(session, quiet, now)


def _empty_verdicts(session: Session, rows: Sequence[Pump | Listed]) -> dict[int, Verdict]:
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


def _pump(row: Pump | Listed, standing: Standing, silent: bool) -> answers.Pump:
    return {
        "serial": row.serial,
        "operator": row.operator,
        "pump_type": row.pump_type,
        "confirmed": row.confirmed,
        "aircraft": standing.aircraft,
        "position": standing.position,
        "records": standing.records,
        "last_record_at": standing.last_record_at,
        "flight_hours": standing.flight_hours,
        "silent": silent,
        "silence_unusual_from": standing.unusual_from if silent else None,
        "state": standing.state,
        "side": standing.side,
        "since": standing.since,
        "confidence": standing.confidence,
        "candidates": list(standing.candidates),
        "advice": standing.advice,
        "case_pressure_beyond": standing.case_pressure_beyond,
    }


def _without_records(row: Pump | Listed, verdict: Verdict) -> answers.Pump:
    return {
        "serial": row.serial,
        "operator": row.operator,
        "pump_type": row.pump_type,
        "confirmed": row.confirmed,
        "aircraft": None,
        "position": None,
        "records": 0,
        "last_record_at": None,
        "flight_hours": None,
        "silent": False,
        "silence_unusual_from": None,
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
    return sorted(pump_documents(session, queries.listed(session, asker)), key=by_state)
