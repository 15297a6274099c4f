"""Records of other pumps that share samples, or a place at the same time, with a pump's own; and pumps that look alike."""

from collections.abc import Callable
from datetime import datetime, timedelta
from typing import Any

from sqlalchemy import ColumnElement, Row, and_, exists, or_, select
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.orm import Session, aliased
from sqlalchemy.sql.compiler import SQLCompiler
from sqlalchemy.sql.functions import FunctionElement

from service.history.contradictions import Said, meet
from service.ingest.names import look_of
from service.storage.tables import ANALYSED, SUPERSEDED, WITHDRAWN, Pump, Record

LONGEST = timedelta(days=2)
"""No record is longer."""
_MOST_COMPARED = 20
"""Records of one place and time that are compared with one another; where there are more, all contradict long since."""
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


class _LongestBefore(FunctionElement[datetime]):
    """The instant so long before another that no record of then lasts until it."""

    inherit_cache = True


@compiles(_LongestBefore, "sqlite")
def _in_sqlite(element: Any, compiler: SQLCompiler, **options: Any) -> str:
    # instants are texts there, and these order as they do
    return f"strftime('%Y-%m-%d %H:%M:%f', {compiler.process(element.clauses, **options)}, '-{LONGEST.days} days')"


@compiles(_LongestBefore, "postgresql")
def _in_postgres(element: Any, compiler: SQLCompiler, **options: Any) -> str:
    return f"({compiler.process(element.clauses, **options)} - interval '{LONGEST.days} days')"


def counting(known_at: datetime | None, table: Any = Record) -> tuple[ColumnElement[bool], ...]:
    """What picks the records that count now, or that counted at an instant."""
    if known_at is None:
        return (table.status == ANALYSED,)
    return (
        table.status.in_((ANALYSED, SUPERSEDED, WITHDRAWN)),
        table.received_at <= known_at,
        or_(table.ended_at.is_(None), table.ended_at > known_at),
    )


def copied_elsewhere(known_at: datetime | None) -> ColumnElement[bool]:
    """Whether another pump of the operator has a record with the samples of this one."""
    other = aliased(Record)
    return exists().where(*_same_samples(Record, other), *counting(known_at, other)).label("copied_elsewhere")


def place_taken(known_at: datetime | None) -> ColumnElement[bool]:
    """Whether another pump of the operator has a record of this one's place and time."""
    other = aliased(Record)
    return exists().where(*_same_place(Record, other), *counting(known_at, other)).label("place_taken")


def _same_samples(here: Any, other: Any) -> tuple[ColumnElement[bool], ...]:
    return (other.operator == here.operator, other.samples_hash == here.samples_hash, other.pump_id != here.pump_id)


def _same_place(here: Any, other: Any) -> tuple[ColumnElement[bool], ...]:
    return (
        other.operator == here.operator,
        other.aircraft == here.aircraft,
        other.position == here.position,
        other.started_at > _LongestBefore(here.started_at),
        other.started_at < here.finished_at,
        other.finished_at > here.started_at,
        other.pump_id != here.pump_id,
    )


def said_by(serial: str, row: Record | Row[*tuple[Any, ...]]) -> Said:
    """What a stored record says of itself; it must have been analysed."""
    if row.started_at is None:
        raise RuntimeError(f"record {row.id} has no start")
    texts = (row.flight_id or "", row.segment, row.aircraft or "", row.position or "")
    return Said(
        row.id, serial, *texts, row.started_at, row.finished_at, row.flight_hours, row.samples_hash, row.pump_id
    )


def newly_contradicted(session: Session, row: Record) -> set[int]:
    """Other pumps with a record that only this one contradicts: their remarks come and go with it."""
    copies = _matching(session, row, _same_samples)
    pumps = {copy.pump_id for copy in copies}
    found = pumps if len(pumps) == 1 else set()
    there = _matching(session, row, _same_place)
    for one in there:
        if not any(other.pump_id != one.pump_id and meet(one, other) for other in there[:_MOST_COMPARED]):
            found.add(one.pump_id)
    return {pump_id for pump_id in found if pump_id is not None}


def _matching(session: Session, row: Record, same: Callable[[Any, Any], tuple[ColumnElement[bool], ...]]) -> list[Said]:
    mine = aliased(Record)
    query = select(*SAID).join(mine, and_(*same(mine, Record))).where(mine.id == row.id, *counting(None))
    return [said_by("", other) for other in session.execute(query)]


def look_alikes(session: Session, pump: Pump) -> list[Pump]:
    """Other pumps of the operator whose serial numbers are easily taken for this one's."""
    query = select(Pump).where(Pump.operator == pump.operator, Pump.look == look_of(pump.serial), Pump.id != pump.id)
    return list(session.scalars(query.order_by(Pump.serial)))
