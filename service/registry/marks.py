"""Marks on records: an engineer says that a stretch is bad, or good as it stands, and why; the pump is folded anew."""

from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import ConfigDict, Field, FiniteFloat, model_validator
from sqlalchemy import select
from sqlalchemy.orm import Session

from service.access.security import Principal
from service.answers import history as answers
from service.answers.words import instant
from service.bodies import Body
from service.errors import Conflict, NotFound
from service.history.archive import Archive
from service.monitoring.behind import fold_behind
from service.monitoring.refold import Cause
from service.reading import queries
from service.registry.entries import add, withdraw
from service.registry.fields import Reason
from service.storage.tables import ANALYSED, Pump, Record, RecordMark

CHANGED = "marks_changed"
_LONGEST_S = 48.0 * 3600.0


class NewMark(Body):
    """A stretch of a record, both bounds included [s from its start], and what it is worth."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"start_s": 110.0, "end_s": 121.5, "mark": "bad", "reason": "sensor plug was moved"}]
        }
    )
    start_s: Annotated[FiniteFloat, Field(ge=0.0, le=_LONGEST_S)]
    end_s: Annotated[FiniteFloat, Field(ge=0.0, le=_LONGEST_S)]
    mark: Literal["good", "bad"]
    reason: Reason

    @model_validator(mode="after")
    def _has_a_length(self) -> "NewMark":
        if self.end_s <= self.start_s:
            raise ValueError(f"ends at {self.end_s:g} s, which is not after its start at {self.start_s:g} s")
        return self


def locked(session: Session, asker: Principal, record_id: str) -> tuple[Record, Pump]:
    """An analysed record and its pump, locked until the transaction ends.

    Raises
    ------
    NotFound
        when there is no such record that the asker may see.
    Conflict
        when it does not count: marks would change nothing.
    """
    record = queries.record(session, asker, record_id)
    if record.pump_id is None or record.status != ANALYSED:
        raise Conflict(f"record {record_id} is {record.status}: only an analysed record can be marked")
    pump = session.scalars(select(Pump).where(Pump.id == record.pump_id).with_for_update()).one()
    return record, pump


def create(session: Session, record: Record, pump: Pump, body: NewMark, author: str, archive: Archive) -> RecordMark:
    """Mark a stretch of a record of a locked pump and fold it anew."""
    row = add(session, RecordMark, pump, author, {"record_id": record.id, **body.model_dump()})
    fold_behind(session, [pump], archive, Cause(CHANGED, record.id))
    return row


def remove(session: Session, record: Record, pump: Pump, mark_id: str, archive: Archive) -> None:
    """Take a mark back and fold the pump anew.

    Raises
    ------
    NotFound
        when the record has no such mark that counts.
    """
    row = next((m for m in marks(session, record) if m.id == mark_id), None)
    if row is None:
        raise NotFound(f"record {record.id} has no mark {mark_id} that counts")
    withdraw(session, row)
    fold_behind(session, [pump], archive, Cause(CHANGED, record.id))


def marks(session: Session, record: Record) -> Sequence[RecordMark]:
    """Marks of a record that count, in the order of their stretches."""
    query = select(RecordMark).where(RecordMark.record_id == record.id, RecordMark.withdrawn_at.is_(None))
    return session.scalars(query.order_by(RecordMark.start_s, RecordMark.row_id)).all()


def document(row: RecordMark) -> answers.RecordMark:
    """A mark in the shape of the API."""
    return {
        "id": row.id,
        "start_s": row.start_s,
        "end_s": row.end_s,
        "mark": row.mark,
        "reason": row.reason,
        "recorded_at": instant(row.recorded_at),
        "author": row.author,
    }
