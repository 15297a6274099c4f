"""A backup put back: into the same installation or a new one, on the same kind of database or the other."""

import os
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from dbos import DBOS
from sqlalchemy import Connection, MetaData, create_engine, inspect
from sqlalchemy.engine import make_url

from service.errors import Unavailable
from service.jobs.engine import system_url
from service.keeping.consistent import ENGINE_SCHEMA, engine_tables, engine_version
from service.keeping.container import Source, parts_of, read
from service.keeping.manifest import (
    AUDIT_KEY_FILE,
    BackupManifest,
    EngineState,
    Manifest,
    faults_of_files,
    raw_files,
    raw_name,
    read_backup,
    rows_name,
    shapes,
)
from service.keeping.rows import SKIPPED, Rows, load
from service.settings import Settings
from service.storage.audit_anchor import Anchor, keep_anchor
from service.storage.audit_key import KEY_FILE
from service.storage.database import Database, upgrade
from service.storage.raw_store import RawStore

_TELLING = ("records", "pumps", "aircraft", "jobs", "users", "api_keys", "audit_entries", "audit_links", "deletions")
"""Tables whose rows say that a database is in use."""
_RESTORING = ".restoring"
_CLIENTS = (
    "SELECT count(*) FROM pg_stat_activity "
    "WHERE datname = current_database() AND pid <> pg_backend_pid() AND backend_type = 'client backend'"
)


def restore(settings: Settings, place: Path, *, force: bool = False) -> BackupManifest:
    """Put a backup back to where the settings point; gives its manifest.

    Raw bytes go first, then the database as a whole, then key and anchor: after an end in between it is called again.

    Raises
    ------
    ValueError
        when the backup is not whole, or the database there is used and ``force`` is not given, or a server is at work.
    """
    with read(place) as source:
        manifest = read_backup(source)
        faults = faults_of_files(source, manifest)
        if faults:
            raise ValueError(f"the backup is not whole, nothing was restored: {'; '.join(faults[:5])}")
        folder = settings.data_dir.resolve()
        folder.mkdir(parents=True, exist_ok=True)
        url = settings.effective_database_url
        _check_free(url, force)
        store = RawStore(settings.effective_raw_store_url)
        for digest, _ in raw_files(source):
            _put_back(source, store, digest, folder)
        if make_url(url).get_backend_name() == "sqlite":
            _into_sqlite(source, manifest, url)
        else:
            _into_postgres(source, manifest, url)
        _keep_key(source, folder)
        head = manifest["audit"]
        keep_anchor(folder, Anchor(head["chain_id"], head["count"], head["link"]))
    return manifest


def fill_sqlite(source: Source, manifest: Manifest, file: Path) -> None:
    """Make an SQLite file of a backup's rows, at the backup's own revision."""
    url = f"sqlite:///{file}"
    upgrade(url, manifest["database"]["revision"])
    database = Database(url)
    try:
        with database.engine.begin() as connection:
            connection.exec_driver_sql("PRAGMA defer_foreign_keys = ON")
            _fill(connection, source, shapes(manifest["database"]), "rows")
            _numbers(connection)
        with database.engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
            connection.exec_driver_sql("PRAGMA wal_checkpoint(TRUNCATE)")
    finally:
        database.close()


def _put_back(source: Source, store: RawStore, digest: str, folder: Path) -> None:
    """Put raw bytes back where they are not, or are no longer what their name says."""
    try:
        for _ in store.chunks(digest):
            pass
    except Unavailable:
        store.remove(digest)
    else:
        return
    with tempfile.NamedTemporaryFile(dir=folder, prefix="restoring-") as held:
        with source.open(raw_name(digest)) as file:
            for part in parts_of(file):
                held.write(part)
        held.flush()
        store.put_file(Path(held.name), digest)


def _into_sqlite(source: Source, manifest: BackupManifest, url: str) -> None:
    final = Path(make_url(url).database or "")
    jobs = Path(make_url(system_url(url)).database or "")
    new, new_jobs = final.with_name(final.name + _RESTORING), jobs.with_name(jobs.name + _RESTORING)
    for file in (new, new_jobs):
        _remove_sqlite(file)
    try:
        fill_sqlite(source, manifest, new)
        upgrade(f"sqlite:///{new}")
        _at_rest(new)
        if manifest["engine"]:
            engine_url = f"sqlite:///{new_jobs}"
            DBOS.migrate(engine_url)
            with _plain(engine_url) as connection:
                _fill_engine(connection, source, manifest["engine"], manifest["database"]["kind"], None)
        _remove_logs(jobs)
        if new_jobs.exists():
            os.replace(new_jobs, jobs)
        else:
            jobs.unlink(missing_ok=True)
        _remove_logs(final)
        os.replace(new, final)
    finally:
        for file in (new, new_jobs):
            _remove_sqlite(file)


def _into_postgres(source: Source, manifest: BackupManifest, url: str) -> None:
    database = Database(url)
    try:
        with database.engine.begin() as connection:
            connection.exec_driver_sql(f'DROP SCHEMA IF EXISTS "{ENGINE_SCHEMA}" CASCADE')
            for view in inspect(connection).get_view_names():
                connection.exec_driver_sql(f'DROP VIEW IF EXISTS "{view}" CASCADE')
            old = MetaData()
            old.reflect(connection)
            old.drop_all(connection)
        upgrade(url, manifest["database"]["revision"])
        if manifest["engine"]:
            DBOS.migrate(system_url(url))
        with database.engine.begin() as connection:
            connection.exec_driver_sql("SET LOCAL statement_timeout = 0")
            if manifest["engine"]:
                _fill_engine(connection, source, manifest["engine"], manifest["database"]["kind"], ENGINE_SCHEMA)
            _fill(connection, source, shapes(manifest["database"]), "rows")
            _numbers(connection)
        upgrade(url)
    finally:
        database.close()


def _fill(connection: Connection, source: Source, tables: list[Rows], kind: str) -> None:
    quoted = connection.dialect.identifier_preparer
    for shape in reversed(tables):
        schema = f"{quoted.quote(shape.schema)}." if shape.schema else ""
        connection.exec_driver_sql(f"DELETE FROM {schema}{quoted.quote(shape.table)}")  # noqa: S608 - names of tables
    for shape in tables:
        with source.open(rows_name(kind, shape.table)) as file:
            load(connection, shape, file)


def _fill_engine(connection: Connection, source: Source, kept: EngineState, kind: str, schema: str | None) -> None:
    """Put the engine's tables back, which came from a database of a kind, into a schema."""
    tables = [shape._replace(schema=schema) for shape in shapes(kept)]
    ours, theirs = engine_version(connection), kept["version"]
    if kind != connection.dialect.name:
        # each kind of database has its own migrations of the engine, and tables that only they need
        here = {table.name: set(table.c.keys()) for table in engine_tables(connection)}
        tables = [_narrowed(shape, here[shape.table]) for shape in tables if shape.table in here]
    elif theirs > ours:
        raise ValueError(f"the backup's job engine is at version {theirs}, this release has {ours}: take a newer one")
    _fill(connection, source, tables, "engine")


def _narrowed(shape: Rows, names: set[str]) -> Rows:
    return shape._replace(columns=tuple((name, kind if name in names else SKIPPED) for name, kind in shape.columns))


def _numbers(connection: Connection) -> None:
    """Let the next row of every table have a number above all that were ever given, erased entries of the log included."""
    told = "SELECT max(n) FROM (SELECT max(id) AS n FROM audit_entries UNION ALL SELECT max(entry_id) FROM audit_links) AS x"
    highest = int(connection.exec_driver_sql(told).scalar() or 0) if inspect(connection).has_table("audit_links") else 0
    if connection.dialect.name == "sqlite":
        if highest:
            connection.exec_driver_sql("DELETE FROM sqlite_sequence WHERE name = 'audit_entries'")
            connection.exec_driver_sql(f"INSERT INTO sqlite_sequence VALUES ('audit_entries', {highest})")  # noqa: S608
        return
    owned = (
        "SELECT c.table_name, c.column_name, pg_get_serial_sequence(quote_ident(c.table_name), c.column_name) AS seq "
        "FROM information_schema.columns c WHERE c.table_schema = current_schema()"
    )
    for table, column, sequence in connection.exec_driver_sql(owned).all():
        if sequence is not None:
            most = connection.exec_driver_sql(f'SELECT max("{column}") FROM "{table}"').scalar() or 0  # noqa: S608
            most = max(int(most), highest if table == "audit_entries" else 0)
            if most:
                connection.exec_driver_sql(f"SELECT setval('{sequence}', {most})")


def _check_free(url: str, force: bool) -> None:
    file = Path(make_url(url).database or "") if make_url(url).get_backend_name() == "sqlite" else None
    if file is not None and not file.exists():
        return
    database = Database(url)
    try:
        with database.engine.connect() as connection:
            tables = set(inspect(connection).get_table_names())
            used = [t for t in _TELLING if t in tables and _has_rows(connection, t)]
            others = 0
            if file is None:
                others = int(connection.exec_driver_sql(_CLIENTS).scalar() or 0)
    finally:
        database.close()
    if used and not force:
        raise ValueError(
            f"the database there is used (it has rows of {', '.join(used)}): nothing was restored; "
            "name another one, or overwrite it with --force"
        )
    if others or (file is not None and _is_open(file)):
        raise ValueError("a server or another program works on the database: stop it first, nothing was restored")


def _has_rows(connection: Connection, table: str) -> bool:
    return connection.exec_driver_sql(f'SELECT 1 FROM "{table}" LIMIT 1').first() is not None  # noqa: S608


def _is_open(file: Path) -> bool:
    """Whether another process has an SQLite file open: only who is alone may change how its log is kept."""
    with closing(sqlite3.connect(file, timeout=0.0)) as connection:
        try:
            connection.execute("PRAGMA journal_mode = DELETE")
        except sqlite3.OperationalError:
            return True
    return False


def _at_rest(file: Path) -> None:
    with closing(sqlite3.connect(file)) as connection:
        connection.execute("PRAGMA journal_mode = DELETE")


def _remove_sqlite(file: Path) -> None:
    _remove_logs(file)
    file.unlink(missing_ok=True)


def _remove_logs(file: Path) -> None:
    """Remove what lies beside an SQLite file: a log of another file would be played into the one that takes its place."""
    for suffix in ("-wal", "-shm", "-journal"):
        file.with_name(file.name + suffix).unlink(missing_ok=True)


def _keep_key(source: Source, folder: Path) -> None:
    # the database there is free or given up: so is a key that has signed nothing else
    if AUDIT_KEY_FILE not in source.names():
        return
    file = folder / KEY_FILE
    with source.open(AUDIT_KEY_FILE) as kept:
        content = b"".join(parts_of(kept))
    partial = file.with_name(file.name + _RESTORING)
    partial.unlink(missing_ok=True)
    with os.fdopen(os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as writing:
        writing.write(content)
    os.replace(partial, file)


@contextmanager
def _plain(url: str) -> Iterator[Connection]:
    engine = create_engine(url)
    try:
        with engine.begin() as connection:
            yield connection
    finally:
        engine.dispose()
