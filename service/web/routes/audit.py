"""The audit log."""

from typing import Annotated

from fastapi import APIRouter, Query

from service.access import audit
from service.answers.administration import AuditEntry as Change
from service.answers.words import Page, instant
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
