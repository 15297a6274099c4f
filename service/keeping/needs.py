"""Which raw bytes a database needs: every record's, archives that a job has still to take in, documents of jobs."""

from collections.abc import Iterator

from sqlalchemy import Connection, select

from service.registry.raw_bytes import archive_digests, document_digests
from service.storage.tables import Job, Record


def needed(connection: Connection) -> dict[str, str]:
    """Hashes of the bytes that must be there, with who needs them."""
    found: dict[str, str] = {}
    kept = select(Record.content_hash, Record.id).where(Record.raw_removed_at.is_(None))
    for digest, record_id in connection.execute(kept.order_by(Record.received_at, Record.id)):
        found.setdefault(digest, f"record {record_id}")
    waiting = archive_digests().where(Job.finished_at.is_(None))
    for query, who in ((waiting, "a bulk import"), *((q, "a document of a job") for q in document_digests())):
        for digest in connection.scalars(query):
            found.setdefault(digest, who)
    return found


def welcome(connection: Connection) -> Iterator[str]:
    """Hashes of bytes that are kept while they are there: archives that were taken in, bytes that a retention spared."""
    yield from connection.scalars(archive_digests().where(Job.finished_at.is_not(None)))
    yield from connection.scalars(select(Record.content_hash).where(Record.raw_removed_at.is_not(None)))
