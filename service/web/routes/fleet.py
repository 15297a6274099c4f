"""The fleet at a glance."""

from collections import Counter
from typing import Annotated

from fastapi import APIRouter, Query

from detectors.words.states import QUIET
from service.answers.fleet import FleetSummary, FleetTrend
from service.answers.pumps import RankedPump
from service.answers.words import Page
from service.reading import queries
from service.reading.agreement import judged_findings, rates
from service.reading.fleet import fleet, pumps_standing
from service.reading.fleet_trend import GroupBy, fleet_trend
from service.reading.ranking import in_order
from service.reading.trend import METRICS, check_metric
from service.registry.fields import Instant
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf
from service.web.paging import DEFAULT_ITEMS, MOST_ITEMS, cursor_after, place_of

router = APIRouter(prefix="/fleet", tags=["fleet"], route_class=AnswerRoute)


@router.get("/summary", summary="How the fleet is")
def summary(
    context: ContextOf,
    asker: Asker,
    limit: Annotated[int, Query(ge=1, le=MOST_ITEMS, description="Most pumps in each list")] = DEFAULT_ITEMS,
) -> FleetSummary:
    """Counts by state and side, pumps that want attention or have gone silent, and how often the workshop agreed.

    Both lists hold the first `limit` pumps, the most urgent first; `attention_pumps` and `silent_pumps` count all.
    """
    with context.database.reading() as session:
        pumps = fleet(session, asker)
        judged = judged_findings(session, asker)
    attention = [p for p in pumps if p["state"] not in QUIET or p["case_pressure_beyond"]]
    silent = [p for p in pumps if p["silent"]]
    return {
        "pumps": len(pumps),
        "records": sum(p["records"] for p in pumps),
        "by_state": dict(Counter(p["state"] for p in pumps)),
        "by_side": dict(Counter(p["side"] for p in pumps)),
        "attention_pumps": len(attention),
        "attention": attention[:limit],
        "silent_pumps": len(silent),
        "silent": silent[:limit],
        "findings": rates(judged),
    }


@router.get("/ranking", summary="Which pump first, and why")
def ranking(
    context: ContextOf,
    asker: Asker,
    limit: Annotated[int, Query(ge=1, le=MOST_ITEMS)] = DEFAULT_ITEMS,
    cursor: str | None = None,
) -> Page[RankedPump]:
    """Page through the pumps by urgency, each with its reasons in plain words."""
    query = {"list": "ranking"}
    place = place_of(query, cursor)
    start = place[0] if place is not None else 0
    with context.database.reading() as session:
        rows = queries.listed(session, asker)
        places = in_order(session, rows, *pumps_standing(session, rows))
    end = start + limit
    items = [place.document() for place in places[start:end]]
    return {"items": items, "next": cursor_after(query, [end]) if end < len(places) else None}


@router.get("/trend", summary="Trend of one metric over the fleet, by group")
def trend(
    context: ContextOf,
    asker: Asker,
    metric: str,
    group_by: GroupBy = "pump_type",
    since: Annotated[Instant | None, Query(alias="from")] = None,
    until: Annotated[Instant | None, Query(alias="to")] = None,
    points: Annotated[int, Query(ge=4, le=10_000, description="About so many per group")] = 500,
) -> FleetTrend:
    """Points of a metric in event order for each group, thinned without losing extremes."""
    check_metric(metric)
    with context.database.reading() as session:
        groups = fleet_trend(session, asker, metric, group_by, since, until, points)
    return {"metric": metric, "unit": METRICS[metric], "group_by": group_by, "items": groups, "next": None}
