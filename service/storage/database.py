"""Engine and sessions: the same code for SQLite and Postgres, one transaction per request."""

import fcntl
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from alembic import command
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, Engine, create_engine, event, exc, text
from sqlalchemy.engine import ExceptionContext, make_url
from sqlalchemy.orm import Session, sessionmaker

import service
from service.errors import Invalid
from service.storage import json_text
from service.storage.audit_chain import chain_noted
from service.storage.audit_key import AuditKey
from service.storage.failures import UNSTORABLE

_CONNECT_TIMEOUT_S = 5
_POOL_TIMEOUT_S = 10
"""Longest wait for a connection of the pool; then the request is told to come back."""
_JSON: dict[str, Any] = {"json_serializer": json_text.written, "json_deserializer": json_text.read}
_MIGRATION_LOCK = 7_263_901_455
"""Number of the advisory lock that whoever migrates holds (our choice)."""
_AFTERWARDS = "afterwards"
_LOCK_TIMEOUT_MS = 30_000
"""Longest wait for what another transaction holds: a pump that is folded, a table that is migrated."""
_PATIENCE_MS = 50
"""Longest wait of what may be left out."""


class Database:
    """One engine with sessions for reading and for writing."""

    def __init__(self, url: str, audit_key: AuditKey | None = None) -> None:
        self.url = url
        self.engine = _engine(url)
        self._reading = sessionmaker(self.engine, expire_on_commit=False)
        self._noting = sessionmaker(self.engine.execution_options(writes=True, patience_ms=_PATIENCE_MS))
        self._writing = sessionmaker(self.engine.execution_options(writes=True), expire_on_commit=False)
        self._turn = threading.Lock()
        event.listen(self._writing, "before_commit", lambda session: chain_noted(session, audit_key))

    @property
    def is_sqlite(self) -> bool:
        return self.engine.dialect.name == "sqlite"

    @property
    def folders(self) -> list[Path]:
        """Folder of an SQLite file; none for a server's database, whose disk is not ours to look at."""
        name = self.engine.url.database if self.is_sqlite else None
        return [Path(name).resolve().parent] if name and name != ":memory:" else []

    @contextmanager
    def reading(self) -> Iterator[Session]:
        """Session for reading; nothing it changes is kept."""
        with self._reading() as session:
            yield session

    @contextmanager
    def writing(self) -> Iterator[Session]:
        """Session whose block is one transaction: committed at the end, rolled back on any error.

        What was put off until then (``afterwards``) is done behind the commit, in transactions of its own.
        """
        # SQLite wakes nobody who waits for its writer's lock: they look again after ever longer pauses, and some for seconds
        waits = self.is_sqlite and self._turn.acquire(timeout=_LOCK_TIMEOUT_MS / 1e3)
        try:
            with self._writing.begin() as session:
                yield session
        finally:
            if waits:
                self._turn.release()
        for then in session.info.pop(_AFTERWARDS, ()):
            then(self)

    @contextmanager
    def noting(self) -> Iterator[Session]:
        """One transaction for what may be left out: SQLite's is given up where somebody else writes, not waited for."""
        with self._noting.begin() as session:
            yield session

    @contextmanager
    def snapshot(self) -> Iterator[Session]:
        """Session for reading all of its queries from one state of the database."""
        with self._reading() as session:
            if not self.is_sqlite:  # where a transaction that reads is one state anyway
                session.connection(execution_options={"isolation_level": "REPEATABLE READ"})
            yield session

    def revision(self) -> str | None:
        """Revision of the schema that the database is at."""
        with self.engine.connect() as connection:
            return MigrationContext.configure(connection).get_current_revision()

    def ping(self) -> None:
        """Ask the database for one row; raises what the driver raises."""
        with self.engine.connect() as connection:
            connection.execute(text("SELECT 1"))

    def write_over_freed(self, tables: Iterable[str]) -> None:
        """Leave nothing of deleted rows in the files: SQLite's pages and its log, Postgres' dead rows of ``tables``.

        It may take as long as the database is large; a full disk or others that read raise what the driver raises.
        """
        with self.engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
            if not self.is_sqlite:
                for name in tables:
                    connection.exec_driver_sql(f'VACUUM "{name}"')
                return
        raw = self.engine.raw_connection()
        try:
            # what was deleted now is zeroed already (secure_delete); the rest may be from before that was so
            for statement in ("PRAGMA wal_checkpoint(TRUNCATE)", "VACUUM", "PRAGMA wal_checkpoint(TRUNCATE)"):
                raw.cursor().execute(statement)
        finally:
            raw.close()

    def close(self) -> None:
        """Close every pooled connection."""
        self.engine.dispose()


def afterwards(session: Session, then: Callable[[Database], None]) -> None:
    """Put something off until a session of ``Database.writing`` has been committed; it is dropped where that fails."""
    session.info.setdefault(_AFTERWARDS, []).append(then)


def _engine(url: str) -> Engine:
    parsed = make_url(url)
    if parsed.get_backend_name() == "sqlite":
        if parsed.database and parsed.database != ":memory:":
            Path(parsed.database).parent.mkdir(parents=True, exist_ok=True)
        engine = create_engine(parsed, connect_args={"timeout": 30, "check_same_thread": False}, **_JSON)
        event.listen(engine, "connect", _on_sqlite_connect)
        event.listen(engine, "begin", _on_sqlite_begin)
        event.listen(engine, "handle_error", _on_unstorable)
        return engine
    if parsed.drivername == "postgresql":
        parsed = parsed.set(drivername="postgresql+psycopg")
    # a dead peer must not hang a request: connect_timeout alone does not cover an established connection
    options = {
        "connect_timeout": _CONNECT_TIMEOUT_S,
        "client_encoding": "utf8",
        "keepalives": 1,
        "keepalives_idle": 10,
        "keepalives_interval": 5,
        "keepalives_count": 3,
        "tcp_user_timeout": 15_000,
        "options": f"-c statement_timeout=60000 -c lock_timeout={_LOCK_TIMEOUT_MS} -c timezone=UTC",
    }
    pool = {"pool_pre_ping": True, "pool_size": 10, "max_overflow": 10, "pool_timeout": _POOL_TIMEOUT_S}
    engine = create_engine(parsed, connect_args=options, **pool, **_JSON)
    event.listen(engine, "handle_error", _on_unstorable)
    return engine


def _on_unstorable(context: ExceptionContext) -> None:
    """Values that the driver cannot write: a number beyond 64 bits, half a surrogate pair, a NUL for Postgres."""
    if isinstance(context.original_exception, OverflowError | UnicodeEncodeError) or (
        isinstance(context.sqlalchemy_exception, exc.DataError)
    ):
        raise Invalid(UNSTORABLE) from context.original_exception


def _on_sqlite_connect(connection: Any, _record: Any) -> None:
    connection.isolation_level = None  # SQLAlchemy's begin event decides how a transaction starts
    cursor = connection.cursor()
    for pragma in (
        "journal_mode=WAL",
        "synchronous=FULL",
        f"busy_timeout={_LOCK_TIMEOUT_MS}",
        "foreign_keys=ON",
        "secure_delete=ON",
    ):
        cursor.execute(f"PRAGMA {pragma}")
    cursor.close()


def _on_sqlite_begin(connection: Connection) -> None:
    # a deferred read-then-write fails with "database is locked" in spite of the timeout
    options = connection.get_execution_options()
    patience_ms = options.get("patience_ms", _LOCK_TIMEOUT_MS)
    if patience_ms == _LOCK_TIMEOUT_MS:
        connection.exec_driver_sql("BEGIN IMMEDIATE" if options.get("writes", False) else "BEGIN")
        return
    connection.exec_driver_sql(f"PRAGMA busy_timeout={patience_ms}")
    try:
        connection.exec_driver_sql("BEGIN IMMEDIATE")
    finally:
        connection.exec_driver_sql(f"PRAGMA busy_timeout={_LOCK_TIMEOUT_MS}")


def migrations_folder() -> Path:
    """Folder of the migrations: inside the installed package, or beside it in a checkout."""
    package = Path(service.__file__).resolve().parent
    return next(f for f in (package / "migrations", package.parent / "migrations") if f.is_dir())


def alembic_config(url: str) -> Config:
    """Alembic's configuration for a database, independent of the current folder."""
    config = Config()
    config.set_main_option("script_location", str(migrations_folder()).replace("%", "%%"))
    config.attributes["url"] = url
    return config


def upgrade(url: str, revision: str = "head") -> None:
    """Bring a database to the newest schema, or to an older one; safe to call again, and at the same time: one waits."""
    engine = _engine(url)  # makes the folder of an SQLite file
    try:
        with _alone(engine):
            command.upgrade(alembic_config(url), revision)
    finally:
        engine.dispose()


@contextmanager
def _alone(engine: Engine) -> Iterator[None]:
    """Hold the right to migrate a database while the block runs."""
    name = engine.url.database
    if engine.dialect.name == "postgresql":
        with engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
            for setting in ("lock_timeout", "statement_timeout"):
                connection.exec_driver_sql(f"SET {setting} = 0")
            connection.exec_driver_sql(f"SELECT pg_advisory_lock({_MIGRATION_LOCK})")
            try:
                yield
            finally:
                connection.exec_driver_sql(f"SELECT pg_advisory_unlock({_MIGRATION_LOCK})")
                connection.invalidate()  # its settings are no request's
    elif name and name != ":memory:":
        with Path(f"{name}.migrating").open("w") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield
    else:
        yield


def pending_migration(database: Database) -> str | None:
    """Sentence that says how far the schema is behind; None when it is current."""
    head = ScriptDirectory.from_config(alembic_config(database.url)).get_current_head()
    current = database.revision()
    if current == head:
        return None
    return f"the database is at revision {current or 'none'}, this program needs {head}: run `casedrain db upgrade`"
