"""Stretches of a record that engineers mark good or bad."""

from fastapi import APIRouter, Response

from service.access import audit
from service.answers.history import RecordMark
from service.answers.words import Page
from service.reading import queries
from service.registry import marks as mark_entries
from service.web.addresses import location
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf

router = APIRouter(prefix="/records/{record_id}/marks", tags=["records"], route_class=AnswerRoute)


@router.get("", summary="What engineers have marked on a record")
def listed(record_id: str, context: ContextOf, asker: Asker) -> Page[RecordMark]:
    """Marks that count, in the order of their stretches."""
    with context.database.reading() as session:
        record = queries.record(session, asker, record_id)
        return {"items": [mark_entries.document(m) for m in mark_entries.marks(session, record)], "next": None}


@router.post("", status_code=201, summary="Mark a stretch of a record")
def mark(
    record_id: str, body: mark_entries.NewMark, response: Response, context: ContextOf, asker: Asker
) -> RecordMark:
    """Say that a stretch is bad, which is then no evidence, or good, which is then a window as it stands.

    The record is reduced again and its pump folded anew.
    """
    asker.require("engineer")
    with context.database.writing() as session:
        record, pump = mark_entries.locked(session, asker, record_id)
        row = mark_entries.create(session, record, pump, body, asker.owner, context.archive)
        details = body.model_dump() | {"mark_id": row.id}
        audit.note(session, asker, "record.mark", f"record/{record_id}", record.operator, details)
        response.headers["Location"] = location("records", record_id, "marks", row.id)
        return mark_entries.document(row)


@router.delete("/{mark_id}", status_code=204, summary="Take a mark back")
def withdraw(record_id: str, mark_id: str, context: ContextOf, asker: Asker) -> None:
    """The record counts as it did without the mark, and the pump is folded anew."""
    asker.require("engineer")
    with context.database.writing() as session:
        record, pump = mark_entries.locked(session, asker, record_id)
        mark_entries.remove(session, record, pump, mark_id, context.archive)
        audit.note(session, asker, "record.unmark", f"record/{record_id}", record.operator, {"mark_id": mark_id})
