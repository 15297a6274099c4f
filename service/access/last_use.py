"""When a key or a session was last used: noted where it costs nobody anything, at most once at a time."""

import threading
import time
from collections.abc import Callable

from sqlalchemy.orm import Session

from service.storage.database import Database
from service.storage.failures import passing_failures

_AGAIN_S = 10.0
"""After an attempt that found the database busy or a disk full the next waits (our choice)."""
_MOST = 10_000
_lock = threading.Lock()
_tried: dict[str, float] = {}


def note_use(database: Database, whose: str, note: Callable[[Session], object]) -> None:
    """Let ``note`` write in a transaction that gives up rather than wait: reads go on whoever writes or fills the disk.

    Parameters
    ----------
    whose
        Name of what was used; others that use it at the same moment note nothing.
    """
    now = time.monotonic()
    name = f"{database.url}\n{whose}"
    with _lock:
        if now - _tried.get(name, -_AGAIN_S) < _AGAIN_S:
            return
        if len(_tried) > _MOST:
            _tried.clear()
        _tried[name] = now
    with passing_failures("the time of a last use is not noted"), database.noting() as session:
        note(session)
