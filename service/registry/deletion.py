"""Deleting an operator whole: rows in one transaction, then raw bytes, then a receipt that proves it."""

import hashlib
import json
import uuid
from datetime import UTC, datetime, timedelta
from typing import Any, cast

from sqlalchemy import CursorResult, delete, select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from service.access import audit
from service.access.security import Principal
from service.access.sessions import name_hash
from service.answers import administration as answers
from service.answers.words import instant
from service.errors import Conflict, Unavailable
from service.registry.operators import check_no_hold
from service.registry.ownership import owned_tables, rows_of
from service.registry.raw_bytes import archive_digests, document_digests, needs_of
from service.storage.database import Database
from service.storage.failures import passing_failures
from service.storage.raw_store import RawStore
from service.storage.tables import AuditEntry, Backup, Deletion, FailedSignIn, Job, Record, User
from service.thresholds.pins import keep_counter


def delete_operator(database: Database, raw_store: RawStore, operator: str, asker: Principal, reason: str) -> Deletion:
    """Delete everything of an operator and give the receipt.

    Raises
    ------
    Conflict
        when an upload arrived in the middle, or a legal hold is on; nothing is deleted then.

    Notes
    -----
    A crash after the rows are gone leaves the deletion unfinished; ``finish_deletions`` ends it at the next start.
    """
    try:
        with database.writing() as session:
            row = _delete_rows(session, operator, asker, reason)
    except IntegrityError:
        raise Conflict(f"operator {operator} sent something at this moment: nothing was deleted, repeat") from None
    return _finish(database, raw_store, row.id)


def finish_deletions(database: Database, raw_store: RawStore) -> None:
    """End the deletions that a crash interrupted."""
    with database.reading() as session:
        ids = list(session.scalars(select(Deletion.id).where(Deletion.finished_at.is_(None))))
    for deletion_id in ids:
        _finish(database, raw_store, deletion_id)


def document(row: Deletion) -> answers.Deletion:
    """A deletion in the shape of the API; ``receipt`` is empty until it is finished."""
    return {
        "id": row.id,
        "operator": row.deleted_operator,
        "author": row.author,
        "reason": row.reason,
        "started_at": instant(row.started_at),
        "finished_at": instant(row.finished_at),
        "receipt": row.receipt,
    }


def receipt_hash(receipt: answers.Receipt) -> str:
    """SHA-256 of a receipt without its own ``sha256``, as canonical JSON."""
    bare = {key: value for key, value in receipt.items() if key != "sha256"}
    return hashlib.sha256(json.dumps(bare, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def _delete_rows(session: Session, operator: str, asker: Principal, reason: str) -> Deletion:
    check_no_hold(session, operator)
    sent = set(session.scalars(select(Record.content_hash).where(Record.operator == operator)))
    for query in (archive_digests(), *document_digests()):
        sent |= set(session.scalars(query.where(Job.operator == operator)))
    digests = sorted(sent)
    keep_counter(session)
    names = select(User.name).where(User.operator == operator)
    hashes = [name_hash(name) for name in session.scalars(names)]
    session.execute(delete(FailedSignIn).where(FailedSignIn.name_hash.in_(hashes)))
    erased = audit.erase(session, operator)
    counts = {AuditEntry.__tablename__: sum(last - first + 1 for first, last in erased)}
    for name, table in reversed(owned_tables().items()):
        if name in counts:
            continue
        gone = cast("CursorResult[Any]", session.execute(delete(table).where(rows_of(table, operator))))
        counts[name] = gone.rowcount
    row = Deletion(
        id=uuid.uuid4().hex,
        deleted_operator=operator,
        author=asker.owner,
        reason=reason,
        started_at=datetime.now(UTC),
        finished_at=None,
        pending={"digests": digests, "rows": counts, "erased": erased},
        receipt={},
    )
    session.add(row)
    # the operator's own log goes with its data; this entry stays with those who see everybody
    details = {"reason": reason, "rows": counts, audit.ERASED: erased}
    audit.note(session, asker, audit.DELETION, f"operator/{operator}", None, details)
    session.flush()
    return row


def _finish(database: Database, raw_store: RawStore, deletion_id: str) -> Deletion:
    with database.reading() as session:
        row = session.get_one(Deletion, deletion_id)
        backups = _backups(session, row.started_at)
    removed, shared = [], []
    for digest in row.pending["digests"]:
        if _is_needed(database, digest):
            shared.append(digest)
            continue
        _remove(database, raw_store, digest)
        removed.append(digest)
    with passing_failures("pages that a deletion has freed are not written over yet"):
        database.write_over_freed(owned_tables())
    receipt: answers.Receipt = {
        "operator": row.deleted_operator,
        "reason": row.reason,
        "author": row.author,
        "deleted_at": datetime.now(UTC).isoformat(),
        "rows": row.pending["rows"],
        "raw_files_removed": removed,
        "raw_files_of_others": len(shared),
        "audit_links_erased": row.pending.get("erased", []),
        "backups": backups,
    }
    receipt["sha256"] = receipt_hash(receipt)
    with database.writing() as session:
        row = session.get_one(Deletion, deletion_id)
        row.finished_at, row.receipt, row.pending = datetime.now(UTC), receipt, {}
    return row


def _backups(session: Session, at: datetime) -> list[answers.KeptBackup]:
    """Backups from before the deletion that nobody has said to be gone."""
    query = select(Backup).where(Backup.started_at <= at, Backup.removed_at.is_(None)).order_by(Backup.started_at)
    return [
        {
            "id": backup.id,
            "made_at": instant(backup.started_at),
            "age_days": round((at - backup.started_at) / timedelta(days=1), 2),
        }
        for backup in session.scalars(query)
    ]


def _remove(database: Database, raw_store: RawStore, digest: str) -> None:
    """Remove raw bytes; give them back if another operator sent the same ones meanwhile."""
    try:
        content = raw_store.get(digest)
    except Unavailable:
        raw_store.remove(digest)
        return
    raw_store.remove(digest)
    if _is_needed(database, digest):
        raw_store.put(content)


def _is_needed(database: Database, digest: str) -> bool:
    with database.reading() as session:
        return any(session.scalar(query) is not None for query in needs_of(digest))
