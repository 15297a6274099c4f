"""What people enter is stored at once; its pumps are folded behind the commit, and nobody else waits for that.

The transaction that stores an entry takes the mark of its pumps that they are through. Who enters waits for the fold, others
read the verdicts of before as long as it lasts. A process that dies in between leaves the marks to the sweep.
"""

from collections.abc import Collection
from functools import partial

import structlog
from sqlalchemy.orm import Session

from service.errors import Problem
from service.history.archive import Archive
from service.history.knowledge import knowledge
from service.ingest.names import look_of
from service.monitoring.precedence import left_to_newer, take_over
from service.monitoring.refold import Cause, apart
from service.storage.database import Database, afterwards
from service.storage.failures import is_passing
from service.storage.tables import Pump

log = structlog.get_logger("casedrain")


def fold_behind(session: Session, pumps: Collection[Pump], archive: Archive, cause: Cause) -> None:
    """Have pumps folded anew as soon as what a session of ``Database.writing`` has changed of them is committed.

    The caller holds the pumps' row locks (Postgres) or the write transaction (SQLite). A fold that fails then is made by
    the sweep; the entry stays. A pump that a newer release has judged is left to a process of that release.

    Raises
    ------
    Unavailable
        when the change asks for a record to be read again whose raw bytes are gone: nothing may be stored then.
    """
    session.flush()
    ours = []
    for pump in pumps:
        if left_to_newer(session, pump):
            continue
        pump.look = pump.look or look_of(pump.serial)
        knowledge(session, pump, archive, most_anew=0)
        take_over(pump, whole=False)
        ours.append(pump.id)
    session.flush()
    if ours:
        afterwards(session, partial(_folded_behind, archive=archive, pump_ids=ours, cause=cause))


def _folded_behind(database: Database, archive: Archive, pump_ids: Collection[int], cause: Cause) -> None:
    for pump_id in sorted(pump_ids):
        try:
            apart(database, archive, pump_id, cause, reduce_first=True)
        except Problem as problem:
            log.warning("verdicts follow later", pump_id=pump_id, problem=problem.detail)
        except Exception as error:
            # the entry is stored, and an error would have it sent again
            if not is_passing(error):
                log.exception("verdicts follow later", pump_id=pump_id)
            else:
                log.warning("verdicts follow later", pump_id=pump_id, problem=str(error)[:200])
