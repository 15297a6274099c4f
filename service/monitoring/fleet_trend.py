"""Trends of a whole fleet, by pump type, operator, position or aircraft, thinned without losing extremes."""

from datetime import datetime
from typing import Any, Literal

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.monitoring.trend import thinned
from service.security import Principal
from service.tables import Pump, StoredAssessment

GroupBy = Literal["pump_type", "operator", "position", "aircraft"]
_COLUMNS = {
    "pump_type": Pump.pump_type,
    "operator": Pump.operator,
    "position": StoredAssessment.position,
    "aircraft": StoredAssessment.aircraft,
}
_ROWS_AT_ONCE = 2000


def fleet_trend(
    session: Session,
    principal: Principal,
    metric: str,
    group_by: GroupBy,
    since: datetime | None,
    until: datetime | None,
    most: int,
) -> list[dict[str, Any]]:
    """Points of one metric in event order for each group, at most about ``most`` in each."""
    group = _COLUMNS[group_by]
    query = (
        select(
            group,
            StoredAssessment.at,
            StoredAssessment.trend[metric],
            StoredAssessment.record_id,
            Pump.serial,
            Pump.operator,
        )
        .join(Pump, Pump.id == StoredAssessment.pump_id)
        .order_by(StoredAssessment.at, StoredAssessment.record_id)
    )
    if principal.operator is not None:
        query = query.where(Pump.operator == principal.operator)
    if since is not None:
        query = query.where(StoredAssessment.at >= since)
    if until is not None:
        query = query.where(StoredAssessment.at < until)
    found: dict[str, list[dict[str, Any]]] = {}
    for name, at, value, record_id, serial, operator in session.execute(
        query.execution_options(yield_per=_ROWS_AT_ONCE)
    ):
        if not value or value["mean"] is None:
            continue
        items = found.setdefault(name or "", [])
        items.append(
            {
                "at": at,
                "value": value["mean"],
                "low": value["low"],
                "high": value["high"],
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
        for name, items in sorted(found.items())
    ]
