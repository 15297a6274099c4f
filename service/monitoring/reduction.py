"""What is stored of a pump's records is reduced again where it was made otherwise: in chunks, of which each stays done."""

from threading import Event

from sqlalchemy import select

from service.history.analysis import keep_analysis
from service.history.archive import Archive
from service.history.knowledge import knowledge
from service.monitoring.precedence import newer_release, take_over
from service.storage.database import Database
from service.storage.tables import ANALYSED, Pump, Record

CHUNK = 25
"""Records of one transaction: about a second of work is lost when the process ends in it."""


def reduced_again(database: Database, archive: Archive, pump_id: int, stopped: Event | None = None) -> int:
    """Reduce a pump's records again where what is stored was made otherwise, in chunks; gives how many were.

    What was done stays done: a process that is stopped, or dies, leaves the rest to the next one.

    Raises
    ------
    Problem
        when a record cannot be read again.
    """
    count = 0
    while stopped is None or not stopped.is_set():
        with database.reading() as session:
            pump = session.get(Pump, pump_id)
            if pump is None or newer_release(session, pump_id) is not None:
                break
            anew = knowledge(session, pump, archive, most_anew=CHUNK).anew
        if not anew:
            break
        with database.writing() as session:
            locked = session.scalar(select(Pump).where(Pump.id == pump_id).with_for_update())
            if locked is None or newer_release(session, pump_id) is not None:
                break
            take_over(locked, whole=False)
            for row in session.scalars(select(Record).where(Record.id.in_(anew), Record.status == ANALYSED)):
                keep_analysis(row, anew[row.id])
        count += len(anew)
    return count
