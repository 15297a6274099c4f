"""The postman: takes what is due, sends it, and puts off what failed; any number of them may turn at once."""

import random
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import structlog
from sqlalchemy import ColumnElement, and_, delete, exists, select

from service.notifications import mail, webhook_call
from service.notifications.outbox import DELIVERED, FAILED, PENDING
from service.notifications.webhook_call import Outcome
from service.settings import Settings
from service.storage.database import Database
from service.storage.tables import Delivery, FailedSignIn, Message, SignedIn, Webhook

BACKOFF_S: tuple[float, ...] = (5, 300, 1800, 7200, 18000, 36000, 50400, 72000, 86400)
"""Pauses between attempts, those that Standard Webhooks suggests; after the last one the delivery has failed."""
_LEASE = timedelta(seconds=120)
_AT_ONCE = 20
_KEPT = timedelta(days=30)
log = structlog.get_logger("casedrain")


@dataclass(frozen=True, slots=True)
class _Parcel:
    delivery_id: int
    attempt: int
    message_id: str
    payload: Mapping[str, Any]
    url: str | None
    secret: str
    address: str | None


class Postman:
    """Delivers the messages of one database that are due.

    A delivery is claimed under a lock that other replicas skip, and for a while nobody else takes it. Whoever dies
    with it in hand leaves it to be sent again: at least once, told apart by its ``webhook-id``.
    """

    def __init__(self, database: Database, settings: Settings) -> None:
        self._database = database
        self._settings = settings

    def turn(self) -> int:
        """Send everything that is due, once; the number of attempts made."""
        parcels = self._claimed()
        if parcels:
            with ThreadPoolExecutor(min(4, len(parcels)), thread_name_prefix="postman") as pool:
                for parcel, outcome in zip(parcels, pool.map(self._sent, parcels), strict=True):
                    self._settle(parcel, outcome)
        return len(parcels)

    def _claimed(self) -> list[_Parcel]:
        now = datetime.now(UTC)
        with self._database.reading() as session:
            if not session.scalar(select(exists().where(is_due(now)))):
                return []
        with self._database.writing() as session:
            query = (
                select(Delivery, Message, Webhook)
                .join(Message, Message.id == Delivery.message_id)
                .outerjoin(Webhook, Webhook.id == Delivery.webhook_id)
                .where(is_due(now))
                .order_by(Delivery.due_at, Delivery.id)
                .limit(_AT_ONCE)
                .with_for_update(skip_locked=True, of=Delivery)
            )
            parcels = []
            for delivery, message, joined in session.execute(query):
                webhook: Webhook | None = joined
                delivery.attempts += 1
                delivery.tried_at, delivery.due_at = now, now + _LEASE
                if webhook is not None and webhook.ended_at is not None:
                    delivery.status, delivery.outcome = FAILED, "the webhook was removed"
                    continue
                url, secret = (webhook.url, webhook.secret) if webhook is not None else (None, "")
                parcels.append(
                    _Parcel(delivery.id, delivery.attempts, message.id, message.payload, url, secret, delivery.address)
                )
        return parcels

    def _sent(self, parcel: _Parcel) -> Outcome:
        try:
            if parcel.url is not None:
                allowed = self._settings.webhook_hosts
                return webhook_call.call(parcel.url, parcel.secret, parcel.message_id, parcel.payload, allowed)
            return mail.send(self._settings, parcel.address or "", parcel.message_id, parcel.payload)
        except Exception as error:
            log.exception("a delivery failed unexpectedly", delivery=parcel.delivery_id)
            return Outcome(False, f"not sent: {type(error).__name__}")

    def _settle(self, parcel: _Parcel, outcome: Outcome) -> None:
        now = datetime.now(UTC)
        with self._database.writing() as session:
            row = session.get(Delivery, parcel.delivery_id)
            if row is None or row.status != PENDING:
                return
            row.outcome = outcome.words
            if outcome.delivered:
                row.status, row.delivered_at = DELIVERED, now
            elif outcome.gone or parcel.attempt > len(BACKOFF_S):
                row.status = FAILED
            else:
                # a little jitter, so that a receiver that comes back is not hit by all at once
                pause = BACKOFF_S[parcel.attempt - 1] * random.uniform(1.0, 1.2)  # noqa: S311
                row.due_at = now + timedelta(seconds=pause)
            if outcome.gone and row.webhook_id is not None:
                webhook = session.get(Webhook, row.webhook_id)
                if webhook is not None and webhook.ended_at is None:
                    webhook.ended_at, webhook.end_reason = now, "the receiver answered 410 Gone"


def is_due(now: datetime) -> ColumnElement[bool]:
    """Condition that picks the deliveries that are to be made."""
    return and_(Delivery.status == PENDING, Delivery.due_at <= now)


def forget_old(database: Database, now: datetime) -> None:
    """Forget what nobody asks for any more: old deliveries, ended sessions, sign-ins that failed."""
    with database.writing() as session:
        old = select(Message.id).where(Message.created_at < now - _KEPT)
        session.execute(delete(Delivery).where(Delivery.message_id.in_(old), Delivery.status != PENDING))
        session.execute(
            delete(Message).where(Message.created_at < now - _KEPT, ~exists().where(Delivery.message_id == Message.id))
        )
        session.execute(delete(SignedIn).where(SignedIn.expires_at < now - _KEPT))
        session.execute(delete(FailedSignIn).where(FailedSignIn.at < now - timedelta(days=1)))
