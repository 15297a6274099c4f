"""Verdicts behind a record that came late into a long history: made right after it, and before anybody reads them.

The record is answered with its own verdict; the pump is marked, in the same transaction, as one whose later verdicts are to
be made again. A thread makes them as soon as no more records come for it; whoever reads first has them made at once. After
a crash the mark is what the next start, or another replica, goes on from.
"""

import threading
import time
from dataclasses import dataclass, field

import structlog

from service.errors import Problem
from service.history.archive import Archive
from service.monitoring.folded import Cause, GivenUpError
from service.monitoring.refold import apart, attempted
from service.storage.database import Database

QUIET_S = 0.2
"""A pump whose last record is so long ago is folded in the background (our choice)."""
log = structlog.get_logger("casedrain")


@dataclass(slots=True)
class _Left:
    """A pump whose later verdicts are to be made: whose it is, why, and when its last record came [s]."""

    operator: str
    cause: Cause
    touched_at: float
    touches: int = 0
    making: threading.Lock = field(default_factory=threading.Lock)
    """Who holds it makes them; others wait, or leave them to whoever does."""


class Settling:
    """The pumps of one process that have such verdicts."""

    def __init__(self, database: Database, archive: Archive) -> None:
        self._database, self._archive = database, archive
        self._left: dict[int, _Left] = {}
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None
        self._closed = False

    @property
    def is_due(self) -> bool:
        """Whether there is any."""
        return bool(self._left)

    def in_hand(self) -> frozenset[int]:
        """The pumps that have such verdicts."""
        return frozenset(self._left)

    def leave(self, pump_id: int, operator: str, cause: Cause) -> None:
        """Note that verdicts of an operator's pump are to be made."""
        with self._changed:
            held = self._left.get(pump_id)
            self._left[pump_id] = left = _Left(operator, cause, time.monotonic())
            if held is not None:
                left.touches, left.making = held.touches + 1, held.making
            if self._thread is None and not self._closed:
                self._thread = threading.Thread(target=self._run, name="settling", daemon=True)
                self._thread.start()
            self._changed.notify()

    def touch(self, pump_id: int) -> None:
        """Another record of a pump comes: a fold in the background would only be in its way."""
        with self._changed:
            held = self._left.get(pump_id)
            if held is not None:
                held.touches += 1
                held.touched_at = time.monotonic()

    def settle(self, operator: str | None = None) -> None:
        """Make what is left of every pump of an operator, or of all, now; whoever reads others' does not wait for it.

        One that cannot be made keeps its verdicts until its next record.
        """
        for pump_id, held in list(self._left.items()):
            if operator not in (None, held.operator):
                continue
            with held.making:  # made once, also where many ask, and where the thread is at it
                if self._left.get(pump_id) is not held:
                    continue
                before = held.touches
                try:
                    apart(self._database, self._archive, pump_id, held.cause)
                except Problem as problem:
                    log.warning("verdicts left as they were", pump_id=pump_id, problem=problem.detail)
                self._done(pump_id, held, before)

    def close(self) -> None:
        """End the thread; what is left, the next start makes."""
        with self._changed:
            self._closed = True
            self._left.clear()
            self._changed.notify()
        if self._thread is not None:
            self._thread.join(timeout=10.0)

    def _run(self) -> None:
        while True:
            with self._changed:
                if self._closed:
                    return
                quiet = [(i, held) for i, held in self._left.items() if time.monotonic() - held.touched_at > QUIET_S]
                if not quiet:
                    self._changed.wait(QUIET_S if self._left else None)
                    continue
            for pump_id, held in quiet:
                if held.making.acquire(blocking=False):
                    try:
                        self._make(pump_id, held)
                    finally:
                        held.making.release()
                else:
                    held.touched_at = time.monotonic()

    def _make(self, pump_id: int, held: _Left) -> None:
        before = held.touches

        def given_up() -> bool:
            return self._closed or held.touches != before or self._left.get(pump_id) is not held

        try:
            done = attempted(self._database, self._archive, pump_id, held.cause, given_up)
        except GivenUpError:
            return
        except Exception:
            log.exception("verdicts are left to the next start or the pump's next record", pump_id=pump_id)
            done = True
        if done:
            self._done(pump_id, held, before)

    def _done(self, pump_id: int, held: _Left, touches: int) -> None:
        """Forget a pump, unless another record has come for it since."""
        with self._changed:
            if self._left.get(pump_id) is held and held.touches == touches:
                del self._left[pump_id]
