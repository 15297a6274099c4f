"""What a pump's page shows of its whole life, as columns: read once, continued by what came, kept in this process.

A verdict's link in the chain names everything that it and those before it were folded from (``service.monitoring.chain``).
Where the link of the last record that was read still stands, all before it stands too: only what follows is read.
"""

import math
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Select, and_, or_, select
from sqlalchemy.orm import Session

from service.answers.pumps import TrendPoint
from service.answers.words import instant
from service.reading.by_link import Key, keys_of
from service.reading.queries import Listed, TrendOfRecord
from service.reading.trend import ZERO, estimated
from service.storage.tables import Pump, Record, StoredAssessment

SHOWN = (
    "case_flow_at_reference_lpm",
    "pump_leakage_change_lpm",
    "case_residual_bar",
    "discharge_residual_bar",
    "system_leakage_change_lpm",
    "drain_resistance_change_percent",
    ZERO,
)
"""Metrics that a pump's page shows, in its order."""
_MOST_RECORDS = 200_000
"""Records that a process keeps (our choice: some 300 bytes each)."""
Numbers = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PumpHistory:
    """A pump's records in event order: ``at`` [s] since 1970, ``flight_hours`` [h] NaN where nobody said.

    ``numbers`` has for each metric of ``SHOWN`` a row per record: value and 90 % interval, NaN where there is none.
    ``chain`` is the link of the last record, None where it has none.
    """

    at: Numbers
    flight_hours: Numbers
    numbers: Mapping[str, Numbers]
    record_id: Sequence[str]
    aircraft: Sequence[str]
    position: Sequence[str]
    state: Sequence[str]
    chain: str | None

    def __len__(self) -> int:
        return len(self.record_id)

    def instant(self, i: int) -> datetime:
        """Event time of a record."""
        return datetime.fromtimestamp(float(self.at[i]), tz=UTC)

    def between(self, since: datetime | None, until: datetime | None) -> "PumpHistory":
        """Its records from ``since`` on and before ``until``."""
        first = 0 if since is None else int(np.searchsorted(self.at, since.timestamp()))
        end = len(self) if until is None else int(np.searchsorted(self.at, until.timestamp()))
        return self if (first, end) == (0, len(self)) else self.taken(range(first, max(first, end)))

    def taken(self, places: Sequence[int] | NDArray[np.intp]) -> "PumpHistory":
        """Its records at some places, in their order."""
        found = np.asarray(places, dtype=np.intp)
        return PumpHistory(
            self.at[found],
            self.flight_hours[found],
            {metric: values[found] for metric, values in self.numbers.items()},
            [self.record_id[i] for i in found],
            [self.aircraft[i] for i in found],
            [self.position[i] for i in found],
            [self.state[i] for i in found],
            None,
        )

    def with_value(self, metric: str) -> NDArray[np.intp]:
        """Places of the records that have a value of a metric."""
        return np.flatnonzero(~np.isnan(self.numbers[metric][:, 0]))

    def point(self, metric: str, i: int) -> TrendPoint:
        """A record's point of a metric that it has a value of."""
        value, low, high = self.numbers[metric][i].tolist()
        return {
            "at": instant(self.instant(i)),
            "value": value,
            "low": low,
            "high": high,
            "record_id": self.record_id[i],
        }

    def trend(self, metric: str) -> list[TrendOfRecord]:
        """Every record with its point of one metric."""
        rows = zip(self.at.tolist(), self.flight_hours.tolist(), self.numbers[metric].tolist(), strict=True)
        return [
            TrendOfRecord(
                at=datetime.fromtimestamp(at, tz=UTC),
                aircraft=self.aircraft[i],
                position=self.position[i],
                flight_hours=None if math.isnan(hours) else hours,
                state=self.state[i],
                trend={} if math.isnan(value) else {metric: {"mean": value, "low": low, "high": high}},
            )
            for i, (at, hours, (value, low, high)) in enumerate(rows)
        ]

    def followed_by(self, more: "PumpHistory") -> "PumpHistory":
        """It and what came after it."""
        return PumpHistory(
            np.concatenate([self.at, more.at]),
            np.concatenate([self.flight_hours, more.flight_hours]),
            {metric: np.concatenate([values, more.numbers[metric]]) for metric, values in self.numbers.items()},
            [*self.record_id, *more.record_id],
            [*self.aircraft, *more.aircraft],
            [*self.position, *more.position],
            [*self.state, *more.state],
            more.chain if len(more) else self.chain,
        )


_kept: OrderedDict[tuple[str, int], tuple[Key, PumpHistory]] = OrderedDict()
_lock = Lock()


def history_of(session: Session, pump: Pump | Listed) -> PumpHistory:
    """Everything that is stored of a pump's life, in columns."""
    key = keys_of(session, [pump]).get(pump.id)
    if key is None:
        return _read(session, _query(pump.id))
    place = (key[0], pump.id)
    with _lock:
        then, held = _kept.get(place, (None, None))
        if held is not None:
            _kept.move_to_end(place)
    if held is not None and then == key:
        return held
    found = _continued(session, pump.id, held) if held is not None else None
    found = found or _read(session, _query(pump.id))
    with _lock:
        _kept[place] = key, found
        _kept.move_to_end(place)
        n_records = sum(len(history) for _, history in _kept.values())
        while n_records > _MOST_RECORDS and len(_kept) > 1:
            n_records -= len(_kept.popitem(last=False)[1][1])
    return found


@dataclass(frozen=True, slots=True)
class Change:
    """A record at which the state changed: when, to what, and what was advised then."""

    at: datetime
    state: str
    advice: str


def changes_of(session: Session, pump: Pump | Listed) -> list[Change]:
    """Changes of a pump's verdict, the newest first."""
    history = history_of(session, pump)
    places = [i for i, state in enumerate(history.state) if i == 0 or history.state[i - 1] != state]
    ids = [history.record_id[i] for i in places]
    row = StoredAssessment
    said = select(row.record_id, row.verdict["advice"].as_string()).where(row.record_id.in_(ids))
    advice: dict[str, str] = {found[0]: found[1] for found in session.execute(said)}
    return [
        Change(history.instant(i), history.state[i], advice.get(history.record_id[i], "")) for i in reversed(places)
    ]


def _continued(session: Session, pump_id: int, held: PumpHistory) -> PumpHistory | None:
    """What is held with what came after it; None where its last record is not what it was."""
    if not len(held) or held.chain is None:
        return None
    row, last = StoredAssessment, held.record_id[-1]
    found = session.execute(select(row.at, row.chain).where(row.record_id == last, row.pump_id == pump_id)).first()
    if found is None or found[1] != held.chain:
        return None
    later = or_(row.at > found[0], and_(row.at == found[0], row.record_id > last))
    return held.followed_by(_read(session, _query(pump_id).where(later)))


def _query(pump_id: int) -> Select[*tuple[Any, ...]]:
    row = StoredAssessment
    columns = (row.at, Record.flight_hours, row.record_id, row.aircraft, row.position, row.state, row.chain)
    query = select(*columns, row.trend, Record.reduction["zero"]).join(Record, Record.id == row.record_id)
    return query.where(row.pump_id == pump_id).order_by(row.at, row.record_id)


def _read(session: Session, query: Select[*tuple[Any, ...]]) -> PumpHistory:
    rows = session.execute(query).all()
    words: dict[str, str] = {}  # a life has few aircraft and states: one string of each
    numbers = {metric: np.full((len(rows), 3), np.nan) for metric in SHOWN}
    for i, row in enumerate(rows):
        trend, zero = row[7], row[8]
        for metric, values in numbers.items():
            value = estimated(metric, zero if metric == ZERO else trend.get(metric))
            if value is not None:
                values[i] = value
    aircraft, position, state = ([words.setdefault(row[k], row[k]) for row in rows] for k in (3, 4, 5))
    return PumpHistory(
        np.array([row[0].timestamp() for row in rows]),
        np.array([np.nan if row[1] is None else row[1] for row in rows], float),
        numbers,
        [row[2] for row in rows],
        aircraft,
        position,
        state,
        rows[-1][6] if rows else None,
    )
