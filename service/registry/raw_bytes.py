"""Raw bytes by who needs them: uploads of records, and archives whose members a job takes in."""

from sqlalchemy import Select, select

from service.tables import Job, Record

_BULK_IMPORT = "bulk-import"
_ARCHIVE = Job.parameters["content_hash"].as_string()


def archive_digests() -> Select[str]:
    """Hashes of archives that were uploaded for bulk imports; narrow it by columns of ``Job``."""
    return select(_ARCHIVE).where(Job.kind == _BULK_IMPORT)


def needs_of(digest: str) -> tuple[Select[str], Select[str]]:
    """Queries for records and for jobs that need the bytes of a hash."""
    return (
        select(Record.id).where(Record.content_hash == digest).limit(1),
        select(Job.id).where(Job.kind == _BULK_IMPORT, digest == _ARCHIVE).limit(1),
    )
