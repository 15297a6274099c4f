"""Trends of a whole fleet, by pump type, operator, position, aircraft or age, thinned without losing extremes."""

import math
from datetime import datetime
from typing import Literal

from sqlalchemy.orm import Session

from service.access.security import Principal
from service.answers.fleet import FleetTrendPoint, TrendGroup
from service.answers.words import instant
from service.reading.trend import ZERO, between, estimated, select_values, thinned
from service.storage.tables import Pump, Record, StoredAssessment

GroupBy = Literal["pump_type", "operator", "position", "aircraft", "age"]
AGE_BAND_H = 500
"""Flight hours of a pump that one group of the same age holds."""
_COLUMNS = {
    "pump_type": Pump.pump_type,
    "operator": Pump.operator,
    "position": StoredAssessment.position,
    "aircraft": StoredAssessment.aircraft,
    "age": Record.flight_hours,
}
_ROWS_AT_ONCE = 2000
"""Rows that a stream fetches at once (our choice)."""


def fleet_trend(
    session: Session,
    principal: Principal,
    metric: str,
    group_by: GroupBy,
    since: datetime | None,
    until: datetime | None,
    most: int,
) -> list[TrendGroup]:
    """Points of one metric in event order for each group, at most about ``most`` in each.

    By age a pump passes from group to group as it flies: what pumps of the same flight hours show lies together.
    """
    group = _COLUMNS[group_by]
    kept = StoredAssessment
    query = select_values(metric, group, kept.at, kept.record_id, Pump.serial, Pump.operator)
    query = query.join(Pump, Pump.id == kept.pump_id)
    if group_by == "age" and metric != ZERO:
        query = query.join(Record, Record.id == StoredAssessment.record_id)
    if principal.operator is not None:
        query = query.where(Pump.operator == principal.operator)
    query = between(query, since, until)
    found: dict[tuple[float, str], list[FleetTrendPoint]] = {}
    for of, at, record_id, serial, operator, value in session.execute(query.execution_options(yield_per=_ROWS_AT_ONCE)):
        estimate = estimated(metric, value)
        if estimate is None:
            continue
        items = found.setdefault(_age_band(of) if group_by == "age" else (0.0, of or ""), [])
        items.append(
            {
                "at": instant(at),
                "value": estimate[0],
                "low": estimate[1],
                "high": estimate[2],
                "record_id": record_id,
                "pump_serial": serial,
                "operator": operator,
            }
        )
    return [
        {
            "group": name,
            "pumps": len({(i["operator"], i["pump_serial"]) for i in items}),
            "items": thinned(items, most),
        }
        for (_, name), items in sorted(found.items())
    ]


def _age_band(flight_hours: float | None) -> tuple[float, str]:
    """Where an age stands among the groups, and its name; pumps of unknown age come last."""
    if flight_hours is None:
        return math.inf, "unknown"
    first = AGE_BAND_H * int(flight_hours // AGE_BAND_H)
    return first, f"{first} to {first + AGE_BAND_H} h"
