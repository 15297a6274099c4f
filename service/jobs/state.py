"""What is running in this process, and how it lasts: through an outage it waits, at a stop it leaves off."""

import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

import structlog

from service.context import Context
from service.errors import StorageFull, Unavailable
from service.jobs.presence import presence_of
from service.monitoring.renewal import Renewal
from service.storage.failures import is_passing

log = structlog.get_logger("casedrain.jobs")
T = TypeVar("T")
JOBS, RECORDS, UPKEEP = "casedrain-jobs", "casedrain-records", "casedrain-upkeep"
"""Queues: what people ask for, analysis of acknowledged records, and what keeps the house."""
VERSION = "2"
"""Version of the workflows' shape: a process takes up what another of the same version has left."""
_LONGEST_PAUSE_S = 8.0
_PATIENCE_S = 60.0
"""How long a part other than the database may be away before a job ends as failed (our choice)."""


class StoppedError(BaseException):
    """The process shuts down in the middle of work; the engine cannot note it, and whoever is there takes it up."""


class Engine:
    """What is running in this process.

    Attributes
    ----------
    name
        Tells workers apart: of a process of its own, so that two on one host need no names given by hand.
    running
        Ids of the workflows in hand.
    awake
        Whether dbos is launched: while there is nothing to do it is not, and asks its database nothing.
    upkeep
        Whether this process does more than jobs: acknowledged records, deliveries, housekeeping, renewal.
    waiting_until
        Records that could not be analysed for a reason of ours, with the next attempt and the pause before it [s].
    """

    def __init__(self, context: Context, url: str, *, upkeep: bool) -> None:
        self.context = context
        self.url = url
        self.upkeep = upkeep
        self.users = 1
        self.name = f"{context.settings.worker_name}-{uuid.uuid4().hex[:12]}"
        self.presence = presence_of(context.database, self.name)
        self.stopping, self.called = threading.Event(), threading.Event()
        self.running: set[str] = set()
        self.awake = False
        self.n_workers = 1
        self.renewal = Renewal(context.database, context.archive, context.acceptance.settling.in_hand)
        self.waiting_until: dict[str, tuple[float, float]] = {}

    @contextmanager
    def at_work(self, workflow_id: str | None) -> Iterator[None]:
        """A workflow is in hand while the block runs."""
        name = workflow_id or ""
        self.running.add(name)
        try:
            yield
        finally:
            self.running.discard(name)

    def lastingly(self, what: str, work: Callable[[], T]) -> T:
        """Do work that may be repeated, again and again while the database is away or a disk is full.

        Raises
        ------
        StoppedError
            when the process shuts down.
        Unavailable
            when another part that is needed has not answered for a minute.
        """
        pause, failing_since = 1.0, None
        while True:
            if self.stopping.is_set():
                raise StoppedError
            began = time.monotonic()
            try:
                return work()
            except Exception as error:
                if self.stopping.is_set():
                    raise StoppedError from error
                now = time.monotonic()
                if not is_passing(error):
                    if now - began > _PATIENCE_S or failing_since is None:
                        failing_since = now
                    if not isinstance(error, Unavailable | StorageFull) or now - failing_since > _PATIENCE_S:
                        raise
                if now - began > _PATIENCE_S:
                    pause = 1.0
                log.warning("work waits and goes on", what=what, error=f"{type(error).__name__}: {error}"[:300])
            self.stopping.wait(pause)
            pause = min(2.0 * pause, _LONGEST_PAUSE_S)


running: Engine | None = None
"""The engine of this process: dbos keeps one, and so must we."""


def current() -> Engine:
    """The engine that a workflow works in.

    Raises
    ------
    RuntimeError
        when there is none.
    """
    if running is None:
        raise RuntimeError("a workflow without an engine")
    return running
