"""Operators: who there is, and how long their raw bytes are kept."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta

from pydantic import ConfigDict, Field
from sqlalchemy import func, or_, select, union, update
from sqlalchemy.orm import Session

from service.access.security import Principal
from service.answers.administration import Operator
from service.bodies import Body
from service.errors import Forbidden, NotFound
from service.registry.raw_bytes import archive_digests
from service.storage.database import Database
from service.storage.raw_store import RawStore
from service.storage.tables import Aircraft, ApiKey, Job, OperatorSettings, Pump, Record, Refusal, User, Webhook


class OperatorChange(Body):
    """Settings of an operator; ``retention_days`` null keeps raw bytes for ever."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"retention_days": 730}]})
    retention_days: int | None = Field(ge=1, le=36_500)


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
    settings = {row.operator: row.retention_days for row in session.scalars(select(OperatorSettings))}
    return [
        {
            "operator": name,
            "pumps": pumps.get(name, 0),
            "records": records.get(name, 0),
            "retention_days": settings.get(name),
        }
        for name in operators
    ]


def change(session: Session, asker: Principal, operator: str, body: OperatorChange) -> None:
    """Set how long an operator's raw bytes are kept.

    Raises
    ------
    Forbidden
        when the asker may not manage this operator.
    """
    if asker.operator not in (None, operator):
        raise Forbidden(f"the key of {asker.owner} belongs to operator {asker.operator}")
    row = session.get(OperatorSettings, operator)
    if row is None:
        row = OperatorSettings(operator=operator)
        session.add(row)
    row.retention_days, row.changed_at, row.author = body.retention_days, datetime.now(UTC), asker.owner
    session.flush()


def expire(database: Database, raw_store: RawStore, now: datetime) -> int:
    """Remove raw bytes that are older than their operator keeps them: how many files went.

    Reductions and verdicts stay, so that no baseline is lost; notes of refused uploads go as well. Bytes that any
    record within its retention still needs are kept.
    """
    with database.reading() as session:
        kept_days = session.execute(
            select(OperatorSettings.operator, OperatorSettings.retention_days).where(
                OperatorSettings.retention_days.is_not(None)
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
