"""Trends from stored assessments, thinned without losing extremes."""

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import ColumnElement, Select, case, select
from sqlalchemy.orm import Session

from detectors.words.numbers import Z_90
from detectors.words.verdict import TREND_METRICS
from service.answers.pumps import PositionTrendPoint, TrendPoint
from service.answers.words import instant
from service.errors import Fault, Invalid
from service.reading.queries import newest_records
from service.storage.tables import Pump, Record, StoredAssessment

Point = TypeVar("Point", bound=TrendPoint)
ZERO = "case_zero_bar"
"""The case sensor's offset against the reservoir on each flight: what the reduction measured, with its 90 % interval."""
METRICS: Mapping[str, str] = {**TREND_METRICS, ZERO: "bar"}
"""Every metric that has a trend, with its unit."""


def check_metric(metric: str) -> None:
    """Refuse a metric that no trend has.

    Raises
    ------
    Invalid
        naming the metrics there are.
    """
    if metric not in METRICS:
        known = ", ".join(METRICS)
        raise Invalid(f"there is no metric {metric!r}", [Fault("query.metric", f"is not one of {known}")])


def value_of(metric: str) -> ColumnElement[Any]:
    """Column that holds a metric of an assessment; that of the zero needs the record, joined."""
    return Record.reduction["zero"] if metric == ZERO else StoredAssessment.trend[metric]


def numbers_of(metric: str) -> tuple[ColumnElement[Any], ColumnElement[Any], ColumnElement[Any]]:
    """Value and 90 % interval of a metric, taken out by the database; NULL where there is none."""
    held = value_of(metric)
    if metric != ZERO:
        mean, low, high = (held[part].as_float() for part in ("mean", "low", "high"))
        return mean, low, high
    offset = case((held["measured"].as_boolean(), held["offset_bar"].as_float()), else_=None)
    half = Z_90 * held["standard_deviation_bar"].as_float()
    return offset, offset - half, offset + half


def select_values(metric: str, *columns: Any) -> Select[*tuple[Any, ...]]:
    """``columns`` of assessments and a metric's value behind them, in event order."""
    query = select(*columns, value_of(metric)).select_from(StoredAssessment)
    if metric == ZERO:
        query = query.join(Record, Record.id == StoredAssessment.record_id)
    return query.order_by(StoredAssessment.at, StoredAssessment.record_id)


def estimated(metric: str, value: Mapping[str, Any] | None) -> tuple[float, float, float] | None:
    """Value and 90 % interval of what ``value_of`` holds; None where there is none."""
    if not value:
        return None
    if metric == ZERO:
        if not value["measured"]:
            return None
        half = Z_90 * value["standard_deviation_bar"]
        return value["offset_bar"], value["offset_bar"] - half, value["offset_bar"] + half
    mean, low, high = value["mean"], value["low"], value["high"]
    return None if mean is None or low is None or high is None else (mean, low, high)


def trend_of(
    session: Session, pump: Pump, metric: str, since: datetime | None, until: datetime | None, most: int
) -> list[TrendPoint]:
    """Points of one metric in event order from ``since`` on and before ``until``, at most about ``most``."""
    kept = StoredAssessment
    query = between(select_values(metric, kept.at, kept.record_id).where(kept.pump_id == pump.id), since, until)
    items = (_point(metric, *row) for row in session.execute(query))
    return thinned([item for item in items if item is not None], most)


def between(query: Select[Any], since: datetime | None, until: datetime | None) -> Select[Any]:
    """Assessments from ``since`` on and before ``until``."""
    if since is not None:
        query = query.where(StoredAssessment.at >= since)
    return query if until is None else query.where(StoredAssessment.at < until)


def points_of(
    assessments: Iterable[StoredAssessment], metric: str, since: datetime | None, until: datetime | None
) -> list[TrendPoint]:
    """Every point of one metric of the judge from ``since`` on and before ``until``, in the order of the assessments."""
    items = (
        _point(metric, a.at, a.record_id, a.trend.get(metric))
        for a in assessments
        if (since is None or a.at >= since) and (until is None or a.at < until)
    )
    return [item for item in items if item is not None]


def _point(metric: str, at: datetime, record_id: str, value: Mapping[str, Any] | None) -> TrendPoint | None:
    found = estimated(metric, value)
    if found is None:
        return None
    return {"at": instant(at), "value": found[0], "low": found[1], "high": found[2], "record_id": record_id}


def position_trend(
    session: Session, place: tuple[str, str, str], metric: str, since: datetime | None, until: datetime | None
) -> list[PositionTrendPoint]:
    """Points of one metric of whatever pump sat at a place (operator, aircraft, position), in event order."""
    kept = StoredAssessment
    query = select_values(metric, Pump.serial, kept.at, kept.record_id).join(Pump, Pump.id == kept.pump_id)
    query = query.where(Pump.operator == place[0], kept.aircraft == place[1], kept.position == place[2])
    found: list[PositionTrendPoint] = []
    for serial, at, record_id, value in session.execute(between(query, since, until)):
        point = _point(metric, at, record_id, value)
        if point is not None:
            found.append({**point, "pump": serial})
    return found


def newest_values(session: Session, pump_ids: Sequence[int], metrics: Sequence[str]) -> dict[int, dict[str, float]]:
    """What each pump's newest record says of the metrics that it has a value of."""
    kept = StoredAssessment
    query = select(kept.pump_id, kept.trend, Record.reduction["zero"]).join(Record, Record.id == kept.record_id)
    found: dict[int, dict[str, float]] = {}
    for pump_id, trend, zero in session.execute(query.where(kept.record_id.in_(newest_records(pump_ids)))):
        values = {m: estimated(m, zero if m == ZERO else trend.get(m)) for m in metrics}
        found[pump_id] = {m: value[0] for m, value in values.items() if value is not None}
    return found


def thinned(items: Sequence[Point], most: int) -> list[Point]:
    """Every bucket's lowest and highest point, with the first and the last point of all, in order."""
    if len(items) <= most:
        return list(items)
    return [items[i] for i in kept_places(np.array([item["value"] for item in items]), most)]


def kept_places(values: NDArray[np.float64], most: int) -> list[int]:
    """Places that ``thinned`` keeps of values in event order."""
    if len(values) <= most:
        return list(range(len(values)))
    n_buckets = max(1, (most - 2) // 2)
    size = (len(values) - 2) / n_buckets
    keep = {0, len(values) - 1}
    for k in range(n_buckets):
        first, end = 1 + int(k * size), 1 + int((k + 1) * size)
        if first < end:
            keep.add(first + int(values[first:end].argmin()))
            keep.add(first + int(values[first:end].argmax()))
    return sorted(keep)
