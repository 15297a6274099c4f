"""Pumps: list, one, verdicts, trends, damage identification curve."""

from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Annotated, Literal, cast

from fastapi import APIRouter, Depends, Query, Response
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from detectors.curve.picture import curve_svg
from service.access import audit
from service.access.security import Principal
from service.answers import pumps as answers
from service.answers import verdicts as answered
from service.answers.registry import LookAlike
from service.answers.verdicts import Verdict, VerdictChange
from service.answers.words import Page, instant
from service.errors import Conflict
from service.history.neighbours import look_alikes
from service.monitoring.behind import fold_behind
from service.monitoring.refold import Cause, verdict_known_at
from service.monitoring.succession import taken_over
from service.reading import queries
from service.reading.curve import curve_of
from service.reading.fleet import pump_documents, pumps_standing, silent_pumps
from service.reading.forecast import forecast_of, with_crossing
from service.reading.ranking import ranked
from service.reading.raster import png_of
from service.reading.trend import METRICS, check_metric, trend_of
from service.registry import pumps as registry
from service.registry.fields import Instant
from service.registry.installations import current_installation
from service.registry.locks import locked_pump, locked_pumps
from service.reports.state_picture import state_svg
from service.storage.tables import Pump, VerdictRevision
from service.web.addresses import location
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf
from service.web.paging import DEFAULT_ITEMS, MOST_ITEMS, page, place_of

router = APIRouter(prefix="/pumps", tags=["pumps"], route_class=AnswerRoute)
Operator = Annotated[str | None, Query(description="Needed only where several operators have this serial number")]
StateName = Literal[
    "insufficient_data",
    "healthy",
    "pump_degradation",
    "compensator_fault",
    "system_leakage",
    "drain_restriction",
    "sensor_fault",
    "indeterminate",
]
SideName = Literal["pump", "system", "sensor", "none", "unknown"]
PriorityName = Literal["none", "low", "medium", "high", "critical"]


@dataclass(frozen=True, slots=True)
class Filters:
    """What the list is narrowed to, in the words of its query."""

    state: Annotated[StateName | None, Query(description="State of the verdict now")] = None
    side: SideName | None = None
    aircraft: Annotated[str | None, Query(description="Where its latest record comes from")] = None
    type: Annotated[str | None, Query(description="Id of the pump type")] = None
    priority: Annotated[PriorityName | None, Query(description="Of its open alarm; `none` without one")] = None
    silent: Annotated[bool | None, Query(description="Whether records stay out for unusually long")] = None

    def wanted(self, session: Session, asker: Principal) -> queries.WantedPumps:
        """The same as the reading takes it; who is silent is looked up only where it is asked for."""
        silent: frozenset[int] = frozenset()
        if self.silent is not None:
            silent = silent_pumps(session, queries.listed(session, asker))
        return queries.WantedPumps(self.state, self.side, self.aircraft, self.type, self.priority, self.silent, silent)


Narrowed = Annotated[Filters, Depends()]
ALL = Filters()


@router.get("", summary="List pumps")
def listed(
    context: ContextOf,
    asker: Asker,
    filters: Narrowed = ALL,
    limit: Annotated[int, Query(ge=1, le=MOST_ITEMS)] = DEFAULT_ITEMS,
    cursor: str | None = None,
) -> Page[answers.Pump]:
    """Page through the pumps that this key may see, by operator and serial number."""
    query = {"list": "pumps", **{name: value for name, value in asdict(filters).items() if value is not None}}
    after = place_of(query, cursor)
    with context.database.reading() as session:
        wanted = queries.pumps(asker, after, filters.wanted(session, asker))
        rows = list(session.scalars(wanted.limit(limit + 1)))
        documents = {row.id: d for row, d in zip(rows, pump_documents(session, rows), strict=True)}
        return page(rows, limit, query, lambda r: [r.operator, r.serial], lambda r: documents[r.id])


@router.post("", status_code=201, summary="Register a pump")
def create(body: registry.NewPump, response: Response, context: ContextOf, asker: Asker) -> answers.PumpMade:
    """Register a pump before its first record; the answer names others that it is easily taken for."""
    asker.require("engineer")
    operator = asker.operator_of(body.operator)
    try:
        with context.database.writing() as session:
            row = registry.create(session, operator, body, asker.owner)
            details = body.model_dump(mode="json", exclude_unset=True)
            audit.note(session, asker, "pump.register", f"pump/{row.serial}", row.operator, details)
            response.headers["Location"] = location("pumps", row.serial)
            alike = look_alikes(session, row)
            named: list[LookAlike] = [{"name": p.serial, "since": instant(p.created_at)} for p in alike]
            made = cast("answers.PumpMade", pump_documents(session, [row])[0])
            if named:
                made["looks_like"] = named
            cause = Cause("pump_registered", body.serial)
            fold_behind(session, locked_pumps(session, [p.id for p in alike]), context.archive, cause)
    except IntegrityError:
        raise Conflict(f"pump {body.serial} was registered at the same moment") from None
    return made


@router.get("/{serial}", summary="One pump")
def one(serial: str, context: ContextOf, asker: Asker, operator: Operator = None) -> answers.PumpWithPlace:
    """A pump, where it sits, whether it has gone silent, how it is."""
    with context.database.reading() as session:
        row = queries.pump(session, asker, serial, operator)
        return {
            **pump_documents(session, [row])[0],
            "installation": current_installation(session, row, datetime.now(UTC)),
        }


@router.patch("/{serial}", summary="Confirm or change a pump")
def change(
    serial: str, body: registry.PumpChange, context: ContextOf, asker: Asker, operator: Operator = None
) -> answers.Pump:
    """Confirm a pump that a record brought along, or give it another type, which folds it anew."""
    asker.require("engineer")
    with context.database.writing() as session:
        row = locked_pump(session, asker, serial, operator)
        registry.change(session, row, body, asker.owner, context.archive)
        details = body.model_dump(mode="json", exclude_unset=True)
        audit.note(session, asker, "pump.change", f"pump/{row.serial}", row.operator, details)
    with context.database.reading() as session:
        return pump_documents(session, [session.get_one(Pump, row.id)])[0]


@router.get("/{serial}/verdict", summary="Verdict of one pump")
def verdict(
    serial: str,
    context: ContextOf,
    asker: Asker,
    operator: Operator = None,
    at: Annotated[Instant | None, Query(description="Event time; default: the latest record")] = None,
    known_at: Annotated[Instant | None, Query(description="Only what was known then; default: now")] = None,
) -> Verdict:
    """The verdict now, as of an event time, or as it stood with what was known at an instant."""
    with context.database.reading() as session:
        row = queries.pump(session, asker, serial, operator)
        if known_at is not None:
            return verdict_known_at(session, row, context.archive, known_at, at)
        return with_crossing(session, row, queries.verdict(session, row, at), at)


@router.get("/{serial}/verdicts", summary="Every change of verdict")
def verdicts(serial: str, context: ContextOf, asker: Asker, operator: Operator = None) -> Page[VerdictChange]:
    """The verdicts at which the state changed, oldest first."""
    with context.database.reading() as session:
        changes = queries.verdict_changes(session, queries.pump(session, asker, serial, operator))
        items: list[VerdictChange] = [
            {"at": instant(c.at), "record_id": c.record_id, "verdict": c.verdict} for c in changes
        ]
    return {"items": items, "next": None}


@router.get("/{serial}/verdicts/revisions", summary="Past verdicts that changed, and why")
def revisions(
    serial: str,
    context: ContextOf,
    asker: Asker,
    operator: Operator = None,
    limit: Annotated[int, Query(ge=1, le=MOST_ITEMS)] = DEFAULT_ITEMS,
    cursor: str | None = None,
) -> Page[answered.VerdictRevision]:
    """Verdicts that a late, corrected or withdrawn record, an entry or a threshold changed; the newest first."""
    query = {"list": "revisions", "pump": serial, "operator": operator}
    after = place_of(query, cursor)
    with context.database.reading() as session:
        row = queries.pump(session, asker, serial, operator)
        rows = list(session.scalars(queries.revisions(row.id, after).limit(limit + 1)))
        return page(rows, limit, query, lambda r: r.id, _revision)


@router.get("/{serial}/trend", summary="Trend of one metric")
def trend(
    serial: str,
    context: ContextOf,
    asker: Asker,
    metric: str,
    operator: Operator = None,
    since: Annotated[Instant | None, Query(alias="from")] = None,
    until: Annotated[Instant | None, Query(alias="to")] = None,
    points: Annotated[int, Query(ge=4, le=10_000)] = 1000,
) -> answers.Trend:
    """Points of a metric in event order, thinned to about ``points`` without losing extremes."""
    check_metric(metric)
    with context.database.reading() as session:
        row = queries.pump(session, asker, serial, operator)
        items = trend_of(session, row, metric, since, until, points)
    return {"metric": metric, "unit": METRICS[metric], "items": items}


@router.get("/{serial}/forecast", summary="Flight hours to the limit")
def remaining(serial: str, context: ContextOf, asker: Asker, operator: Operator = None) -> answers.Forecast:
    """Flight hours until the limit of case flow at the reference condition, or why no forecast is honest."""
    with context.database.reading() as session:
        return forecast_of(session, queries.pump(session, asker, serial, operator))


@router.get(
    "/{serial}/damage-identification-curve",
    summary="Damage identification curve",
    response_model=answers.DamageIdentificationCurve,
)
def curve(
    serial: str,
    context: ContextOf,
    asker: Asker,
    operator: Operator = None,
    at: Instant | None = None,
    speed_rpm: Annotated[float | None, Query(ge=200, le=8000)] = None,
    fluid_temperature_degc: Annotated[float | None, Query(ge=-20, le=140)] = None,
    form: Annotated[Literal["json", "svg", "png"], Query(alias="format")] = "json",
) -> answers.DamageIdentificationCurve | Response:
    """Reference curve, this pump's points brought to the chosen conditions, and the direction of each fault."""
    with context.database.reading() as session:
        row = queries.pump(session, asker, serial, operator)
        others = taken_over(session, row, context.archive)
        found = curve_of(session, row, at, speed_rpm, fluid_temperature_degc, others)
    if form == "svg":
        return Response(curve_svg(found.curve, f"pump {serial}"), media_type="image/svg+xml")
    if form == "png":
        return Response(png_of(curve_svg(found.curve, f"pump {serial}")), media_type="image/png")
    return found.document


@router.get(
    "/{serial}/state.svg",
    summary="State as a small picture",
    response_class=Response,
    responses={200: {"content": {"image/svg+xml": {}}}},
)
def state_picture(serial: str, context: ContextOf, asker: Asker, operator: Operator = None) -> Response:
    """State, since when, and the priority of the open alarm as an SVG of 300 x 64, for other pages and walls."""
    with context.database.reading() as session:
        row = queries.pump(session, asker, serial, operator)
        (pump,) = ranked(session, [row], *pumps_standing(session, [row]))
    # other sites may show it where they may call at all: a picture's own request is not read by their scripts
    foreign = {"Cross-Origin-Resource-Policy": "cross-origin"} if context.settings.cors else {}
    return Response(state_svg(pump, pump["urgency"]), media_type="image/svg+xml", headers=foreign)


def _revision(row: VerdictRevision) -> answered.VerdictRevision:
    return {
        "at": instant(row.at),
        "record_id": row.record_id,
        "old_state": row.old_state,
        "new_state": row.new_state,
        "cause": row.cause,
        "cause_id": row.cause_id,
        "changed_at": instant(row.changed_at),
    }
