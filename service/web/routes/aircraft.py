"""Aircraft: list, register, look up, change, and the trend of a position."""

from typing import Annotated, cast

from fastapi import APIRouter, Query, Response
from sqlalchemy.exc import IntegrityError

from service.access import audit
from service.answers.pumps import PositionTrend
from service.answers.registry import Aircraft, AircraftMade
from service.answers.words import Page
from service.errors import Conflict
from service.reading import queries
from service.reading.trend import METRICS, check_metric, position_trend, thinned
from service.registry import aircraft as registry
from service.registry.fields import Instant
from service.web.addresses import location
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf
from service.web.paging import DEFAULT_ITEMS, MOST_ITEMS, page, place_of

router = APIRouter(prefix="/aircraft", tags=["registry"], route_class=AnswerRoute)
Operator = Annotated[str | None, Query(description="Needed only where several operators have this aircraft")]


@router.get("", summary="List aircraft")
def listed(
    context: ContextOf,
    asker: Asker,
    limit: Annotated[int, Query(ge=1, le=MOST_ITEMS)] = DEFAULT_ITEMS,
    cursor: str | None = None,
) -> Page[Aircraft]:
    """Page through the aircraft that this key may see, by operator and name."""
    query = {"list": "aircraft"}
    after = place_of(query, cursor)
    with context.database.reading() as session:
        rows = list(session.scalars(registry.listed(asker, after).limit(limit + 1)))
        return page(rows, limit, query, lambda r: [r.operator, r.name], lambda r: registry.document(session, r))


@router.post("", status_code=201, summary="Register an aircraft")
def create(body: registry.NewAircraft, response: Response, context: ContextOf, asker: Asker) -> AircraftMade:
    """Register an aircraft with its fluid, circuit and sensors; the answer names others that it is easily taken for."""
    asker.require("engineer")
    operator = asker.operator_of(body.operator)
    try:
        with context.database.writing() as session:
            row = registry.create(session, operator, body, asker.owner)
            details = body.model_dump(mode="json", exclude_unset=True)
            audit.note(session, asker, "aircraft.register", f"aircraft/{row.name}", row.operator, details)
            response.headers["Location"] = location("aircraft", row.name)
            made = cast("AircraftMade", registry.document(session, row))
            if alike := registry.look_alikes(session, row):
                made["looks_like"] = alike
            return made
    except IntegrityError:
        raise Conflict(f"aircraft {body.aircraft} was registered at the same moment") from None


@router.get("/{name}", summary="One aircraft")
def one(name: str, context: ContextOf, asker: Asker, operator: Operator = None) -> Aircraft:
    """Fluid, circuit and sensors of an aircraft; ``confirmed`` is false for one that only records speak of."""
    with context.database.reading() as session:
        return registry.document(session, queries.aircraft(session, asker, name, operator))


@router.patch("/{name}", summary="Change an aircraft")
def change(
    name: str, body: registry.AircraftChange, context: ContextOf, asker: Asker, operator: Operator = None
) -> Aircraft:
    """Set what the body names; its pumps are folded anew where circuit, fluid or sensors change."""
    asker.require("engineer")
    with context.database.writing() as session:
        row = queries.aircraft(session, asker, name, operator)
        registry.change(session, row, body, asker.owner, context.archive)
        details = body.model_dump(mode="json", exclude_unset=True)
        audit.note(session, asker, "aircraft.change", f"aircraft/{row.name}", row.operator, details)
        return registry.document(session, row)


@router.get("/{name}/positions/{position}/trend", summary="Trend of one metric at a position")
def trend(
    name: str,
    position: str,
    context: ContextOf,
    asker: Asker,
    metric: str,
    operator: Operator = None,
    since: Annotated[Instant | None, Query(alias="from")] = None,
    until: Annotated[Instant | None, Query(alias="to")] = None,
    points: Annotated[int, Query(ge=4, le=10_000)] = 1000,
) -> PositionTrend:
    """Points of a metric over all pumps that sat at a position, in event order; each names its pump."""
    check_metric(metric)
    with context.database.reading() as session:
        row = queries.aircraft(session, asker, name, operator)
        items = position_trend(session, (row.operator, row.name, position), metric, since, until)
    return {"metric": metric, "unit": METRICS[metric], "items": thinned(items, points)}
