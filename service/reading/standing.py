"""How each pump of a fleet stands by its newest record: kept beside the pump with every fold, and in this process.

What the fold has kept (``Pump.standing``) is read where a pump's revision is the one that it was kept at. Elsewhere it is
worked out from stored verdicts: histories that an older release has folded, until the housekeeping has come to them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import or_, select
from sqlalchemy.orm import Session

from service.answers.documents import JsonObject
from service.answers.verdicts import Verdict
from service.answers.words import instant
from service.reading import queries
from service.reading.by_link import ByLink, links
from service.reading.queries import Listed
from service.reading.silence import NEWEST_RECORDS, newest_starts, patience
from service.storage.among import among
from service.storage.database import Database
from service.storage.tables import Pump, case_pressure_beyond

_MOST = 20_000
"""Pumps that a process remembers (our choice: some 3 kB each)."""
_AT_ONCE = 50


@dataclass(frozen=True, slots=True)
class Standing:
    """A pump by its newest record, with the parts of its verdict that lists show.

    ``last_record_at`` and ``unusual_from``, from which on its silence is unusual, are instants as the API writes them.
    """

    record_id: str
    aircraft: str
    position: str
    records: int
    last_record_at: str | None
    flight_hours: float | None
    unusual_from: str
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

    def is_silent(self, now: datetime) -> bool:
        """True where its silence is unusual by an instant."""
        return datetime.fromisoformat(self.unusual_from) < now

    def to_json(self) -> JsonObject:
        """As it is kept."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class Newest:
    """A pump's newest record that counts: where it was taken, and when; ``flight_hours`` [h] where the record says them."""

    record_id: str
    aircraft: str
    position: str
    started_at: datetime | None
    flight_hours: float | None


_kept: ByLink[Standing] = ByLink(_MOST)


def standings(session: Session, pumps: Sequence[Pump | Listed]) -> dict[int, Standing]:
    """Standing of every pump that has a record, by the pump's number."""
    return _kept.of(session, pumps, lambda ids: _read(session, ids))


def standing(newest: Newest, verdict: Verdict, records: int, starts: Sequence[datetime]) -> Standing:
    """Standing of a pump.

    Parameters
    ----------
    records
        Number of its records that count.
    starts
        Instants of the newest of them, at most ``NEWEST_RECORDS``, in order.
    """
    unusual_from = instant(starts[-1] + patience(starts))
    assert unusual_from is not None
    return Standing(
        record_id=newest.record_id,
        aircraft=newest.aircraft,
        position=newest.position,
        records=records,
        last_record_at=instant(newest.started_at),
        flight_hours=newest.flight_hours,
        unusual_from=unusual_from,
        **_said(verdict),
    )


def keep_standings(database: Database, ours: Any) -> int:
    """Keep the standing of pumps that have none by their revision; gives how many pumps.

    Safe to repeat, and beside folds: each is worked out and kept under the pump's lock. ``ours`` is the condition that
    picks the pumps that this process may write.
    """
    due = (
        select(Pump.id)
        .where(ours, or_(Pump.standing_at.is_(None), Pump.standing_at != Pump.revision))
        .order_by(Pump.id)
    )
    with database.reading() as session:
        pump_ids = list(session.scalars(due))
    for start in range(0, len(pump_ids), _AT_ONCE):
        with database.writing() as session:
            wanted = due.where(among(Pump.id, pump_ids[start : start + _AT_ONCE]))
            locked = select(Pump).where(Pump.id.in_(wanted.order_by(None))).order_by(Pump.id).with_for_update()
            rows = list(session.scalars(locked))
            found, last = _worked_out(session, [row.id for row in rows]), links(session, [row.id for row in rows])
            for row in rows:
                row.standing = found[row.id].to_json() if row.id in found else None
                row.standing_at, row.standing_link = row.revision, last.get(row.id)
    return len(pump_ids)


def _read(session: Session, pump_ids: Sequence[int]) -> dict[int, Standing]:
    """What is kept with the fold, or else worked out."""
    kept = select(Pump.id, Pump.standing).where(Pump.standing_at == Pump.revision, among(Pump.id, pump_ids))
    stored: dict[int, Any] = {row[0]: row[1] for row in session.execute(kept)}
    found = {i: Standing(**document) for i, document in stored.items() if document is not None}
    return found | _worked_out(session, [i for i in pump_ids if i not in stored])


def _worked_out(session: Session, pump_ids: Sequence[int]) -> dict[int, Standing]:
    if not pump_ids:
        return {}
    newest, counts = queries.last_assessments(session, pump_ids), queries.n_records(session, pump_ids)
    starts = newest_starts(session, pump_ids)
    flights = queries.flights_of(session, [a.record_id for a in newest.values()])
    found = {}
    for pump_id, last in newest.items():
        flight = flights.get(last.record_id)
        began, hours = (flight.started_at, flight.flight_hours) if flight else (None, None)
        place = Newest(last.record_id, last.aircraft, last.position, began, hours)
        found[pump_id] = standing(place, last.verdict, counts.get(pump_id, 0), starts[pump_id][-NEWEST_RECORDS:])
    return found


def _said(verdict: Verdict) -> Mapping[str, Any]:
    """What lists show of a verdict."""
    return {
        "state": verdict["state"],
        "side": verdict["side"],
        "since": verdict["since"],
        "confidence": verdict["confidence"],
        "candidates": list(verdict["candidates"]),
        "advice": verdict["advice"],
        "probability": verdict["probabilities"].get(verdict["state"], 0.0),
        "case_flow": verdict["estimates"].get("case_flow_at_reference_lpm"),
        "case_pressure": verdict.get("case_pressure"),
        "case_pressure_beyond": case_pressure_beyond(verdict),
    }
