"""Silent pumps: those that have sent nothing for longer than their habit."""

import itertools
from collections.abc import Collection, Sequence
from datetime import datetime, timedelta

import numpy as np
from sqlalchemy import case, func, or_, select
from sqlalchemy.orm import Session, aliased

from service.storage.among import among
from service.storage.tables import Installation, Pump, StoredAssessment

_SHORTEST = timedelta(days=7)
"""Nobody is called silent over a quiet week (our choice)."""
_WITHOUT_HABIT = timedelta(days=30)
"""Patience with a pump of too few records to know its habit (our choice)."""
_GAPS_FOR_A_HABIT = 5
NEWEST_RECORDS = 50
"""Gaps between records from which a habit is known, and the records that it is taken from: a season (our choice)."""
_PATIENCE = 5.0
_QUANTILE = 0.9
"""A silence is unusual from five times the gap that nine in ten stay below (our choice: a stay in the hangar is none)."""


def patience(starts: Sequence[datetime]) -> timedelta:
    """Silence that is still usual after records at ``starts``, in order.

    Five times the 90th percentile of the gaps between the newest records, and never less than a week; thirty days
    where fewer than five gaps are known.
    """
    gaps = [(b - a).total_seconds() for a, b in itertools.pairwise(starts) if b > a]
    if len(gaps) < _GAPS_FOR_A_HABIT:
        return _WITHOUT_HABIT
    return max(_SHORTEST, timedelta(seconds=_PATIENCE * float(np.quantile(gaps, _QUANTILE))))


def newest_starts(session: Session, pump_ids: Collection[int]) -> dict[int, list[datetime]]:
    """Instants of each pump's newest ``NEWEST_RECORDS`` records in order; none of pumps without a record."""
    earlier = aliased(StoredAssessment)
    oldest_counted = (
        select(earlier.at)
        .where(earlier.pump_id == Pump.id)
        .order_by(earlier.at.desc())
        .limit(1)
        .offset(NEWEST_RECORDS - 1)
        .correlate(Pump)
        .scalar_subquery()
    )
    # materialized: worked out once for each pump, not for each of its records
    habit = select(Pump.id, oldest_counted.label("since")).where(among(Pump.id, pump_ids))
    habits = habit.cte("habits").prefix_with("MATERIALIZED")
    # a shorter history counts whole
    counts = (StoredAssessment.at >= habits.c.since) | habits.c.since.is_(None)
    query = select(StoredAssessment.pump_id, StoredAssessment.at)
    query = query.join(habits, (habits.c.id == StoredAssessment.pump_id) & counts).order_by(StoredAssessment.at)
    starts: dict[int, list[datetime]] = {}
    for pump_id, at in session.execute(query):
        starts.setdefault(pump_id, []).append(at)
    return starts


def removed(session: Session, pump_ids: Collection[int], now: datetime) -> set[int]:
    """Pumps with entered installations of which none lasts; one that an entry says was removed is not expected to speak."""
    if not pump_ids:
        return set()
    lasts = or_(Installation.removed_at.is_(None), Installation.removed_at > now)
    entered = select(Installation.pump_id).where(
        among(Installation.pump_id, pump_ids), Installation.withdrawn_at.is_(None), Installation.installed_at <= now
    )
    gone = entered.group_by(Installation.pump_id).having(func.sum(case((lasts, 1), else_=0)) == 0)
    return set(session.scalars(gone))
