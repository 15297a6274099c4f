"""Which pump first, and why: the fleet by urgency with reasons in plain words."""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from detectors.words.states import QUIET, row_of
from service.alarms.life_cycle import PRIORITIES
from service.alarms.reading import is_shelved
from service.answers import pumps as answers
from service.answers.verdicts import Verdict
from service.reading import queries
from service.storage.tables import Alarm, Pump
from service.thresholds.layers import thresholds_of_many


def by_state(pump: answers.Pump) -> tuple[Any, ...]:
    """Sorting key of a pump as the API shows it, by its state alone."""
    return row_of(pump["state"]).urgency, -pump["confidence"], pump["operator"], pump["serial"]


def ranked(session: Session, rows: Sequence[Pump], shown: Sequence[answers.Pump]) -> list[answers.RankedPump]:
    """Pumps as the API shows them with rank, urgency and reasons, the most urgent first.

    An open alarm's priority decides first, then whether somebody has dealt with it, then the state.
    """
    alarms = _open_alarms(session, [row.id for row in rows])
    newest = queries.last_assessments(session, [row.id for row in rows])
    thresholds = thresholds_of_many(session, rows)
    items: list[tuple[tuple[Any, ...], answers.Pump, str, list[str]]] = []
    for row, pump in zip(rows, shown, strict=True):
        alarm = alarms.get(row.id)
        verdict = newest[row.id].verdict if row.id in newest else None
        limit = thresholds[row.id].values["case_flow_limit_lpm"]
        urgency = alarm.priority if alarm is not None else "none"
        reasons = _reasons(pump, verdict, alarm, limit)
        items.append((_place(alarm, pump), pump, urgency, reasons))
    items.sort(key=lambda item: item[0])
    return [
        {"rank": i + 1, **pump, "urgency": urgency, "reasons": reasons}
        for i, (_, pump, urgency, reasons) in enumerate(items)
    ]


def _open_alarms(session: Session, pump_ids: Sequence[int]) -> dict[int, Alarm]:
    """The newest open alarm of each pump."""
    query = (
        select(Alarm)
        .where(Alarm.pump_id.in_(pump_ids), Alarm.withdrawn_at.is_(None), Alarm.closed_at.is_(None))
        .where((Alarm.condition == "active") | Alarm.acknowledged.is_(False))
        .order_by(Alarm.raised_at, Alarm.id)
    )
    return {alarm.pump_id: alarm for alarm in session.scalars(query)}


def _place(alarm: Alarm | None, pump: answers.Pump) -> tuple[Any, ...]:
    priority = PRIORITIES.index(alarm.priority) if alarm is not None else -1
    dealt_with = alarm is None or alarm.acknowledged or is_shelved(alarm, datetime.now(UTC))
    cleared = alarm is None or alarm.condition == "cleared"
    return (cleared, -priority, dealt_with, *by_state(pump))


def _reasons(pump: answers.Pump, verdict: Verdict | None, alarm: Alarm | None, limit: float) -> list[str]:
    reasons = []
    words = str(pump["state"]).replace("_", " ")
    if pump["state"] == "indeterminate":
        candidates = ", ".join(c.replace("_", " ") for c in pump["candidates"])
        reasons.append(f"something has changed, what remains possible: {candidates or 'nothing named yet'}")
    elif pump["state"] not in QUIET:
        probabilities: Mapping[str, Any] = verdict["probabilities"] if verdict else {}
        probability = probabilities.get(pump["state"], 0.0)
        reasons.append(f"{words} with a probability of {100 * probability:.0f} %")
    flow = verdict["estimates"].get("case_flow_at_reference_lpm") if verdict else None
    if flow and flow["mean"] is not None and flow["mean"] > limit:
        reasons.append(
            f"case flow at the reference condition is {flow['mean']:.2f} L/min "
            f"({flow['low']:.2f} to {flow['high']:.2f}), the limit is {limit:g}"
        )
    rule = verdict.get("case_pressure") if verdict else None
    if rule is not None and rule["beyond"]:
        reasons.append(
            f"case over reservoir pressure is {rule['over_reservoir_bar']:.2f} bar, its reference {rule['reference_bar']:.2f}, "
            f"the limit {rule['limit_bar']:g}: whatever the cause"
        )
    if alarm is not None:
        state = f"{alarm.condition}, {'acknowledged' if alarm.acknowledged else 'not acknowledged'}"
        shelf = ", on the shelf" if is_shelved(alarm, datetime.now(UTC)) else ""
        reasons.append(f"alarm of priority {alarm.priority} since {alarm.onset_at:%Y-%m-%d %H:%M} UTC: {state}{shelf}")
    if pump["state"] == "insufficient_data":
        reasons.append("the baseline is not complete: nothing can be said yet")
    return reasons or ["nothing stands out"]
