"""What is marked as to be made is made: what an older release has reduced and folded, what a dead process has left.

Pump by pump, in chunks, while the service works.
"""

import random
import time
from collections.abc import Callable, Collection
from threading import Event

import structlog
from sqlalchemy import and_, exists, or_, select
from sqlalchemy.orm import Session

from service import __version__
from service.errors import Problem
from service.history.archive import Archive
from service.identity import release_number
from service.monitoring.precedence import is_ours, made_with
from service.monitoring.reanalysis import reprocessed
from service.monitoring.reduction import reduced_again
from service.monitoring.refold import REPROCESSED, Cause
from service.storage.database import Database
from service.storage.failures import is_passing
from service.storage.tables import ANALYSED, Pump, Record, StoredAssessment

CAUSE = Cause("release_changed", __version__)
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 20.0, 300.0
log = structlog.get_logger("casedrain")


def due_pumps(session: Session, *, own_release: bool) -> list[int]:
    """Pumps with records or verdicts that other code has made, or that are marked as to be made.

    Parameters
    ----------
    own_release
        Those of another build of this very release too: at the start only, or two builds would take turns for ever.
    """
    older = or_(Pump.made_by.is_(None), Pump.made_by < release_number())
    other = Pump.made_with != made_with()
    due = or_(Pump.made_with.is_(None), other if own_release else and_(other, older))
    counts = exists().where(Record.pump_id == Pump.id, Record.status == ANALYSED)
    judged = exists().where(StoredAssessment.pump_id == Pump.id)  # of records that were all withdrawn
    return list(session.scalars(select(Pump.id).where(is_ours(), due, or_(counts, judged)).order_by(Pump.id)))


class Renewal:
    """The renewal of a fleet; a pump that cannot be made now is tried again, later and later, every five minutes at last.

    Those that this process makes already (``in_hand``) are left to it.
    """

    def __init__(
        self, database: Database, archive: Archive, in_hand: Callable[[], Collection[int]] = frozenset
    ) -> None:
        self._in_hand = in_hand
        self._database = database
        self._archive = archive
        self._put_off: dict[int, tuple[float, float]] = {}
        self._started = False

    def due(self) -> list[int]:
        """Pumps that are due, those of another build of this very release too until they have been seen once."""
        with self._database.reading() as session:
            marked = due_pumps(session, own_release=not self._started)
        now, in_hand = time.monotonic(), self._in_hand()
        due = [i for i in marked if self._put_off.get(i, (0.0, 0.0))[0] <= now and i not in in_hand]
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
        log.info("reductions and verdicts are made again", pumps=len(due))
        began, records = time.perf_counter(), 0
        for pump_id in due:
            if stopped.is_set():
                break
            try:
                records += self._renew(pump_id, stopped)
            except Problem as problem:
                pause = self._later(pump_id)
                log.warning("verdicts left as they were", pump_id=pump_id, problem=problem.detail, again_in_s=pause)
            except Exception as error:
                if is_passing(error):
                    raise
                log.exception("verdicts left as they were", pump_id=pump_id, again_in_s=self._later(pump_id))
            else:
                self._put_off.pop(pump_id, None)
        else:
            self._started = True
        seconds = round(time.perf_counter() - began, 1)
        log.info("made again", pumps=len(due), records=records, seconds=seconds, unfinished=stopped.is_set())
        return records

    def _later(self, pump_id: int) -> float:
        """Put a pump off that has failed; gives for how long [s]."""
        pause = min(2.0 * self._put_off.get(pump_id, (0.0, 0.5 * _FIRST_PAUSE_S))[1], _LONGEST_PAUSE_S)
        self._put_off[pump_id] = (time.monotonic() + pause, pause)
        return pause

    def _renew(self, pump_id: int, stopped: Event) -> int:
        with self._database.reading() as session:
            query = select(Pump.made_with, Pump.made_by).where(Pump.id == pump_id)
            made = session.execute(query).first()
        if made is None or made.made_with == made_with():
            return 0  # another process, or an upload, was quicker
        records = reduced_again(self._database, self._archive, pump_id, stopped)
        if not stopped.is_set():
            is_left = made.made_with is None and made.made_by == release_number()
            reprocessed(self._database, self._archive, pump_id, REPROCESSED if is_left else CAUSE)
        return records
