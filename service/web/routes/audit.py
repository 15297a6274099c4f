"""The audit log, and its proof."""

import json
from collections.abc import Iterator
from typing import Annotated

from fastapi import APIRouter, Query
from fastapi.responses import StreamingResponse

from service.access import audit
from service.access.audit_proof import stored_proof
from service.access.security import Principal
from service.answers.administration import AuditEntry as Change
from service.answers.words import Page, instant
from service.context import Context
from service.registry.fields import Instant
from service.storage.tables import AuditEntry
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf
from service.web.paging import DEFAULT_ITEMS, MOST_ITEMS, page, place_of

router = APIRouter(prefix="/audit", tags=["administration"], route_class=AnswerRoute)


@router.get("", summary="Who changed what, the newest first")
def listed(
    context: ContextOf,
    asker: Asker,
    actor: str | None = None,
    action: Annotated[str | None, Query(description="`alarm.close`, or `alarm` for all of its kind")] = None,
    subject: Annotated[str | None, Query(description="For example `alarm/5f3c`")] = None,
    operator: str | None = None,
    since: Annotated[Instant | None, Query(alias="from")] = None,
    until: Annotated[Instant | None, Query(alias="to")] = None,
    limit: Annotated[int, Query(ge=1, le=MOST_ITEMS)] = DEFAULT_ITEMS,
    cursor: str | None = None,
) -> Page[Change]:
    """Page through the changes that this admin may see: an operator's admin sees those to its own data."""
    asker.require("admin")
    filters = {"actor": actor, "action": action, "subject": subject, "operator": operator}
    query = {"list": "audit", "from": since, "to": until, **filters}
    after = place_of(query, cursor)
    wanted = audit.entries(asker, since=since, until=until, after=after, **filters)
    with context.database.reading() as session:
        rows = list(session.scalars(wanted.limit(limit + 1)))
        return page(rows, limit, query, lambda row: [row.id], _shown)


@router.get(
    "/export",
    summary="The audit log with its proof",
    response_class=StreamingResponse,
    responses={200: {"content": {"application/x-ndjson": {}}}},
)
def export(context: ContextOf, asker: Asker) -> StreamingResponse:
    """JSON lines: the signed head, then every link of the chain with its entry.

    An operator's admin sees the entries of its own operator; of all others their salted hashes, which prove the chain
    and say nothing. ``casedrain audit verify --file`` verifies it without the service.
    """
    asker.require("admin")
    headers = {"Content-Disposition": 'attachment; filename="audit.jsonl"'}
    return StreamingResponse(_proof(context, asker), media_type="application/x-ndjson", headers=headers)


def _proof(context: Context, asker: Principal) -> Iterator[str]:
    with context.database.snapshot() as session:
        for line in stored_proof(session, asker.operator):
            yield json.dumps(line) + "\n"


def _shown(row: AuditEntry) -> Change:
    return {
        "at": instant(row.at),
        "actor": row.actor,
        "role": row.role,
        "operator": row.operator,
        "action": row.action,
        "subject": row.subject,
        "details": row.details,
    }
