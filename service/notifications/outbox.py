"""The outbox: a message is written in the transaction of what it reports, so that neither is ever without the other."""

import uuid
from collections.abc import Mapping
from datetime import datetime
from typing import Any, Literal

from pydantic_core import to_jsonable_python
from sqlalchemy import or_, select
from sqlalchemy.orm import Session

from service.storage.tables import Delivery, Message, User, Webhook

Event = Literal[
    "alarm.raised",
    "alarm.escalated",
    "alarm.reopened",
    "alarm.changed",
    "alarm.acknowledged",
    "alarm.shelved",
    "alarm.unshelved",
    "alarm.cleared",
    "alarm.closed",
    "alarm.withdrawn",
]
"""What a webhook can be told of."""
MAILED: tuple[Event, ...] = ("alarm.raised", "alarm.escalated", "alarm.reopened")
"""What is worth a mail: somebody has to look."""
PENDING, DELIVERED, FAILED = "pending", "delivered", "failed"


def announce(session: Session, operator: str, event: Event, document: Mapping[str, Any], now: datetime) -> None:
    """Write a message for everybody who wants it; without a taker nothing is written.

    Parameters
    ----------
    operator
        Whose event it is: its own takers and those of all operators get it.
    document
        The alarm in the shape of the API.
    """
    webhooks = [w for w in session.scalars(_webhooks(operator)) if event in w.events]
    addresses = list(session.scalars(_addresses(operator))) if event in MAILED and not document["shelved"] else []
    if not webhooks and not addresses:
        return
    payload = to_jsonable_python({"type": event, "timestamp": now, "data": dict(document)})
    message = Message(id=f"msg_{uuid.uuid4().hex}", operator=operator, event=event, payload=payload, created_at=now)
    session.add(message)
    session.flush()
    session.add_all(_delivery(message, now, webhook_id=webhook.id) for webhook in webhooks)
    session.add_all(_delivery(message, now, address=address) for address in addresses)


def _webhooks(operator: str) -> Any:
    return select(Webhook).where(
        Webhook.ended_at.is_(None), or_(Webhook.operator.is_(None), Webhook.operator == operator)
    )


def _addresses(operator: str) -> Any:
    return select(User.email).where(
        User.wants_mail.is_(True),
        User.email.is_not(None),
        User.disabled_at.is_(None),
        or_(User.operator.is_(None), User.operator == operator),
    )


def _delivery(
    message: Message, now: datetime, *, webhook_id: str | None = None, address: str | None = None
) -> Delivery:
    return Delivery(
        message_id=message.id, webhook_id=webhook_id, address=address, status=PENDING, attempts=0, due_at=now
    )
