"""Raw bytes by who needs them: uploads of records, archives whose members a job takes in, documents that a job leaves."""

from sqlalchemy import Select, select

from service.answers.jobs import DOCUMENT_TYPES
from service.storage.tables import Job, Record

_BULK_IMPORT = "bulk-import"
_ARCHIVE = Job.parameters["content_hash"].as_string()
_DOCUMENTS = tuple(Job.result[("files", form, "content_hash")].as_string() for form in DOCUMENT_TYPES)


def archive_digests() -> Select[str]:
    """Hashes of archives that were uploaded for bulk imports; narrow it by columns of ``Job``."""
    return select(_ARCHIVE).where(Job.kind == _BULK_IMPORT)


def document_digests() -> tuple[Select[str], ...]:
    """Hashes of documents that jobs have left, by format; narrow each by columns of ``Job``."""
    return tuple(select(digest).where(digest.is_not(None)) for digest in _DOCUMENTS)


def needs_of(digest: str) -> tuple[Select[str], ...]:
    """Queries for records and for jobs that need the bytes of a hash."""
    return (
        select(Record.id).where(Record.content_hash == digest).limit(1),
        select(Job.id).where(Job.kind == _BULK_IMPORT, digest == _ARCHIVE).limit(1),
        *(select(Job.id).where(digest == document).limit(1) for document in _DOCUMENTS),
    )
