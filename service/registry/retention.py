"""What goes with its age, by operator: raw bytes, jobs that have ended, entries of the audit log; nothing under a hold."""

from datetime import datetime, timedelta

from sqlalchemy import delete, select
from sqlalchemy.orm import InstrumentedAttribute

from service.access import audit
from service.access.security import Principal
from service.registry.operators import expire
from service.registry.raw_bytes import archive_digests, document_digests, needs_of
from service.storage.database import Database
from service.storage.raw_store import RawStore
from service.storage.tables import Job, JobItem, OperatorSettings

RETENTION = Principal(owner="retention", role="admin", operator=None)
"""Who erases what is older than its operator keeps it."""


def expire_all(database: Database, raw_store: RawStore, now: datetime) -> None:
    """Remove everything that is older than its operator keeps it; safe to repeat, by any number of replicas."""
    expire(database, raw_store, now)
    expire_jobs(database, raw_store, now)
    expire_audit(database, now)


def expire_jobs(database: Database, raw_store: RawStore, now: datetime) -> int:
    """Remove jobs that ended longer ago than kept, with their items, archives and documents: how many jobs went.

    Records that a bulk import took in stay, with their own bytes.
    """
    gone = 0
    for operator, limit in _limits(database, OperatorSettings.job_days, now).items():
        old = (Job.operator == operator) & (Job.finished_at < limit)
        with database.writing() as session:
            ids = list(session.scalars(select(Job.id).where(old)))
            digests: set[str] = set()
            for query in (archive_digests(), *document_digests()):
                digests |= set(session.scalars(query.where(old)))
            session.execute(delete(JobItem).where(JobItem.job_id.in_(select(Job.id).where(old))))
            session.execute(delete(Job).where(old))
            for digest in sorted(digests):
                if all(session.scalar(need) is None for need in needs_of(digest)):
                    raw_store.remove(digest)
        gone += len(ids)
    return gone


def expire_audit(database: Database, now: datetime) -> int:
    """Erase entries that are older than kept, with their salts: how many went.

    Their links stay, and an entry says which they are: the chain verifies as it does after a deletion.
    """
    gone = 0
    for operator, limit in _limits(database, OperatorSettings.audit_days, now).items():
        with database.writing() as session:
            erased = audit.erase(session, operator, limit)
            if not erased:
                continue
            details = {"until": limit.isoformat(), audit.ERASED: erased}
            audit.note(session, RETENTION, audit.EXPIRY, f"operator/{operator}", None, details)
            gone += sum(last - first + 1 for first, last in erased)
    return gone


def _limits(database: Database, days: InstrumentedAttribute[int | None], now: datetime) -> dict[str, datetime]:
    """Instant before which something goes, by operator."""
    query = select(OperatorSettings.operator, days).where(days.is_not(None), OperatorSettings.legal_hold.is_(False))
    with database.reading() as session:
        return {operator: now - timedelta(days=int(kept or 0)) for operator, kept in session.execute(query)}
