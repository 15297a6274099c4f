"""Operators: list, retention, export as a whole, deletion as a whole with proof."""

from typing import Annotated
from urllib.parse import quote

from fastapi import APIRouter, Query
from fastapi.responses import StreamingResponse
from sqlalchemy import select

from service.access import audit
from service.answers.administration import Deletion as Receipted
from service.answers.administration import Operator
from service.answers.words import Page
from service.errors import Fault, Invalid
from service.registry import operators as registry
from service.registry.deletion import delete_operator, document
from service.registry.export import export_stream
from service.registry.fields import Reason
from service.storage.tables import Deletion
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf

router = APIRouter(prefix="/operators", tags=["administration"], route_class=AnswerRoute)


@router.get("", summary="List operators")
def listed(context: ContextOf, asker: Asker) -> Page[Operator]:
    """Operators that this admin may manage, with what they have here."""
    asker.require("admin")
    with context.database.reading() as session:
        return {"items": registry.documents(session, registry.visible(session, asker)), "next": None}


@router.get("/deletions", summary="Receipts of deletions")
def deletions(context: ContextOf, asker: Asker) -> Page[Receipted]:
    """Deletions of operators with their receipts, the newest first."""
    asker.require("admin")
    query = select(Deletion).order_by(Deletion.started_at.desc(), Deletion.id)
    if asker.operator is not None:
        query = query.where(Deletion.deleted_operator == asker.operator)
    with context.database.reading() as session:
        return {"items": [document(row) for row in session.scalars(query)], "next": None}


@router.patch("/{operator}", summary="Set how long things are kept, or hold them")
def change(operator: str, body: registry.OperatorChange, context: ContextOf, asker: Asker) -> Operator:
    """Set the retention of raw bytes, of jobs that have ended and of audit entries; verdicts and what they rest on stay.

    Under a legal hold nothing goes, and the operator cannot be deleted.
    """
    with context.database.writing() as session:
        registry.check_visible(session, asker, operator)
        registry.change(session, asker, operator, body)
        details = body.model_dump(mode="json", exclude_unset=True)
        audit.note(session, asker, "operator.change", f"operator/{operator}", operator, details)
        return registry.documents(session, [operator])[0]


@router.get("/{operator}/export", summary="Everything of an operator", response_class=StreamingResponse)
def export(operator: str, context: ContextOf, asker: Asker) -> StreamingResponse:
    """A ZIP of every row as JSON lines and every upload as it came."""
    with context.database.reading() as session:
        registry.check_visible(session, asker, operator)
    stream = export_stream(context.database, context.raw_store, operator)
    headers = {"Content-Disposition": f"attachment; filename*=UTF-8''{quote(operator, '')}.zip"}
    return StreamingResponse(stream, media_type="application/zip", headers=headers)


@router.delete("/{operator}", summary="Delete everything of an operator")
def remove(
    operator: str,
    context: ContextOf,
    asker: Asker,
    confirm: Annotated[str, Query(description="The operator's name once more")],
    reason: Annotated[Reason, Query(description="Why; it stands in the receipt")],
) -> Receipted:
    """Delete rows and raw bytes for good; the answer is the receipt, with counts and a hash."""
    with context.database.reading() as session:
        registry.check_visible(session, asker, operator)
    if confirm != operator:
        raise Invalid("nothing was deleted", [Fault("query.confirm", f"is not {operator}: repeat the name to confirm")])
    return document(delete_operator(context.database, context.raw_store, operator, asker, reason))
