"""Trends from stored assessments, thinned without losing extremes."""

from collections.abc import Iterable, Sequence
from datetime import datetime
from typing import TypeVar

from sqlalchemy.orm import Session

from detectors.words.verdict import TREND_METRICS
from service.answers.pumps import TrendPoint
from service.answers.words import instant
from service.errors import Fault, Invalid
from service.reading import queries
from service.storage.tables import Pump, StoredAssessment

Point = TypeVar("Point", bound=TrendPoint)


def check_metric(metric: str) -> None:
    """Refuse a metric that no trend has.

    Raises
    ------
    Invalid
        naming the metrics there are.
    """
    if metric not in TREND_METRICS:
        known = ", ".join(TREND_METRICS)
        raise Invalid(f"there is no metric {metric!r}", [Fault("query.metric", f"is not one of {known}")])


def trend_of(
    session: Session, pump: Pump, metric: str, since: datetime | None, until: datetime | None, most: int
) -> list[TrendPoint]:
    """Points of one metric in event order, at most about ``most``."""
    return thinned(points_of(session.scalars(queries.assessments(pump.id)), metric, since, until), most)


def points_of(
    assessments: Iterable[StoredAssessment], metric: str, since: datetime | None, until: datetime | None
) -> list[TrendPoint]:
    """Every point of one metric from ``since`` on and before ``until``, in the order of the assessments."""
    items: list[TrendPoint] = []
    for assessment in assessments:
        value = assessment.trend.get(metric)
        if value is None or value["mean"] is None or value["low"] is None or value["high"] is None:
            continue
        if (since is not None and assessment.at < since) or (until is not None and assessment.at >= until):
            continue
        items.append(
            {
                "at": instant(assessment.at),
                "value": value["mean"],
                "low": value["low"],
                "high": value["high"],
                "record_id": assessment.record_id,
            }
        )
    return items


def thinned(items: Sequence[Point], most: int) -> list[Point]:
    """Every bucket's lowest and highest point, with the first and the last point of all, in order."""
    if len(items) <= most:
        return list(items)
    n_buckets = max(1, (most - 2) // 2)
    size = (len(items) - 2) / n_buckets
    keep = {0, len(items) - 1}
    for k in range(n_buckets):
        places = range(1 + int(k * size), 1 + int((k + 1) * size))
        if places:
            keep.add(min(places, key=lambda i: items[i]["value"]))
            keep.add(max(places, key=lambda i: items[i]["value"]))
    return [items[i] for i in sorted(keep)]
