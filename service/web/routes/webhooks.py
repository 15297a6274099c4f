"""Webhooks: where changes of alarms are sent, and how the deliveries went."""

import uuid
from datetime import UTC, datetime
from typing import Annotated, get_args

from fastapi import APIRouter, Query
from pydantic import ConfigDict, Field
from sqlalchemy import select
from sqlalchemy.orm import Session

from service.access import audit
from service.access.security import Principal
from service.answers import administration as answers
from service.answers.words import Page, instant
from service.bodies import Body
from service.errors import Fault, Forbidden, Invalid, NotFound
from service.notifications.guard import Blocked, target_of
from service.notifications.outbox import Event
from service.notifications.signature import new_secret
from service.reading import queries
from service.storage.tables import Delivery, Message, Webhook
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf
from service.web.paging import DEFAULT_ITEMS, MOST_ITEMS, page, place_of

router = APIRouter(prefix="/webhooks", tags=["administration"], route_class=AnswerRoute)
EVENTS: list[Event] = list(get_args(Event))


class NewWebhook(Body):
    """Where to send what; without ``operator`` that of the key, or every one's."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"url": "https://hooks.example.org/casedrain", "events": ["alarm.raised", "alarm.escalated"]}]
        },
    )
    url: str = Field(max_length=2000)
    events: list[Event] = Field(default=EVENTS, min_length=1)
    operator: str | None = Field(default=None, min_length=1, max_length=200)


@router.get("", summary="List webhooks")
def listed(
    context: ContextOf,
    asker: Asker,
    limit: Annotated[int, Query(ge=1, le=MOST_ITEMS)] = DEFAULT_ITEMS,
    cursor: str | None = None,
) -> Page[answers.Webhook]:
    """The webhooks that this admin may manage, without their secrets."""
    asker.require("admin")
    query = {"list": "webhooks"}
    after = place_of(query, cursor)
    wanted = queries.in_order_of_making(Webhook, asker, after)
    with context.database.reading() as session:
        rows = list(session.scalars(wanted.limit(limit + 1)))
        return page(rows, limit, query, lambda row: [row.created_at.isoformat(), row.id], _shown)


@router.post("", status_code=201, summary="Add a webhook")
def make(body: NewWebhook, context: ContextOf, asker: Asker) -> answers.WebhookMade:
    """Add a webhook; the secret that signs its deliveries is in this answer and in no other."""
    asker.require("admin")
    if asker.operator is not None and body.operator not in (None, asker.operator):
        raise Forbidden(f"an admin of operator {asker.operator} adds webhooks of that operator only")
    try:
        target_of(body.url, context.settings.webhook_hosts)
    except Blocked as error:
        raise Invalid("nothing can be sent there; no webhook was added", [Fault("body.url", str(error))]) from None
    row = Webhook(
        id=uuid.uuid4().hex,
        operator=body.operator or asker.operator,
        url=body.url,
        events=sorted(set(body.events), key=EVENTS.index),
        secret=new_secret(),
        owner=asker.owner,
        created_at=datetime.now(UTC),
        ended_at=None,
        end_reason=None,
    )
    with context.database.writing() as session:
        session.add(row)
        details = {"url": row.url, "events": row.events}
        audit.note(session, asker, "webhook.add", f"webhook/{row.id}", row.operator, details)
    return {**_shown(row), "secret": row.secret}


@router.delete("/{webhook_id}", status_code=204, summary="Remove a webhook")
def remove(webhook_id: str, context: ContextOf, asker: Asker) -> None:
    """Stop sending; what waits is not sent any more, the list of deliveries stays."""
    asker.require("admin")
    with context.database.writing() as session:
        row = _webhook(session, asker, webhook_id)
        if row.ended_at is None:
            row.ended_at, row.end_reason = datetime.now(UTC), f"removed by {asker.owner}"
            audit.note(session, asker, "webhook.remove", f"webhook/{row.id}", row.operator)


@router.get("/{webhook_id}/deliveries", summary="How the deliveries went")
def deliveries(
    webhook_id: str,
    context: ContextOf,
    asker: Asker,
    limit: Annotated[int, Query(ge=1, le=MOST_ITEMS)] = DEFAULT_ITEMS,
    cursor: str | None = None,
) -> Page[answers.Delivery]:
    """Every message for this webhook of the last 30 days, the newest first."""
    asker.require("admin")
    query = {"list": "deliveries", "webhook": webhook_id}
    after = place_of(query, cursor)
    with context.database.reading() as session:
        row = _webhook(session, asker, webhook_id)
        wanted = select(Delivery, Message.event, Message.created_at).join(Message, Message.id == Delivery.message_id)
        wanted = wanted.where(Delivery.webhook_id == row.id)
        if after is not None:
            wanted = wanted.where(Delivery.id < after[0])
        rows = session.execute(wanted.order_by(Delivery.id.desc()).limit(limit + 1)).all()
        return page(rows, limit, query, lambda r: [r[0].id], lambda r: _delivery(r[0], r[1], r[2]))


def _webhook(session: Session, asker: Principal, webhook_id: str) -> Webhook:
    row = session.get(Webhook, webhook_id)
    if row is None or asker.operator not in (None, row.operator):
        raise NotFound(f"there is no webhook {webhook_id}")
    return row


def _shown(row: Webhook) -> answers.Webhook:
    return {
        "id": row.id,
        "operator": row.operator,
        "url": row.url,
        "events": row.events,
        "owner": row.owner,
        "created_at": instant(row.created_at),
        "ended_at": instant(row.ended_at),
        "end_reason": row.end_reason,
    }


def _delivery(row: Delivery, event: str, created_at: datetime) -> answers.Delivery:
    return {
        "message_id": row.message_id,
        "event": event,
        "created_at": instant(created_at),
        "status": row.status,
        "attempts": row.attempts,
        "tried_at": instant(row.tried_at),
        "due_at": instant(row.due_at) if row.status == "pending" else None,
        "delivered_at": instant(row.delivered_at),
        "outcome": row.outcome,
    }
