"""Operators: who there is, and how long what is theirs is kept."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

from pydantic import ConfigDict, Field
from sqlalchemy import func, or_, select, union, update
from sqlalchemy.orm import Session

from service.access.security import Principal
from service.answers.administration import Operator
from service.bodies import Body
from service.errors import Conflict, Fault, Forbidden, Invalid, NotFound
from service.registry.raw_bytes import archive_digests
from service.storage.database import Database
from service.storage.raw_store import RawStore
from service.storage.tables import Aircraft, ApiKey, Job, OperatorSettings, Pump, Record, Refusal, User, Webhook


class OperatorChange(Body):
    """What shall change of an operator's settings; what is left out stays, days of null keep for ever."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"retention_days": 730, "job_days": 90}]})
    retention_days: int | None = Field(default=None, ge=1, le=36_500)
    job_days: int | None = Field(default=None, ge=1, le=36_500)
    audit_days: int | None = Field(default=None, ge=30, le=36_500)
    legal_hold: bool | None = None


def visible(session: Session, asker: Principal) -> list[str]:
    """Operators that have anything here, of those that an admin may manage."""
    tables = (Pump, Record, Aircraft, ApiKey, User, Webhook, OperatorSettings)
    names = union(*(select(table.operator.label("operator")) for table in tables)).subquery()
    query = select(names.c.operator).where(names.c.operator.is_not(None)).order_by(names.c.operator)
    if asker.operator is not None:
        query = query.where(names.c.operator == asker.operator)
    return list(session.scalars(query))


def check_visible(session: Session, asker: Principal, operator: str) -> None:
    """Raise ``NotFound`` unless an admin may manage an operator that there is."""
    asker.require("admin")
    if operator not in visible(session, asker):
        raise NotFound(f"there is no operator {operator}")


def documents(session: Session, operators: Sequence[str]) -> list[Operator]:
    """Operators in the shape of the API."""
    pumps = _counts(session, Pump)
    records = _counts(session, Record)
    settings = {row.operator: row for row in session.scalars(select(OperatorSettings))}
    return [
        {
            "operator": name,
            "pumps": pumps.get(name, 0),
            "records": records.get(name, 0),
            "retention_days": row.retention_days if row else None,
            "job_days": row.job_days if row else None,
            "audit_days": row.audit_days if row else None,
            "legal_hold": bool(row and row.legal_hold),
        }
        for name in operators
        for row in (settings.get(name),)
    ]


def change(session: Session, asker: Principal, operator: str, body: OperatorChange) -> None:
    """Set how long raw bytes, jobs and audit entries of an operator are kept, or hold all of them.

    Raises
    ------
    Forbidden
        when the asker may not manage this operator, or would end a hold of theirs.
    Invalid
        when nothing is asked for.
    """
    wanted = body.model_dump(exclude_unset=True)
    if not wanted or wanted.get("legal_hold", False) is None:
        raise Invalid("nothing was changed", [Fault("body", "names no setting, or a hold that is neither on nor off")])
    if asker.operator not in (None, operator):
        raise Forbidden(f"the key of {asker.owner} belongs to operator {asker.operator}")
    row = session.get(OperatorSettings, operator)
    if row is None:
        row = OperatorSettings(operator=operator, legal_hold=False)
        session.add(row)
    if row.legal_hold and wanted.get("legal_hold") is False and asker.operator is not None:
        raise Forbidden("a legal hold is ended by an admin who sees every operator")
    for name, value in wanted.items():
        setattr(row, name, value)
    row.changed_at, row.author = datetime.now(UTC), asker.owner
    session.flush()


def check_no_hold(session: Session, operator: str) -> None:
    """Raise ``Conflict`` where a legal hold keeps everything of an operator."""
    row = session.get(OperatorSettings, operator)
    if row is not None and row.legal_hold:
        raise Conflict(f"operator {operator} is under a legal hold: nothing of it is deleted")


def expire(database: Database, raw_store: RawStore, now: datetime) -> int:
    """Remove raw bytes that are older than their operator keeps them: how many files went.

    Reductions and verdicts stay, so that no baseline is lost; notes of refused uploads go as well. Bytes that any
    record within its retention still needs are kept.
    """
    with database.reading() as session:
        kept_days = session.execute(
            select(OperatorSettings.operator, OperatorSettings.retention_days).where(
                OperatorSettings.retention_days.is_not(None), OperatorSettings.legal_hold.is_(False)
            )
        ).all()
    limits = {operator: now - timedelta(days=int(days or 0)) for operator, days in kept_days}
    if not limits:
        return 0
    with database.writing() as session:
        old: set[str] = set()
        for operator, limit in limits.items():
            expired = select(Record.content_hash).where(Record.operator == operator, Record.received_at < limit)
            old |= set(session.scalars(expired))
            archives = archive_digests().where(Job.operator == operator, Job.created_at < limit)
            old |= set(session.scalars(archives.where(Job.finished_at.is_not(None))))
            for refusal in session.scalars(
                select(Refusal).where(Refusal.operator == operator, Refusal.received_at < limit)
            ):
                session.delete(refusal)
        needed = select(Record.content_hash).where(
            or_(
                Record.operator.not_in(limits),
                *((Record.operator == o) & (Record.received_at >= limit) for o, limit in limits.items()),
            )
        )
        needed_archives = archive_digests().where(
            or_(
                Job.operator.not_in(limits),
                Job.finished_at.is_(None),
                *((Job.operator == o) & (Job.created_at >= limit) for o, limit in limits.items()),
            )
        )
        gone = sorted(old - set(session.scalars(needed)) - set(session.scalars(needed_archives)))
        for digest in gone:
            marked = update(Record).where(Record.content_hash == digest, Record.raw_removed_at.is_(None))
            session.execute(marked.values(raw_removed_at=now, overview=None))
        return sum(raw_store.remove(digest) for digest in gone)


def _counts(session: Session, table: type[Pump] | type[Record]) -> dict[str, int]:
    query = select(table.operator, func.count()).group_by(table.operator)
    return {name: int(n) for name, n in session.execute(query)}
