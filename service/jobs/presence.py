"""Who is at work on a database: every worker holds a lock that ends with its process, however the process ends.

Nothing is written while all are well, no clock is compared, and nobody has to be given a name by hand.
"""

import fcntl
import os
import zlib
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, Protocol
from urllib.parse import quote

from sqlalchemy import Connection, Executable, text

from service.storage.database import Database

_CLASS = 1_667_527_524
"""First number of the advisory locks that workers hold (our choice)."""
_LIVING = text(
    "SELECT objid::bigint FROM pg_locks WHERE locktype = 'advisory' AND granted AND objsubid = 2 AND classid = :klass "
    "AND database = (SELECT oid FROM pg_database WHERE datname = current_database())"
)
_KEEPALIVES = ("tcp_keepalives_idle = 10", "tcp_keepalives_interval = 5", "tcp_keepalives_count = 3")
"""A machine that has gone without a word is noticed by the database's server within half a minute."""


class Presence(Protocol):
    """One worker's lock, and how it looks at those of others."""

    grace_s: float
    """How long another's lock must be seen missing: after a restart of the database all are, until each looks again."""

    def seen(self, statement: Executable) -> tuple[Any, ...]:
        """Ask one question of one row, and hold the lock from then on; raises what the driver raises."""

    def living(self, names: Collection[str]) -> set[str]:
        """Those of ``names`` whose workers are there."""

    def number(self) -> int:
        """How many workers there are."""

    def end(self) -> None:
        """Let the lock go."""


def presence_of(database: Database, name: str) -> Presence:
    """The lock of a worker of this name: in a file beside SQLite's, in the session of a connection to Postgres."""
    return _InFile(database, name) if database.is_sqlite else _InSession(database, name)


class _InFile:
    grace_s = 0.0

    def __init__(self, database: Database, name: str) -> None:
        self._database = database
        self._folder = Path(f"{database.engine.url.database}.workers")
        self._folder.mkdir(parents=True, exist_ok=True)
        self._path = self._folder / quote(name, safe="")
        self._file = _locked_file(self._path)

    def seen(self, statement: Executable) -> tuple[Any, ...]:
        with self._database.reading() as session:
            return tuple(session.execute(statement).one())

    def living(self, names: Collection[str]) -> set[str]:
        return {name for name in names if _is_locked(self._folder / quote(name, safe=""))}

    def number(self) -> int:
        return sum(_is_locked(path) for path in self._folder.iterdir())

    def end(self) -> None:
        self._path.unlink(missing_ok=True)
        self._file.close()


class _InSession:
    grace_s = 8.0

    def __init__(self, database: Database, name: str) -> None:
        self._database = database
        self._number = _number(name)
        self._connection: Connection | None = None

    def seen(self, statement: Executable) -> tuple[Any, ...]:
        try:
            if self._connection is None:
                engine = self._database.engine
                self._connection = engine.connect().execution_options(isolation_level="AUTOCOMMIT")
                for setting in _KEEPALIVES:
                    self._connection.exec_driver_sql(f"SET {setting}")
                lock = text("SELECT pg_try_advisory_lock(:klass, :number)")
                self._connection.execute(lock, {"klass": _CLASS, "number": self._number})
            row = tuple(self._connection.execute(statement).one())
            self._connection.commit()
        except Exception:
            self.end()
            raise
        return row

    def living(self, names: Collection[str]) -> set[str]:
        held = self._held()
        return {name for name in names if _number(name) in held}

    def number(self) -> int:
        return len(self._held())

    def _held(self) -> set[int]:
        with self._database.reading() as session:
            return set(session.scalars(_LIVING, {"klass": _CLASS}))

    def end(self) -> None:
        connection, self._connection = self._connection, None
        if connection is not None:
            with suppress(Exception):
                connection.detach()  # the lock and the settings are no request's
            with suppress(Exception):
                connection.close()


def _locked_file(path: Path) -> IO[bytes]:
    """A new file with a lock; another that looks at it before the lock is there takes it for a dead one's, and it goes."""
    while True:
        file = path.open("wb")
        fcntl.flock(file, fcntl.LOCK_EX)
        if path.exists() and path.stat().st_ino == os.fstat(file.fileno()).st_ino:
            return file
        file.close()


def _number(name: str) -> int:
    return zlib.crc32(name.encode()) & 0x7FFF_FFFF


def _is_locked(path: Path) -> bool:
    """True where a worker holds its file; one that nobody holds is what a dead one has left, and goes."""
    try:
        with path.open("rb") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return True
            path.unlink(missing_ok=True)
            return False
    except FileNotFoundError:
        return False
