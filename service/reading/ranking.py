"""Which pump first, and why: the fleet by urgency with reasons in plain words."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cache
from typing import Any, NamedTuple

from sqlalchemy import select
from sqlalchemy.orm import Session

from detectors.words.states import QUIET, row_of
from service.alarms.life_cycle import PRIORITIES
from service.answers import pumps as answers
from service.reading.queries import Listed
from service.reading.standing import Standing
from service.storage.among import among
from service.storage.tables import Alarm, Pump
from service.thresholds.layers import thresholds_of_many
from service.units import METRIC, UnitSystem


@cache
def _urgency(word: str) -> int:
    return row_of(word).urgency


def by_state(pump: answers.Pump) -> tuple[Any, ...]:
    """Sorting key of a pump as the API shows it, by its state alone."""
    return _urgency(pump["state"]), -pump["confidence"], pump["operator"], pump["serial"]


@dataclass(frozen=True, slots=True)
class Ranked:
    """A pump in its place, the most urgent has the rank 1; its reasons are put into words where they are asked for."""

    rank: int
    pump: answers.Pump
    urgency: str
    _standing: Standing | None
    _alarm: "_OpenAlarm | None"
    _limit: float

    def document(self, system: UnitSystem = METRIC) -> answers.RankedPump:
        """As the API shows it, its reasons in the reader's units."""
        reasons = _reasons(self.pump, self._standing, self._alarm, self._limit, system)
        return {"rank": self.rank, **self.pump, "urgency": self.urgency, "reasons": reasons}


def in_order(
    session: Session, rows: Sequence[Pump | Listed], shown: Sequence[answers.Pump], standing: Mapping[int, Standing]
) -> list[Ranked]:
    """Pumps as the API shows them in their places, the most urgent first.

    An open alarm's priority decides first, then whether somebody has dealt with it, then the state.
    """
    alarms = _open_alarms(session, [row.id for row in rows])
    thresholds = thresholds_of_many(session, rows)
    placed = sorted(zip(rows, shown, strict=True), key=lambda item: _place(alarms.get(item[0].id), item[1]))
    found = []
    for rank, (row, pump) in enumerate(placed, 1):
        alarm, limit = alarms.get(row.id), thresholds[row.id].values["case_flow_limit_lpm"]
        urgency = alarm.priority if alarm is not None else "none"
        found.append(Ranked(rank, pump, urgency, standing.get(row.id), alarm, limit))
    return found


def ranked(
    session: Session,
    rows: Sequence[Pump | Listed],
    shown: Sequence[answers.Pump],
    standing: Mapping[int, Standing],
    system: UnitSystem = METRIC,
) -> list[answers.RankedPump]:
    """The same as the API shows them, with urgency and reasons in plain words and the reader's units."""
    return [place.document(system) for place in in_order(session, rows, shown, standing)]


class _OpenAlarm(NamedTuple):
    """What the ranking needs of an alarm."""

    pump_id: int
    priority: str
    acknowledged: bool
    condition: str
    shelved_until: datetime | None
    onset_at: datetime

    @property
    def is_shelved(self) -> bool:
        return self.shelved_until is not None and self.shelved_until > datetime.now(UTC)


def _open_alarms(session: Session, pump_ids: Sequence[int]) -> dict[int, _OpenAlarm]:
    """The newest open alarm of each pump."""
    held = (Alarm.pump_id, Alarm.priority, Alarm.acknowledged, Alarm.condition, Alarm.shelved_until, Alarm.onset_at)
    query = (
        select(*held)
        .where(among(Alarm.pump_id, pump_ids), Alarm.withdrawn_at.is_(None), Alarm.closed_at.is_(None))
        .where((Alarm.condition == "active") | Alarm.acknowledged.is_(False))
        .order_by(Alarm.raised_at, Alarm.id)
    )
    return {row[0]: _OpenAlarm(*row) for row in session.execute(query)}


def _place(alarm: _OpenAlarm | None, pump: answers.Pump) -> tuple[Any, ...]:
    priority = PRIORITIES.index(alarm.priority) if alarm is not None else -1
    dealt_with = alarm is None or alarm.acknowledged or alarm.is_shelved
    cleared = alarm is None or alarm.condition == "cleared"
    return (cleared, -priority, dealt_with, *by_state(pump))


def _reasons(
    pump: answers.Pump, standing: Standing | None, alarm: _OpenAlarm | None, limit: float, system: UnitSystem
) -> list[str]:
    reasons = []
    words = str(pump["state"]).replace("_", " ")
    if pump["state"] == "indeterminate":
        candidates = ", ".join(c.replace("_", " ") for c in pump["candidates"])
        reasons.append(f"something has changed, what remains possible: {candidates or 'nothing named yet'}")
    elif pump["state"] not in QUIET:
        probability = standing.probability if standing else 0.0
        reasons.append(f"{words} with a probability of {100 * probability:.0f} %")
    flow = standing.case_flow if standing else None
    if flow and flow["mean"] is not None and flow["mean"] > limit:
        reasons.append(
            f"case flow at the reference condition is {system.said(flow['mean'], 'L/min', 2)} "
            f"({system.figure(flow['low'], 'L/min', 2)} to {system.figure(flow['high'], 'L/min', 2)}), "
            f"the limit is {system.plain(limit, 'L/min')}"
        )
    rule = standing.case_pressure if standing else None
    if rule is not None and rule["beyond"]:
        reasons.append(
            f"case over reservoir pressure is {system.said(rule['over_reservoir_bar'], 'bar', 2)}, "
            f"its reference {system.figure(rule['reference_bar'], 'bar', 2)}, "
            f"the limit {system.plain(rule['limit_bar'], 'bar')}: whatever the cause"
        )
    if alarm is not None:
        state = f"{alarm.condition}, {'acknowledged' if alarm.acknowledged else 'not acknowledged'}"
        shelf = ", on the shelf" if alarm.is_shelved else ""
        reasons.append(f"alarm of priority {alarm.priority} since {alarm.onset_at:%Y-%m-%d %H:%M} UTC: {state}{shelf}")
    if pump["state"] == "insufficient_data":
        reasons.append("the baseline is not complete: nothing can be said yet")
    return reasons or ["nothing stands out"]
