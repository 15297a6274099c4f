"""Failures of the database and of the disk as problems: what is away for a while, what is full, what cannot be stored."""

import errno
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager

import structlog
from sqlalchemy import exc

from service.errors import Invalid, Problem, StorageFull, Unavailable

log = structlog.get_logger("casedrain")
RETRY_AFTER_S = 2
"""When a client may come back after a failure that passes (our choice: a restart of a database takes some seconds)."""
_PASSING_CLASSES = ("08", "53", "57", "58")
"""Postgres' classes of connections lost, resources short, an operator's stop, the system around it."""
_PASSING = ("40001", "40P01", "55P03", "25006", "57014")
"""Met another transaction, waited too long for a lock, was sent to a standby, took too long."""
_MET = ("40001", "40P01")
_PG_DISK_FULL = "53100"
_NO_SPACE = (errno.ENOSPC, errno.EDQUOT)
_SQLITE_FULL = (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR_SHMSIZE, sqlite3.SQLITE_IOERR_WRITE)
_SQLITE_PASSING = (
    sqlite3.SQLITE_BUSY,
    sqlite3.SQLITE_LOCKED,
    sqlite3.SQLITE_IOERR,
    sqlite3.SQLITE_CANTOPEN,
    sqlite3.SQLITE_READONLY,
    sqlite3.SQLITE_PROTOCOL,
)
_AWAY = "the database does not answer; nothing was changed: repeat the request"
_BUSY = "the database is busy with other work; nothing was changed: repeat the request"
_MET_WORDS = "another change of the same data was under way; nothing was changed: repeat the request"
_FULL = "the disk is full; nothing was changed: what is stored can be read, uploads wait for space"
UNSTORABLE = "the request holds characters or numbers that cannot be stored; nothing was changed"


def problem_of(error: BaseException) -> Problem | None:
    """The problem that an unexpected error stands for; None when it is a mistake of ours.

    The causes of an error are looked at too: a library may have wrapped what the disk has said.
    """
    current: BaseException | None = error
    while current is not None:
        found = _of_one(current)
        if found is not None:
            return found
        current = current.__cause__
    return None


@contextmanager
def passing_failures(what: str) -> Iterator[None]:
    """Go on where the block fails because database or disk are away or full; the log says ``what`` was not done."""
    try:
        yield
    except Exception as error:
        problem = problem_of(error)
        if problem is None:
            raise
        log.warning(what, problem=problem.detail)


def is_passing(error: BaseException) -> bool:
    """True where database or disk are the cause, whatever was made of it: the same work may do in a while."""
    current: BaseException | None = error
    while current is not None:
        if isinstance(current, StorageFull):
            return True
        if not isinstance(current, Problem) and isinstance(_of_one(current), Unavailable | StorageFull):
            return True
        current = current.__cause__ or (None if current.__suppress_context__ else current.__context__)
    return False


def is_full(error: BaseException) -> bool:
    """True where an error says that a disk has no room left."""
    return isinstance(problem_of(error), StorageFull)


def _of_one(error: BaseException) -> Problem | None:
    if isinstance(error, Problem):
        return error
    if isinstance(error, exc.TimeoutError):
        return _later("every connection to the database is in use; nothing was changed: repeat the request")
    if isinstance(error, exc.DBAPIError):
        return _of_driver(error)
    if isinstance(error, sqlite3.Error):
        return _of_sqlite(error)
    if isinstance(error, OSError) and error.errno in _NO_SPACE:
        return StorageFull(_FULL)
    return None


def _of_driver(error: exc.DBAPIError) -> Problem | None:
    original = error.orig
    if isinstance(error, exc.DataError):
        return Invalid(UNSTORABLE)
    if isinstance(original, sqlite3.Error):
        return _of_sqlite(original)
    state = getattr(original, "sqlstate", None)
    if state == _PG_DISK_FULL:
        return StorageFull(_FULL)
    if state in _MET:
        return _later(_MET_WORDS)
    if state is None:
        # the driver itself gave up: no connection, or one that was lost on the way
        lost = error.connection_invalidated or isinstance(error, exc.OperationalError | exc.InterfaceError)
        return _later(_AWAY) if lost else None
    if state in _PASSING or state[:2] in _PASSING_CLASSES:
        return _later(_AWAY if state[:2] in ("08", "57") else _BUSY)
    return None


def _of_sqlite(error: sqlite3.Error) -> Problem | None:
    code = getattr(error, "sqlite_errorcode", None)
    if code is None:
        return None
    if code in _SQLITE_FULL or code & 0xFF == sqlite3.SQLITE_FULL:
        return StorageFull(_FULL)
    if code & 0xFF in _SQLITE_PASSING:
        return _later(_BUSY if code & 0xFF in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED) else _AWAY)
    return None


def _later(words: str) -> Unavailable:
    return Unavailable(words, headers={"Retry-After": str(RETRY_AFTER_S)})
