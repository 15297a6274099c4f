"""What an older release has reduced and folded is made again: pump by pump, in chunks, while the service works."""

import random
import time
from threading import Event

import structlog
from sqlalchemy import and_, exists, or_, select
from sqlalchemy.orm import Session

from service import __version__
from service.errors import Problem
from service.history.analysis import keep_analysis
from service.history.archive import Archive
from service.history.knowledge import knowledge
from service.identity import release_number
from service.monitoring.precedence import is_ours, made_with, newer_release, take_over
from service.monitoring.reanalysis import reprocessed
from service.monitoring.refold import Cause
from service.storage.database import Database
from service.storage.failures import is_passing
from service.storage.tables import ANALYSED, Pump, Record

CHUNK = 25
"""Records of one transaction: about a second of work is lost when the process ends in it."""
CAUSE = Cause("release_changed", __version__)
log = structlog.get_logger("casedrain")


def due_pumps(session: Session, *, own_release: bool) -> list[int]:
    """Pumps with records whose reductions or verdicts other code has made.

    Parameters
    ----------
    own_release
        Those of another build of this very release too: at the start only, or two builds would take turns for ever.
    """
    older = or_(Pump.made_by.is_(None), Pump.made_by < release_number())
    other = Pump.made_with != made_with()
    due = or_(Pump.made_with.is_(None), other if own_release else and_(other, older))
    counts = exists().where(Record.pump_id == Pump.id, Record.status == ANALYSED)
    return list(session.scalars(select(Pump.id).where(is_ours(), due, counts).order_by(Pump.id)))


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


class Renewal:
    """The renewal of a fleet; a pump that cannot be read now keeps its verdicts until the next start."""

    def __init__(self, database: Database, archive: Archive) -> None:
        self._database = database
        self._archive = archive
        self._failed: set[int] = set()
        self._started = False

    def due(self) -> list[int]:
        """Pumps that are due, those of another build of this very release too until they have been seen once."""
        with self._database.reading() as session:
            due = [i for i in due_pumps(session, own_release=not self._started) if i not in self._failed]
        self._started = self._started or not due
        return due

    def run(self, stopped: Event) -> int:
        """Renew every pump that is due; gives the number of records that were reduced again.

        Raises what the driver raises while the database is away: whoever calls comes again.
        """
        due = self.due()
        random.shuffle(due)  # replicas that start together share the work
        if not due:
            return 0
        log.info("reductions and verdicts of other code are made again", pumps=len(due))
        began, records = time.perf_counter(), 0
        for pump_id in due:
            if stopped.is_set():
                break
            try:
                records += self._renew(pump_id, stopped)
            except Problem as problem:
                self._failed.add(pump_id)
                log.warning("verdicts left as they were", pump_id=pump_id, problem=problem.detail)
            except Exception as error:
                if is_passing(error):
                    raise
                self._failed.add(pump_id)
                log.exception("verdicts left as they were", pump_id=pump_id)
        else:
            self._started = True
        seconds = round(time.perf_counter() - began, 1)
        log.info("made again", pumps=len(due), records=records, seconds=seconds, unfinished=stopped.is_set())
        return records

    def _renew(self, pump_id: int, stopped: Event) -> int:
        with self._database.reading() as session:
            if session.scalar(select(Pump.made_with).where(Pump.id == pump_id)) == made_with():
                return 0  # another process, or an upload, was quicker
        records = reduced_again(self._database, self._archive, pump_id, stopped)
        if not stopped.is_set():
            reprocessed(self._database, self._archive, pump_id, CAUSE)
        return records
