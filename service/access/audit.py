"""The audit log: every change says who made it, in the transaction that makes it, whose commit chains it."""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import Select, delete, exists, select
from sqlalchemy.orm import Session

from service.access.security import Principal
from service.storage.audit_chain import NOTED, new_salt
from service.storage.tables import AuditEntry, AuditLink

DELETION, EXPIRY = "operator.delete", "audit.expire"
ERASED = "erased"
"""Detail of an entry of a deletion or an expiry: spans of positions whose entries it erased."""
_BATCH = 500


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
    entry = AuditEntry(
        at=datetime.now(UTC),
        actor=principal.owner,
        role=principal.role,
        operator=operator,
        action=action,
        subject=subject,
        details=dict(details or {}),
        salt=new_salt(),
    )
    session.add(entry)
    session.info.setdefault(NOTED, []).append(entry)


def erase(session: Session, operator: str, before: datetime | None = None) -> list[list[int]]:
    """Erase an operator's entries with their salts: first and last positions of the links that stay behind.

    With ``before`` only those that are older.

    An entry that says so, in its ``details`` under ``erased``, is what the proof of the log accepts for them.
    """
    gone = delete(AuditEntry).where(AuditEntry.operator == operator)
    if before is not None:
        # what an older release wrote beside the chain has no link that could stand for it
        gone = gone.where(AuditEntry.at < before, exists().where(AuditLink.entry_id == AuditEntry.id))
    ids = sorted(session.scalars(gone.returning(AuditEntry.id)))
    spans: list[list[int]] = []
    for start in range(0, len(ids), _BATCH):
        found = select(AuditLink.position).where(AuditLink.entry_id.in_(ids[start : start + _BATCH]))
        for position in session.scalars(found.order_by(AuditLink.position)):
            if spans and spans[-1][1] == position - 1:
                spans[-1][1] = position
            else:
                spans.append([position, position])
    return spans


def adopt(session: Session, principal: Principal, reason: str) -> int:
    """Chain the entries that a release before the chain has written beside it: how many; an entry says so."""
    beside = ~exists().where(AuditLink.entry_id == AuditEntry.id)
    found = list(session.scalars(select(AuditEntry).where(beside).order_by(AuditEntry.id)))
    for entry in found:
        entry.salt = entry.salt or new_salt()
    session.info.setdefault(NOTED, []).extend(found)
    if found:
        note(session, principal, "audit.adopt", "audit", None, {"entries": [e.id for e in found], "reason": reason})
    return len(found)


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
