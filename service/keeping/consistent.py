"""One consistent state of database and job engine while others write: connections that see neither before nor after.

Postgres keeps both in one database: one transaction. SQLite has a file for each: both are locked for the moment in
which the reading of the first begins; the engine's, which is small, stays locked until it is read.
"""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from sqlalchemy import Connection, MetaData, NullPool, Table, create_engine, event, inspect
from sqlalchemy.engine import make_url

from service.jobs.engine import system_url
from service.storage.database import Database

ENGINE_SCHEMA = "dbos"
_WAIT_S = 60


class State(NamedTuple):
    """Connections into one state; the engine's comes first to be read and is None where no engine has run yet."""

    main: Connection
    engine: Connection | None
    engine_tables: list[Table]


@contextmanager
def consistent(database: Database) -> Iterator[State]:
    """One state of everything; read ``engine`` first, ``engine_is_read`` follows at the end of the block."""
    with ExitStack() as open_:
        if not database.is_sqlite:
            # the option stands before the transaction begins, and no statement of it is cut short
            connection = open_.enter_context(
                database.engine.connect().execution_options(isolation_level="REPEATABLE READ", postgresql_readonly=True)
            )
            connection.exec_driver_sql("SET LOCAL statement_timeout = 0")
            tables = engine_tables(connection)
            yield State(connection, connection if tables else None, tables)
            return
        locked = open_.enter_context(_locked(database.engine.url.database or ""))
        file = Path(make_url(system_url(database.url)).database or "")
        jobs = open_.enter_context(_locked(str(file))) if file.exists() else None
        reading = open_.enter_context(database.engine.connect())
        reading.exec_driver_sql("SELECT count(*) FROM alembic_version").scalar()
        locked.rollback()
        yield State(reading, jobs, engine_tables(jobs) if jobs is not None else [])


def engine_is_read(database: Database, state: State) -> None:
    """Let the engine go on, now that its tables are read."""
    if database.is_sqlite and state.engine is not None:
        state.engine.rollback()


def engine_tables(connection: Connection) -> list[Table]:
    """Tables of the job engine, those referred to before those that refer, without its list of migrations."""
    schema = None if connection.dialect.name == "sqlite" else ENGINE_SCHEMA
    if schema is not None and not inspect(connection).has_schema(schema):
        return []
    found = MetaData()
    found.reflect(connection, schema=schema, resolve_fks=False)
    return [table for table in found.sorted_tables if table.name != "dbos_migrations"]


def engine_version(connection: Connection) -> int:
    """How many migrations of the engine's tables have run."""
    name = "dbos_migrations" if connection.dialect.name == "sqlite" else f'"{ENGINE_SCHEMA}".dbos_migrations'
    return int(connection.exec_driver_sql(f"SELECT max(version) FROM {name}").scalar() or 0)  # noqa: S608


@contextmanager
def _locked(file: str) -> Iterator[Connection]:
    """A connection to an SQLite file whose transaction keeps others from writing; the file's ways stay its own."""
    engine = create_engine(f"sqlite:///{file}", poolclass=NullPool, connect_args={"timeout": _WAIT_S})
    event.listen(engine, "connect", _on_connect)
    event.listen(engine, "begin", lambda connection: connection.exec_driver_sql("BEGIN IMMEDIATE"))
    with engine.connect() as connection:
        connection.begin()
        yield connection


def _on_connect(connection: Any, _record: Any) -> None:
    connection.isolation_level = None
