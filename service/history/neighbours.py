"""Records of other pumps that share samples, or a place at the same time, with a pump's own; and pumps that look alike."""

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Mapping, Sequence
from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import ColumnElement, Row, and_, or_, select, union
from sqlalchemy.orm import Session, aliased

from service.history.contradictions import Said, overlap
from service.ingest.names import look_of
from service.storage.tables import ANALYSED, SUPERSEDED, WITHDRAWN, Pump, Record

LONGEST = timedelta(hours=48.0)
"""No record is longer."""
_MOST_PLACES = 50
"""Places of a pump that are compared with those of others: no pump has sat in so many."""
SAID = (
    Record.id,
    Record.pump_id,
    Record.flight_id,
    Record.segment,
    Record.aircraft,
    Record.position,
    Record.started_at,
    Record.finished_at,
    Record.flight_hours,
    Record.samples_hash,
)
"""Columns that ``said_by`` reads."""


def counting(known_at: datetime | None, table: type[Record] = Record) -> tuple[ColumnElement[bool], ...]:
    """What picks the records that count now, or that counted at an instant."""
    if known_at is None:
        return (table.status == ANALYSED,)
    return (
        table.status.in_((ANALYSED, SUPERSEDED, WITHDRAWN)),
        table.received_at <= known_at,
        or_(table.ended_at.is_(None), table.ended_at > known_at),
    )


def neighbours(
    session: Session, pump: Pump, own: Sequence[Said], known_at: datetime | None = None
) -> Mapping[str, list[Said]]:
    """Records of other pumps of the operator that contradict one of ``own``, by the id of that one."""
    mine = aliased(Record)
    copies = select(*SAID, Pump.serial).join(Pump, Pump.id == Record.pump_id)
    copies = copies.join(mine, and_(mine.samples_hash == Record.samples_hash, mine.pump_id == pump.id))
    query = copies.where(Record.operator == pump.operator, Record.pump_id != pump.id, *counting(known_at))
    places = list(_places(own))[:_MOST_PLACES]
    if places:
        there = select(*SAID, Pump.serial).join(Pump, Pump.id == Record.pump_id)
        there = there.where(Record.operator == pump.operator, Record.pump_id != pump.id, or_(*places))
        rows = session.execute(union(query, there.where(*counting(known_at)))).all()
    else:
        rows = session.execute(query).all()
    others = [said_by(row.serial, row) for row in rows]
    return _matched(own, others)


def said_by(serial: str, row: Record | Row[*tuple[Any, ...]]) -> Said:
    """What a stored record says of itself; it must have been analysed."""
    if row.started_at is None:
        raise RuntimeError(f"record {row.id} has no start")
    texts = (row.flight_id or "", row.segment, row.aircraft or "", row.position or "")
    return Said(
        row.id, serial, *texts, row.started_at, row.finished_at, row.flight_hours, row.samples_hash, row.pump_id
    )


def contradicting(session: Session, pump: Pump, row: Record) -> set[int]:
    """Pumps whose records contradict one record of this pump."""
    if row.started_at is None:
        return set()
    said = said_by(pump.serial, row)
    return {o.pump_id for o in neighbours(session, pump, [said]).get(said.record_id, ()) if o.pump_id is not None}


def look_alikes(session: Session, pump: Pump) -> list[Pump]:
    """Other pumps of the operator whose serial numbers are easily taken for this one's."""
    query = select(Pump).where(Pump.operator == pump.operator, Pump.look == look_of(pump.serial), Pump.id != pump.id)
    return list(session.scalars(query.order_by(Pump.serial)))


def _places(own: Sequence[Said]) -> Iterator[ColumnElement[bool]]:
    """Where and when records of others could meet those of a pump."""
    spans: dict[tuple[str, str], tuple[datetime, datetime]] = {}
    for said in own:
        if said.until is not None:
            first, last = spans.get((said.aircraft, said.position), (said.at, said.until))
            spans[said.aircraft, said.position] = min(first, said.at), max(last, said.until)
    for (aircraft, position), (first, last) in spans.items():
        yield and_(
            Record.aircraft == aircraft,
            Record.position == position,
            Record.started_at > first - LONGEST,
            Record.started_at < last,
            Record.finished_at > first,
        )


def _matched(own: Sequence[Said], others: Sequence[Said]) -> dict[str, list[Said]]:
    ordered = sorted(own, key=lambda said: said.order)
    starts = [said.at for said in ordered]
    copies: dict[str, list[Said]] = {}
    for said in own:
        if said.samples_hash is not None:
            copies.setdefault(said.samples_hash, []).append(said)
    found: dict[str, list[Said]] = {}
    for other in sorted(others, key=lambda said: said.order):
        near = copies.get(other.samples_hash or "", [])
        if other.until is not None:
            begin, end = bisect_left(starts, other.at - LONGEST), bisect_right(starts, other.until)
            near = [*near, *(said for said in ordered[begin:end] if said not in near and _meet(said, other))]
        for said in near:
            found.setdefault(said.record_id, []).append(other)
    return found


def _meet(a: Said, b: Said) -> bool:
    return (a.aircraft, a.position) == (b.aircraft, b.position) and overlap(a, b)
