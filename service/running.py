"""A service put together from its settings: database, raw store, parser, acceptance."""

from service.access.crowd import Crowd
from service.access.installation import cursor_key
from service.access.oidc import Issuer
from service.context import Context
from service.history.archive import Archive
from service.ingest.parser_pool import ParserLimits, ParserPool
from service.ingest.raw import Limits
from service.monitoring.acceptance import Acceptance
from service.pump_types.slipper_maps import take_all
from service.settings import Settings
from service.storage.audit_anchor import begin
from service.storage.audit_key import AuditKey
from service.storage.database import Database, pending_migration, upgrade
from service.storage.raw_store import RawStore
from service.storage.spool import Spool


def opened(settings: Settings) -> Context:
    """Open database and raw store.

    An SQLite file is migrated; a Postgres database that is behind is left alone.

    Raises
    ------
    RuntimeError
        when a Postgres database is behind, when a folder or the raw store cannot be had, or when the key of the audit log is
        none; the words name the setting.
    """
    try:
        settings.data_dir.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RuntimeError(f"CASEDRAIN_DATA_DIR: {settings.data_dir} cannot be made: {error.strerror}") from None
    try:
        take_all(settings.data_dir)
    except ValueError as error:
        raise RuntimeError(f"CASEDRAIN_DATA_DIR: {error}") from None
    audit_key = AuditKey(settings.audit_key.get_secret_value(), settings.data_dir.resolve())
    database = Database(settings.effective_database_url, audit_key)
    behind = pending_migration(database)
    if behind is not None:
        if not database.is_sqlite:
            database.close()
            raise RuntimeError(behind)
        upgrade(settings.effective_database_url)
    try:
        begin(database, audit_key, settings.data_dir.resolve())
    except ValueError as fault:
        database.close()
        raise RuntimeError(str(fault)) from None
    try:
        raw_store = RawStore(settings.effective_raw_store_url)
    except (ValueError, ImportError, OSError) as error:
        database.close()
        raise RuntimeError(f"CASEDRAIN_RAW_STORE_URL: the store cannot be opened: {error}") from None
    limits = Limits(settings.max_inflated_bytes, settings.max_rows)
    spool = Spool(settings.effective_spool_dir, settings.min_free_bytes)
    parser_limits = ParserLimits(settings.max_parse_seconds, settings.max_parse_memory_bytes)
    waiting = settings.max_waiting_uploads, settings.max_parse_seconds
    parser = ParserPool(spool.folder, parser_limits, settings.parse_workers, *waiting)
    archive = Archive(raw_store, spool, parser, limits)
    acceptance = Acceptance(database, archive)
    return Context(settings, database, archive, acceptance, cursor_key(database), Crowd(settings), _issuer(settings))


def _issuer(settings: Settings) -> Issuer | None:
    if not settings.oidc_issuer:
        return None
    return Issuer(settings.oidc_issuer, settings.oidc_client_id, settings.oidc_client_secret.get_secret_value())
