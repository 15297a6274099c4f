"""The one engine for all that outlasts a request: dbos, in this process on SQLite, on any number of workers with Postgres.

dbos keeps one engine per process; several applications of one process (tests, a restart in place) share it as long as
they work on the same database. What there is to do stands in rows of our own; the lookout hands it to dbos.
"""

import threading
import time

from dbos import DBOS
from sqlalchemy.engine import make_url

from service.context import Context
from service.jobs import state
from service.jobs.lookout import look_out
from service.jobs.state import Engine

_STOP_TIMEOUT_S = 10.0
_lock = threading.Lock()
_lookouts: list[threading.Thread] = []


def start(context: Context, *, upkeep: bool = True) -> None:
    """Start the engine, which takes up what earlier processes have left unfinished.

    Parameters
    ----------
    upkeep
        Whether it does more than jobs: acknowledged records, deliveries, housekeeping, renewal.

    Raises
    ------
    RuntimeError
        when this process runs one on another database already.
    """
    url = system_url(context.database.url)
    with _lock:
        if state.running is not None:
            if state.running.url != url:
                raise RuntimeError("this process runs jobs on another database already")
            state.running.users += 1
            state.running.context = context
            return
        state.running = Engine(context, url, upkeep=upkeep)
        thread = threading.Thread(target=look_out, args=(state.running,), name="lookout", daemon=True)
        thread.start()
        _lookouts[:] = [thread]


def stop() -> None:
    """Stop the engine; a running job ends its item, and is taken up by whoever is there or starts next."""
    with _lock:
        engine = state.running
        if engine is None:
            return
        engine.users -= 1
        if engine.users:
            return
        engine.stopping.set()
        engine.called.set()
        for thread in _lookouts:
            thread.join(timeout=_STOP_TIMEOUT_S)
        deadline = time.monotonic() + _STOP_TIMEOUT_S
        while engine.running and time.monotonic() < deadline:
            time.sleep(0.02)
        if engine.awake:
            DBOS.destroy()
        engine.presence.end()
        state.running = None


def submit(job_id: str) -> None:
    """Say that a job is committed; the row is enough, whoever looks next takes it up."""
    call()


def acknowledged(context: Context, record_id: str) -> None:
    """Say that a record is committed that nobody waits for."""
    call()


def call() -> None:
    """Have the engine of this process look for work now."""
    if state.running is not None:
        state.running.called.set()


def is_in_hand(job_id: str) -> bool:
    """Whether a living worker has something of a job in hand, as far as this process knows."""
    engine = state.running
    if engine is None or not engine.awake:
        return False
    pending = DBOS.list_workflows(
        workflow_id_prefix=f"{job_id}/", status="PENDING", load_input=False, load_output=False
    )
    names = {w.executor_id for w in pending if w.executor_id}
    return bool(names) and (engine.name in names or bool(engine.presence.living(names)))


def system_url(url: str) -> str:
    """Where dbos keeps its tables: Postgres' own schema of the database, a file beside SQLite's."""
    parsed = make_url(url)
    if parsed.get_backend_name() == "sqlite":
        return f"sqlite:///{parsed.database}.jobs"
    return parsed.set(drivername="postgresql").render_as_string(hide_password=False)
