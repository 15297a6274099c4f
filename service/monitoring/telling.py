"""Who takes over from a pump is folded anew behind its fold; until that is done the pump is not marked as through.

A process that dies in between leaves the pump unmarked, whatever else was stored of it: the sweep finds it, folds it (which
changes nothing) and tells all that sat where it sat.
"""

import threading
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import update
from sqlalchemy.orm import Session

from detectors.judgement.succession import Seat
from service.history.archive import Archive
from service.identity import release_number
from service.monitoring.folded import Cause, Folded
from service.monitoring.precedence import made_with
from service.monitoring.succession import Neighbourhood, seats_of_known, successors
from service.storage.database import Database
from service.storage.tables import Pump

Refold = Callable[[Database, Archive, Collection[int], Cause], bool]


@dataclass(frozen=True, slots=True)
class News:
    """What others are to be told of a fold.

    Attributes
    ----------
    pump_id, revision
        The pump, and its number once the fold is stored.
    changed
        Records whose verdicts were made anew, or are gone.
    before, after
        Where its records lay and lie.
    again
        Whether it is then folded again itself, because it took over from a pump that may have changed meanwhile.
    to_all
        Whether all that sat where it sat are told: what was to be told of it before may have been lost.
    is_whole
        Whether the fold left no verdicts to be made.
    """

    pump_id: int
    revision: int
    changed: frozenset[str]
    before: Sequence[Seat]
    after: Sequence[Seat]
    again: bool
    to_all: bool
    is_whole: bool


@dataclass(slots=True)
class _Pending:
    """Tellings of a pump that this process has in hand, and the newest state of the pump among them."""

    count: int = 0
    revision: int = 0
    is_whole: bool = False
    has_failed: bool = False


class _InHand:
    """What this process is telling."""

    def __init__(self) -> None:
        self._pending: dict[tuple[Any, int], _Pending] = {}
        self._lock = threading.Lock()

    def has(self, place: Any, pump_id: int) -> bool:
        with self._lock:
            return (place, pump_id) in self._pending

    def begun(self, database: Database, news: News) -> None:
        with self._lock:
            held = self._pending.setdefault((database.engine.url, news.pump_id), _Pending())
            held.count += 1
            if news.revision >= held.revision:
                held.revision, held.is_whole = news.revision, news.is_whole

    def ended(self, database: Database, news: News, *, is_told: bool) -> int | None:
        """The revision at which a pump is through, once the last telling has ended well."""
        key = database.engine.url, news.pump_id
        with self._lock:
            held = self._pending[key]
            held.count -= 1
            held.has_failed = held.has_failed or not is_told
            if held.count:
                return None
            del self._pending[key]
            return held.revision if held.is_whole and not held.has_failed else None


IN_HAND = _InHand()


def news_of(session: Session, pump: Pump, made: Folded) -> News | None:
    """What others are to be told of a pump's fold, once it is stored in place of what ``pump`` says; None for nothing."""
    changed = frozenset(made.before).union(row.record_id for row in made.assessments)
    concerns = bool(changed) and not made.alone_at
    in_hand = IN_HAND.has(session.get_bind().engine.url, pump.id)
    to_all = pump.made_with is None and not in_hand and not made.alone_at
    after = seats_of_known(pump.id, made.found.known)
    if not concerns and not in_hand and not (to_all and (made.seats or after)):
        return None
    again = concerns and not changed.isdisjoint(made.found.known.borrowed)
    told = changed if concerns else frozenset[str]()
    return News(pump.id, pump.revision + 1, told, made.seats, after, again, to_all, made.is_whole)


def told_now(database: Database, archive: Archive, news: News, refold: Refold) -> None:
    """Have those folded anew that take over from a pump, then mark it as through."""
    is_told = False
    try:
        is_told = _told(database, archive, news, refold)
    finally:
        revision = IN_HAND.ended(database, news, is_told=is_told)
    if revision is not None:
        through = update(Pump).where(
            Pump.id == news.pump_id,
            Pump.revision == revision,
            Pump.made_with.is_(None),
            Pump.made_by == release_number(),
        )
        with database.writing() as session:
            session.execute(through.values(made_with=made_with()))


def _told(database: Database, archive: Archive, news: News, refold: Refold) -> bool:
    if not news.changed and not news.to_all:
        return True
    with database.reading() as session:
        pump = session.get(Pump, news.pump_id)
        if pump is None:
            return True
        here = Neighbourhood(session, archive)
        if news.to_all:
            others = here.near(pump, {seat.place for seat in (*news.before, *news.after)})
        else:
            others = successors(here, pump, news.before, news.after, news.changed)
        cause = Cause("neighbour_changed", pump.serial)
    return refold(database, archive, others | ({news.pump_id} if news.again else set()), cause)
