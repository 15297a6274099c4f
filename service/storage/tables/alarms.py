"""Alarms, what operators did about them, and the messages that tell others."""

from datetime import datetime

from sqlalchemy import ForeignKey, Index, false
from sqlalchemy.orm import Mapped, mapped_column

from service.answers.alarms import AlarmEvent
from service.answers.documents import JsonObject
from service.storage.tables.base import JSON_COLUMN, Base


class Alarm(Base):
    """One alarm of a pump as its history and the actions of operators have it now.

    ``condition`` is ``active`` or ``cleared``; ``closed_at`` and ``withdrawn_at`` end it. ``shelved_until`` may lie in
    the past: the shelf is over then. ``history`` lists what happened to it in order. ``assignee``, ``due_at`` and
    ``work_order`` are the last plan that somebody made for it.
    """

    __tablename__ = "alarms"
    __table_args__ = (
        Index("ix_alarms_pump_id_raised_at", "pump_id", "raised_at"),
        Index("ix_alarms_operator_raised_at", "operator", "raised_at"),
        Index("ix_alarms_raised_at", "raised_at"),
    )

    id: Mapped[str] = mapped_column(primary_key=True)
    pump_id: Mapped[int] = mapped_column(ForeignKey("pumps.id"))
    operator: Mapped[str]
    onset_at: Mapped[datetime]
    raised_at: Mapped[datetime]
    record_id: Mapped[str]
    condition: Mapped[str]
    cleared_at: Mapped[datetime | None]
    acknowledged: Mapped[bool]
    priority: Mapped[str]
    verdict_state: Mapped[str]
    side: Mapped[str]
    candidates: Mapped[list[str]] = mapped_column(JSON_COLUMN)
    beyond_limit: Mapped[bool]
    case_pressure_beyond: Mapped[bool] = mapped_column(server_default=false())
    shelved_until: Mapped[datetime | None]
    closed_at: Mapped[datetime | None]
    withdrawn_at: Mapped[datetime | None]
    cause: Mapped[str | None]
    assignee: Mapped[str | None]
    due_at: Mapped[datetime | None]
    work_order: Mapped[str | None]
    comments: Mapped[int] = mapped_column(server_default="0")
    history: Mapped[list[AlarmEvent]] = mapped_column(JSON_COLUMN)
    created_at: Mapped[datetime]
    changed_at: Mapped[datetime]


class AlarmAction(Base):
    """What somebody did about an alarm, with what there was to see at that moment; rows are only added.

    ``onset_at`` says which stretch of the pump's history was meant, ``seen_at`` the event time of the last record
    known then. A plan is kept whole, as it was after the change.
    """

    __tablename__ = "alarm_actions"

    id: Mapped[int] = mapped_column(primary_key=True)
    alarm_id: Mapped[str] = mapped_column(ForeignKey("alarms.id"), index=True)
    pump_id: Mapped[int] = mapped_column(ForeignKey("pumps.id"), index=True)
    kind: Mapped[str]
    by: Mapped[str]
    reason: Mapped[str | None]
    until: Mapped[datetime | None]
    assignee: Mapped[str | None]
    due_at: Mapped[datetime | None]
    work_order: Mapped[str | None]
    onset_at: Mapped[datetime]
    seen_at: Mapped[datetime]
    seen_state: Mapped[str]
    seen_priority: Mapped[str]
    done_at: Mapped[datetime]


class Webhook(Base):
    """Where changes of alarms are sent; the secret must be known to sign with it. ``operator`` None: every one's."""

    __tablename__ = "webhooks"

    id: Mapped[str] = mapped_column(primary_key=True)
    operator: Mapped[str | None] = mapped_column(index=True)
    url: Mapped[str]
    events: Mapped[list[str]] = mapped_column(JSON_COLUMN)
    secret: Mapped[str]
    owner: Mapped[str]
    created_at: Mapped[datetime]
    ended_at: Mapped[datetime | None]
    end_reason: Mapped[str | None]


class Message(Base):
    """Something worth telling, written in the transaction in which it happened."""

    __tablename__ = "messages"

    id: Mapped[str] = mapped_column(primary_key=True)
    operator: Mapped[str]
    event: Mapped[str]
    payload: Mapped[JsonObject]
    created_at: Mapped[datetime] = mapped_column(index=True)


class Delivery(Base):
    """One message on its way to one webhook or one mail address."""

    __tablename__ = "deliveries"
    __table_args__ = (
        Index("ix_deliveries_status_due_at", "status", "due_at"),
        Index("ix_deliveries_webhook_id_id", "webhook_id", "id"),
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    message_id: Mapped[str] = mapped_column(ForeignKey("messages.id"), index=True)
    webhook_id: Mapped[str | None] = mapped_column(ForeignKey("webhooks.id"))
    address: Mapped[str | None]
    status: Mapped[str]
    attempts: Mapped[int]
    due_at: Mapped[datetime]
    tried_at: Mapped[datetime | None]
    delivered_at: Mapped[datetime | None]
    outcome: Mapped[str | None]
