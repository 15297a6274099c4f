"""Pumps: list, one, verdicts, trends, damage identification curve."""

from datetime import datetime
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Response
from sqlalchemy.orm import Session

from detectors.curve_svg import curve_svg
from detectors.verdict import TREND_METRICS
from service import queries
from service.context import Asker, ContextOf
from service.errors import Fault, Invalid
from service.instants import check_instants
from service.monitoring.curve import curve_of, curve_png
from service.monitoring.trend import trend_of
from service.paging import DEFAULT_ITEMS, MOST_ITEMS, page, place_of
from service.tables import Pump, StoredAssessment

router = APIRouter(prefix="/pumps", tags=["pumps"])
Operator = Annotated[str | None, Query(description="Needed only where several operators have this serial number")]


def shown(session: Session, rows: list[Pump]) -> list[dict[str, Any]]:
    """Pumps as the API shows them, with where they were last seen and how they are."""
    ids = [row.id for row in rows]
    newest, counts = queries.last_assessments(session, ids), queries.n_records(session, ids)
    return [_pump(session, row, newest.get(row.id), counts.get(row.id, 0)) for row in rows]


@router.get("", summary="List pumps")
def listed(
    context: ContextOf,
    asker: Asker,
    limit: Annotated[int, Query(ge=1, le=MOST_ITEMS)] = DEFAULT_ITEMS,
    cursor: str | None = None,
) -> dict[str, Any]:
    """Page through the pumps that this key may see, by operator and serial number."""
    query = {"list": "pumps"}
    after = place_of(query, cursor)
    with context.database.reading() as session:
        rows = list(session.scalars(queries.pumps(asker, after).limit(limit + 1)))
        documents = {row.id: d for row, d in zip(rows, shown(session, rows), strict=True)}
        return page(rows, limit, query, lambda r: [r.operator, r.serial], lambda r: documents[r.id])


@router.get("/{serial}", summary="One pump")
def one(serial: str, context: ContextOf, asker: Asker, operator: Operator = None) -> dict[str, Any]:
    """A pump, where it was last seen, how it is."""
    with context.database.reading() as session:
        return shown(session, [queries.pump(session, asker, serial, operator)])[0]


@router.get("/{serial}/verdict", summary="Verdict of one pump")
def verdict(
    serial: str, context: ContextOf, asker: Asker, operator: Operator = None, at: datetime | None = None
) -> dict[str, Any]:
    """The verdict now, or as of an event time with today's knowledge."""
    check_instants(at=at)
    with context.database.reading() as session:
        return queries.verdict(session, queries.pump(session, asker, serial, operator), at)


@router.get("/{serial}/verdicts", summary="Every change of verdict")
def verdicts(serial: str, context: ContextOf, asker: Asker, operator: Operator = None) -> dict[str, Any]:
    """The verdicts at which the state changed, oldest first."""
    with context.database.reading() as session:
        changes = queries.verdict_changes(session, queries.pump(session, asker, serial, operator))
        items = [{"at": c.at, "record_id": c.record_id, "verdict": c.verdict} for c in changes]
    return {"items": items, "next": None}


@router.get("/{serial}/trend", summary="Trend of one metric")
def trend(
    serial: str,
    context: ContextOf,
    asker: Asker,
    metric: str,
    operator: Operator = None,
    since: Annotated[datetime | None, Query(alias="from")] = None,
    until: Annotated[datetime | None, Query(alias="to")] = None,
    points: Annotated[int, Query(ge=4, le=10_000)] = 1000,
) -> dict[str, Any]:
    """Points of a metric in event order, thinned to about ``points`` without losing extremes."""
    if metric not in TREND_METRICS:
        known = ", ".join(TREND_METRICS)
        raise Invalid(f"there is no metric {metric!r}", [Fault("query.metric", f"is not one of {known}")])
    check_instants(**{"from": since, "to": until})
    with context.database.reading() as session:
        row = queries.pump(session, asker, serial, operator)
        items = trend_of(session, row, metric, since, until, points)
    return {"metric": metric, "unit": TREND_METRICS[metric], "items": items}


@router.get("/{serial}/damage-identification-curve", summary="Damage identification curve", response_model=None)
def curve(
    serial: str,
    context: ContextOf,
    asker: Asker,
    operator: Operator = None,
    at: datetime | None = None,
    speed_rpm: Annotated[float | None, Query(ge=200, le=8000)] = None,
    fluid_temperature_degc: Annotated[float | None, Query(ge=-20, le=140)] = None,
    form: Annotated[Literal["json", "svg", "png"], Query(alias="format")] = "json",
) -> dict[str, Any] | Response:
    """Reference curve, this pump's points brought to the chosen conditions, and the direction of each fault."""
    check_instants(at=at)
    with context.database.reading() as session:
        row = queries.pump(session, asker, serial, operator)
        found = curve_of(session, row, at, speed_rpm, fluid_temperature_degc)
    if form == "svg":
        return Response(curve_svg(found.curve, f"pump {serial}"), media_type="image/svg+xml")
    if form == "png":
        return Response(curve_png(found.curve, f"pump {serial}"), media_type="image/png")
    return found.document


def _pump(session: Session, row: Pump, newest: StoredAssessment | None, n_records: int) -> dict[str, Any]:
    last = queries.last_record(session, row.id) if newest is not None else None
    verdict = queries.verdict(session, row) if newest is None else newest.verdict
    return {
        "serial": row.serial,
        "operator": row.operator,
        "pump_type": row.pump_type,
        "confirmed": row.confirmed,
        "aircraft": last.aircraft if last else None,
        "position": last.position if last else None,
        "records": n_records,
        "last_record_at": last.started_at if last else None,
        "flight_hours": last.flight_hours if last else None,
        "state": verdict["state"],
        "side": verdict["side"],
        "since": verdict["since"],
        "confidence": verdict["confidence"],
        "candidates": verdict["candidates"],
        "advice": verdict["advice"],
    }
