"""An installation as its settings name it, for those who keep it: nothing is migrated, no process is started."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from service.settings import Settings
from service.storage.audit_key import AuditKey
from service.storage.database import Database, pending_migration
from service.storage.raw_store import RawStore


class Installation(NamedTuple):
    """Database, raw store and key of an installation, and the folder of its data."""

    database: Database
    raw_store: RawStore
    audit_key: AuditKey
    folder: Path


@contextmanager
def installation(settings: Settings) -> Iterator[Installation]:
    """Open what is there.

    Raises
    ------
    ValueError
        when there is no database, or one that another release has written.
    """
    folder = settings.data_dir.resolve()
    key = AuditKey(settings.audit_key.get_secret_value(), folder)
    url = settings.effective_database_url
    database = Database(url, key)
    file = database.engine.url.database if database.is_sqlite else None
    if file is not None and not Path(file).exists():
        raise ValueError(f"there is no database at {file}: check CASEDRAIN_DATA_DIR and CASEDRAIN_DATABASE_URL")
    try:
        behind = pending_migration(database)
        if behind is not None:
            raise ValueError(f"{behind}, or use the release that wrote it")
        yield Installation(database, RawStore(settings.effective_raw_store_url), key, folder)
    finally:
        database.close()
