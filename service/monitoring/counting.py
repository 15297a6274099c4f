"""A stored record begins to count: its pump is folded without a lock, and both are stored together if nothing has changed."""

from dataclasses import dataclass
from typing import Any, cast

from sqlalchemy import CursorResult, not_, select, update
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from service.errors import Conflict, Unavailable
from service.history.archive import Archive
from service.history.arrival import known_aircraft
from service.history.dossier import ChangedError, Dossier, dossier
from service.history.knowledge import Incoming
from service.history.neighbours import copied_elsewhere, look_alikes, newly_contradicted, place_taken
from service.identity import release_number
from service.ingest.decode import DecodedRecord
from service.monitoring.flights import check_flight
from service.monitoring.folded import Cause, Folded, folded
from service.monitoring.precedence import made_with
from service.monitoring.reduction import reduced_again
from service.monitoring.refold import TRIES, claimed, kept, outside_unchanged, queue_of, refold_others
from service.monitoring.settling import Settling
from service.monitoring.surroundings import Surroundings
from service.monitoring.telling import News, news_of
from service.storage.database import Database
from service.storage.tables import ANALYSED, STORED, SUPERSEDED, Pump, Record


@dataclass(frozen=True, slots=True)
class _Planned:
    """A record with its pump's fold, and other pumps that it touches; ``made`` None where a newer release judges the pump."""

    known: Dossier
    made: Folded | None
    others: frozenset[int]
    news: News | None = None


class Counting:
    """What lets records of one database count."""

    def __init__(self, database: Database, archive: Archive, settling: Settling) -> None:
        self._database, self._archive, self._settling = database, archive, settling

    def count(self, arrived: tuple[Record, Incoming], decoded: DecodedRecord, known: Surroundings) -> bool:
        """Let a stored record count: with its pump's new verdicts, in one transaction.

        False where a newer release has judged the pump: the record stays stored and waits for one of its processes.
        """
        (row, incoming), metadata = arrived, decoded.metadata
        with queue_of(row.operator, metadata.pump_serial):
            found = known.dossier_of(metadata, row.operator)
            if found is not None:
                self._settling.touch(found.pump.id)
            if found is not None and _is_older(found.pump):
                reduced_again(self._database, self._archive, found.pump.id)
                found = None
            for last in (False,) * TRIES + (True,):
                try:
                    planned = self._counted(row, incoming, decoded, found, in_the_lock=last)
                    break
                except ChangedError:
                    found = None
            else:
                raise Unavailable("the pump changed again and again while the record was taken: send it once more")
        if planned is None:
            return True  # another process has taken it
        cause = Cause("record_received", row.id)
        if planned.made is None:
            return False
        if not planned.made.is_whole:
            self._settling.leave(planned.known.pump.id, row.operator, cause)
        refold_others(self._database, self._archive, planned.others, cause)
        return True

    def _counted(
        self, row: Record, incoming: Incoming, decoded: DecodedRecord, found: Dossier | None, *, in_the_lock: bool
    ) -> "_Planned | None":
        """Fold, then lock and store; None where the record is no longer to be taken.

        Raises
        ------
        ChangedError
            when something has changed in between that the fold rests on; nothing is stored then.
        """
        try:
            if in_the_lock:
                with self._database.writing() as session:
                    query = select(Pump.id).where(
                        Pump.operator == row.operator, Pump.serial == decoded.metadata.pump_serial
                    )
                    session.execute(query.with_for_update())
                    planned = self._planned(session, row, incoming, decoded, None)
                    if planned is not None:
                        self._kept(session, row, incoming, decoded, planned)
                return planned
            with self._database.reading() as session:
                planned = self._planned(session, row, incoming, decoded, found)
            if planned is not None:
                with self._database.writing() as session:
                    self._kept(session, row, incoming, decoded, planned)
            return planned
        except IntegrityError:
            raise Conflict(
                "the same flight, pump and segment was stored at the same moment by another upload"
            ) from None

    def _planned(
        self, session: Session, row: Record, incoming: Incoming, decoded: DecodedRecord, found: Dossier | None
    ) -> "_Planned | None":
        metadata = decoded.metadata
        known = found or dossier(session, row.operator, metadata.pump_serial, metadata.aircraft)
        if found is None:
            status = session.scalar(select(Record.status).where(Record.id == row.id))
            if known is None or status != STORED:
                return None
            check_flight(session, row.operator, known.pump, decoded, None, row.supersedes, row.id)
        if known is None or _is_newer(known.pump):
            return None if known is None else _Planned(known, None, frozenset())
        made = folded(session, known.pump, self._archive, known, incoming)
        others = set[int]()
        if any(made.found.contradicted):
            others |= newly_contradicted(session, row)
        if row.supersedes:
            others |= newly_contradicted(session, session.get_one(Record, row.supersedes))
        if len(made.links) == 1 and known.has("alike"):
            others |= {other.id for other in look_alikes(session, known.pump)}
        return _Planned(known, made, frozenset(others), news_of(session, known.pump, made))

    def _kept(
        self, session: Session, row: Record, incoming: Incoming, decoded: DecodedRecord, planned: "_Planned"
    ) -> None:
        known, made = planned.known, planned.made
        if made is None:
            waits = update(Record).where(Record.id == row.id, Record.status == STORED)
            session.execute(waits.values(waits_for=known.pump.made_by))
            return
        if planned.others:  # locked in the order of their numbers, as everywhere, so that nobody waits in a circle
            query = select(Pump.id).where(Pump.id.in_({known.pump.id, *planned.others})).order_by(Pump.id)
            session.execute(query.with_for_update())
        if not claimed(session, known, made, is_told=planned.news is None):
            raise ChangedError
        if not (self._database.is_sqlite and known.has("aircraft")):
            known_aircraft(session, row.operator, decoded.metadata.aircraft)
        if row.supersedes:
            older = update(Record).where(Record.id == row.supersedes)
            session.execute(older.values(status=SUPERSEDED, ended_at=row.received_at))
        unchanged = [
            said if held else not_(said)
            for said, held in zip((copied_elsewhere(None), place_taken(None)), made.found.contradicted, strict=True)
        ]
        counts = update(Record).where(
            Record.id == row.id, Record.status == STORED, *unchanged, *outside_unchanged(known)
        )
        taken = session.execute(
            counts.values(status=ANALYSED, waits_for=None).execution_options(synchronize_session=False)
        )
        if cast("CursorResult[Any]", taken).rowcount != 1:
            raise ChangedError
        kept(session, known.pump, made, self._archive, Cause("record_received", row.id), planned.news)
        if planned.others:  # whoever dies before they are folded leaves that to the sweep
            marks = {"made_with": None, "revision": Pump.revision + 1}
            session.execute(update(Pump).where(Pump.id.in_(planned.others)).values(marks))


def _is_older(pump: Pump) -> bool:
    """True where other code has made what is stored of a pump, rather than this one that is not through with it."""
    through = pump.made_with == made_with() or (pump.made_with is None and pump.made_by == release_number())
    return not through and not _is_newer(pump)


def _is_newer(pump: Pump) -> bool:
    return pump.made_by is not None and pump.made_by > release_number()
