"""Snapshots of the fold: the newest that still holds, which are kept for the next time, and the newest few in memory."""

import threading
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime

import structlog
from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from detectors.judgement.assessment import Fold
from detectors.judgement.snapshot import fold_from
from service.history.known import Known
from service.monitoring.fold import Start, Step
from service.storage.tables import FoldSnapshot

_NEWEST = 2
_STEPS = (16, 128)
"""In the database snapshots lie behind the last two multiples of so many records: a late upload of last week costs at most 16
records, one of last year 128 (our choice)."""
_ALL_ALONG = 128
"""And behind every multiple of so many, so that a record at any place of a history costs what follows it (our choice)."""
_MOST_WARM = 64
"""Snapshots in memory, some 0.1 MB each."""
log = structlog.get_logger("casedrain")


@dataclass(frozen=True, slots=True)
class Kept:
    """What a fold leaves: new snapshots by number of records, and whether those in the database are to be put in order.

    ``good`` are ids of those that stay then; all others of the pump go.
    """

    taken: Mapping[int, Step] = field(default_factory=dict)
    in_order: bool = False
    good: frozenset[int] = frozenset()


class _Warm:
    """The newest snapshots of this process by their chain, which names everything that they were folded from."""

    def __init__(self) -> None:
        self._held: OrderedDict[str, tuple[datetime | None, bytes]] = OrderedDict()
        self._lock = threading.Lock()

    def get(self, link: str) -> tuple[datetime | None, bytes] | None:
        with self._lock:
            found = self._held.get(link)
            if found is not None:
                self._held.move_to_end(link)
            return found

    def keep(self, link: str, since: datetime | None, content: bytes) -> None:
        with self._lock:
            self._held[link] = (since, content)
            self._held.move_to_end(link)
            while len(self._held) > _MOST_WARM:
                self._held.popitem(last=False)

    def forget(self) -> None:
        with self._lock:
            self._held.clear()


warm = _Warm()


def snapshot_places(n: int) -> set[int]:
    """Numbers of records behind which a history of ``n`` records keeps a snapshot in the database.

    The last two multiples of each step, so that a record that comes late by up to 16 or 128 records finds one at most 32 or
    256 records back, and one all along. What is kept at n was kept ever since the history passed it, so that appending a
    record takes one snapshot at most, and mostly none.
    """
    found = set(range(_ALL_ALONG, n + 1, _ALL_ALONG))
    for step in _STEPS:
        last = n // step * step
        found |= {last, last - step}
    return {place for place in found if place > 0}


def start_of(session: Session, pump_id: int, known: Known, links: Sequence[str], most: int) -> Start | None:
    """The newest snapshot within a history's first ``most`` records that still holds; None where there is none.

    One that is damaged is passed over with a line in the log.
    """
    most = min(most, len(links))
    lasting = most // _STEPS[0] * _STEPS[0]
    for records in range(most, max(0, lasting), -1):
        found = warm.get(links[records - 1])
        held = None if found is None else _fold(known, records, found[1])
        if found is not None and held is not None:
            return Start(records, held, found[0])
    query = select(FoldSnapshot.id, FoldSnapshot.records, FoldSnapshot.chain).where(
        FoldSnapshot.pump_id == pump_id, FoldSnapshot.records <= most
    )
    for row_id, records, link in session.execute(query.order_by(FoldSnapshot.records.desc())):
        if link != links[records - 1]:
            continue
        row = session.get(FoldSnapshot, row_id)
        if row is None:  # another fold has put it away since
            continue
        try:
            held = _fold(known, records, row.content)
        except ValueError as error:
            log.warning("snapshot ignored", pump_id=pump_id, records=records, problem=str(error))
            continue
        return Start(records, held, row.since)
    return None


def _fold(known: Known, records: int, content: bytes) -> Fold:
    setting = known.placed[records - 1].setting
    kind, healthy = setting.pump_type(known.kind), known.healthy_in(setting)
    return fold_from(content, kind, setting.circuit_parameters, known.thresholds, healthy)


def wanted(start: Start | None, end: int, n: int) -> set[int]:
    """Numbers of records behind which a fold from ``start`` on to the record ``end`` of ``n`` should leave a snapshot."""
    after = start.records if start else 0
    places = snapshot_places(n) | {end - back for back in range(_NEWEST)}
    return {place for place in places if after < place <= end}


def kept_of(
    session: Session,
    pump_id: int,
    links: Sequence[str],
    start: Start | None,
    taken: Mapping[int, Step],
    *,
    appended: bool,
) -> Kept:
    """What a fold from ``start`` on has to store, its snapshots ``taken``; those of the newest records stay in memory.

    Where records were only ``appended``, whatever lies in the database still holds.
    """
    after = start.records if start else 0
    places = snapshot_places(len(links))
    lasting = {records: step for records, step in taken.items() if records in places}
    if not lasting and appended:
        return Kept(taken)
    query = select(FoldSnapshot.id, FoldSnapshot.records, FoldSnapshot.chain).where(FoldSnapshot.pump_id == pump_id)
    # one before the start that holds is good; behind it a fold makes its own, also in place of a damaged one
    rows = [row for row in session.execute(query) if row.records <= after and row.chain == links[row.records - 1]]
    return Kept(taken, in_order=True, good=frozenset(row.id for row in rows if row.records in places))


def keep(session: Session, pump_id: int, links: Sequence[str], kept: Kept) -> None:
    """Store what a fold has left, and put away what holds no longer."""
    if kept.in_order:
        session.execute(delete(FoldSnapshot).where(FoldSnapshot.pump_id == pump_id, FoldSnapshot.id.not_in(kept.good)))
    places = snapshot_places(len(links))
    for records, step in kept.taken.items():
        if step.snapshot is None:
            continue
        link, since = links[records - 1], step.assessment.verdict.since
        warm.keep(link, since, step.snapshot)
        if records in places and kept.in_order:
            row = FoldSnapshot(pump_id=pump_id, records=records, chain=link, since=since, content=step.snapshot)
            session.add(row)
