"""The audit log: every change says who made it, in the transaction that makes it."""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import Select, select
from sqlalchemy.orm import Session

from service.access.security import Principal
from service.storage.tables import AuditEntry


def note(
    session: Session,
    principal: Principal,
    action: str,
    subject: str,
    operator: str | None,
    details: Mapping[str, Any] | None = None,
) -> None:
    """Add one entry to the transaction of ``session``.

    Parameters
    ----------
    principal
        Who makes the change.
    action, subject
        What is done to what, e.g. ``alarm.acknowledge`` and ``alarm/5f3c``.
    operator
        The tenant whose data change; None for what holds for all.
    details
        JSON values that help whoever reads this in a year. Never a secret.
    """
    session.add(
        AuditEntry(
            at=datetime.now(UTC),
            actor=principal.owner,
            role=principal.role,
            operator=operator,
            action=action,
            subject=subject,
            details=dict(details or {}),
        )
    )


def entries(
    principal: Principal,
    *,
    actor: str | None = None,
    action: str | None = None,
    subject: str | None = None,
    operator: str | None = None,
    since: datetime | None = None,
    until: datetime | None = None,
    after: Sequence[Any] | None = None,
) -> Select[AuditEntry]:
    """Entries that this principal may see, newest first; ``action`` also matches as a prefix before a dot."""
    query = select(AuditEntry)
    if principal.operator is not None:
        query = query.where(AuditEntry.operator == principal.operator)
    if operator is not None:
        query = query.where(AuditEntry.operator == operator)
    if actor is not None:
        query = query.where(AuditEntry.actor == actor)
    if action is not None:
        query = query.where((AuditEntry.action == action) | AuditEntry.action.startswith(f"{action}.", autoescape=True))
    if subject is not None:
        query = query.where(AuditEntry.subject == subject)
    if since is not None:
        query = query.where(AuditEntry.at >= since)
    if until is not None:
        query = query.where(AuditEntry.at < until)
    if after is not None:
        query = query.where(AuditEntry.id < after[0])
    return query.order_by(AuditEntry.id.desc())
