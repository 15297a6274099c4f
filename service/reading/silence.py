"""Silent pumps: those that have sent nothing for longer than their habit."""

import itertools
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

import numpy as np
from sqlalchemy import or_, select
from sqlalchemy.orm import Session, aliased

from service.storage.tables import Installation, Pump, StoredAssessment

_SHORTEST = timedelta(days=7)
"""Nobody is called silent over a quiet week (our choice)."""
_WITHOUT_HABIT = timedelta(days=30)
"""Patience with a pump of too few records to know its habit (our choice)."""
_GAPS_FOR_A_HABIT = 5
_NEWEST_RECORDS = 50
"""Gaps between records from which a habit is known, and the records that it is taken from: a season (our choice)."""
_PATIENCE = 5.0
_QUANTILE = 0.9
"""A silence is unusual from five times the gap that nine in ten stay below (our choice: a stay in the hangar is none)."""


@dataclass(frozen=True, slots=True)
class Silence:
    """A pump's last record, and the instant from which on its silence is unusual."""

    last_record_at: datetime
    unusual_from: datetime


def patience(starts: Sequence[datetime]) -> timedelta:
    """Silence that is still usual after records at ``starts``, in order.

    Five times the 90th percentile of the gaps between the newest records, and never less than a week; thirty days
    where fewer than five gaps are known.
    """
    gaps = [(b - a).total_seconds() for a, b in itertools.pairwise(starts) if b > a]
    if len(gaps) < _GAPS_FOR_A_HABIT:
        return _WITHOUT_HABIT
    return max(_SHORTEST, timedelta(seconds=_PATIENCE * float(np.quantile(gaps, _QUANTILE))))


def silent_pumps(session: Session, pump_ids: Collection[int], now: datetime) -> dict[int, Silence]:
    """Pumps that are silent at an instant, of those given; one that an entry says was removed is not expected to speak."""
    silences = _habits(session, pump_ids)
    gone = removed(session, pump_ids, now)
    return {i: s for i, s in silences.items() if s.unusual_from < now and i not in gone}


def unusual_from(session: Session, pump_ids: Collection[int]) -> dict[int, datetime]:
    """Instant from which on each pump's silence is unusual; none of pumps without a record."""
    return {i: s.unusual_from for i, s in _habits(session, pump_ids).items()}


def _habits(session: Session, pump_ids: Collection[int]) -> dict[int, Silence]:
    earlier = aliased(StoredAssessment)
    oldest_counted = (
        select(earlier.at)
        .where(earlier.pump_id == Pump.id)
        .order_by(earlier.at.desc())
        .limit(1)
        .offset(_NEWEST_RECORDS - 1)
        .correlate(Pump)
        .scalar_subquery()
    )
    # materialized: worked out once for each pump, not for each of its records
    habit = select(Pump.id, oldest_counted.label("since")).where(Pump.id.in_(pump_ids))
    habits = habit.cte("habits").prefix_with("MATERIALIZED")
    # a shorter history counts whole
    counts = (StoredAssessment.at >= habits.c.since) | habits.c.since.is_(None)
    query = select(StoredAssessment.pump_id, StoredAssessment.at)
    query = query.join(habits, (habits.c.id == StoredAssessment.pump_id) & counts).order_by(StoredAssessment.at)
    starts: dict[int, list[datetime]] = {}
    for pump_id, at in session.execute(query):
        starts.setdefault(pump_id, []).append(at)
    return {i: Silence(found[-1], found[-1] + patience(found)) for i, found in starts.items()}


def removed(session: Session, pump_ids: Collection[int], now: datetime) -> set[int]:
    """Pumps with entered installations of which none lasts."""
    entered = select(Installation.pump_id).where(
        Installation.pump_id.in_(pump_ids), Installation.withdrawn_at.is_(None), Installation.installed_at <= now
    )
    lasting = entered.where(or_(Installation.removed_at.is_(None), Installation.removed_at > now))
    return set(session.scalars(entered)) - set(session.scalars(lasting))
