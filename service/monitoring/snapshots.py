"""Snapshots of the fold in the database: the newest that still holds, and which are kept for the next time."""

from collections.abc import Mapping, Sequence

import structlog
from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from detectors.judgement.snapshot import fold_from
from service.history.known import Known
from service.monitoring.fold import Start, Step
from service.storage.tables import FoldSnapshot

_NEWEST = 2
_STEPS = (16, 128)
"""Snapshots behind the newest records, and at the last multiples of so many: a late upload of last week costs at most 16
records, one of last year 128 (our choice)."""
log = structlog.get_logger("casedrain")


def snapshot_places(n: int) -> set[int]:
    """Numbers of records behind which a history of ``n`` records keeps a snapshot.

    The two newest, so that a correction of the last record is cheap, and the last two multiples of each step: a record
    that comes late by up to 16 or 128 records finds one at most 32 or 256 records back. What is kept at n was kept ever
    since the history passed it, so that appending a record takes one snapshot.
    """
    found = {n - back for back in range(_NEWEST)}
    for step in _STEPS:
        last = n // step * step
        found |= {last, last - step}
    return {place for place in found if place > 0}


def start_of(session: Session, pump_id: int, known: Known, links: Sequence[str], most: int) -> Start | None:
    """The newest snapshot within a history's first ``most`` records that still holds; None where there is none.

    One that is damaged is passed over with a line in the log.
    """
    query = select(FoldSnapshot.id, FoldSnapshot.records, FoldSnapshot.chain).where(
        FoldSnapshot.pump_id == pump_id, FoldSnapshot.records <= min(most, len(links))
    )
    for row_id, records, link in session.execute(query.order_by(FoldSnapshot.records.desc())):
        if link != links[records - 1]:
            continue
        row = session.get_one(FoldSnapshot, row_id)
        setting = known.placed[records - 1].setting
        try:
            kind, healthy = setting.pump_type(known.kind), known.healthy_in(setting)
            fold = fold_from(row.content, kind, setting.circuit_parameters, known.thresholds, healthy)
        except ValueError as error:
            log.warning("snapshot ignored", pump_id=pump_id, records=records, problem=str(error))
            continue
        return Start(records, fold, row.since)
    return None


def missing(session: Session, pump_id: int, links: Sequence[str], start: Start | None) -> set[int]:
    """Numbers of records behind which a fold from ``start`` on should leave a snapshot.

    What no longer holds, or is not wanted any more, is removed.
    """
    after = start.records if start else 0
    places = snapshot_places(len(links))
    query = select(FoldSnapshot.id, FoldSnapshot.records, FoldSnapshot.chain).where(FoldSnapshot.pump_id == pump_id)
    # one before the start that holds is good; behind it a fold makes its own, also in place of a damaged one
    held = [row for row in session.execute(query) if row.records <= after and row.chain == links[row.records - 1]]
    good = {row.id for row in held if row.records in places}
    session.execute(delete(FoldSnapshot).where(FoldSnapshot.pump_id == pump_id, FoldSnapshot.id.not_in(good)))
    return {place for place in places if place > after}


def keep(session: Session, pump_id: int, links: Sequence[str], steps: Mapping[int, Step]) -> None:
    """Store the snapshots that a fold has left, by number of records."""
    session.add_all(
        FoldSnapshot(
            pump_id=pump_id,
            records=records,
            chain=links[records - 1],
            since=step.assessment.verdict.since,
            content=step.snapshot,
        )
        for records, step in steps.items()
        if step.snapshot is not None
    )
