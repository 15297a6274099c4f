"""Alarms: what wants attention, and what is done about it."""

from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Annotated, Literal

from fastapi import APIRouter, Depends, Query
from pydantic import ConfigDict, Field

from service.alarms import reading
from service.alarms.handling import Wish, handle
from service.alarms.life_cycle import ACKNOWLEDGE, CLOSE, SHELVE, UNSHELVE
from service.answers.alarms import Alarm
from service.answers.words import Page
from service.bodies import Body
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf
from service.web.paging import DEFAULT_ITEMS, MOST_ITEMS, page, place_of

router = APIRouter(prefix="/alarms", tags=["alarms"], route_class=AnswerRoute)


class Remark(Body):
    """A word on what is done; it may be left out."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"reason": "the crew has been told"}]})
    reason: str | None = Field(default=None, max_length=2000)


class Reason(Body):
    """Why it is done."""

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"reason": "pump replaced on 12 May, worn slippers found"}]}
    )
    reason: str = Field(max_length=2000)


class Shelf(Body):
    """Why an alarm is put aside, and until when."""

    model_config = ConfigDict(
        json_schema_extra={"examples": [{"reason": "spare arrives on Friday", "until": "2026-05-08T12:00:00Z"}]},
    )
    reason: str = Field(max_length=2000)
    until: datetime


@dataclass(frozen=True, slots=True)
class Filters:
    """What the list is narrowed to, in the words of its query."""

    state: Annotated[reading.Filter | None, Query(description="`open`: what still wants attention or an end")] = None
    pump: Annotated[str | None, Query(description="Serial number")] = None
    operator: str | None = None
    aircraft: Annotated[str | None, Query(description="Where the pump sat when it was raised")] = None
    pump_type: str | None = None
    priority: Literal["low", "medium", "high", "critical"] | None = None
    side: Literal["pump", "system", "sensor", "none", "unknown"] | None = None
    verdict_state: Annotated[str | None, Query(description="State of the verdict that it stands for")] = None


Narrowed = Annotated[Filters, Depends()]


@router.get("", summary="List alarms, the newest first")
def listed(
    context: ContextOf,
    asker: Asker,
    filters: Narrowed,
    limit: Annotated[int, Query(ge=1, le=MOST_ITEMS)] = DEFAULT_ITEMS,
    cursor: str | None = None,
) -> Page[Alarm]:
    """Page through the alarms that this key may see."""
    given = asdict(filters)
    query = {"list": "alarms", **given}
    wanted = reading.alarms(asker, reading.Wanted(serial=given.pop("pump"), **given), place_of(query, cursor))
    now = datetime.now(UTC)
    with context.database.reading() as session:
        rows = session.execute(wanted.limit(limit + 1)).all()
        return page(
            rows,
            limit,
            query,
            lambda row: [row[0].raised_at.isoformat(), row[0].id],
            lambda row: reading.shown(row[0], row[1], row[2], now),
        )


@router.get("/{alarm_id}", summary="One alarm with its history")
def one(alarm_id: str, context: ContextOf, asker: Asker) -> Alarm:
    """An alarm and everything that happened to it."""
    with context.database.reading() as session:
        row, pump = reading.alarm(session, asker, alarm_id)
        return reading.shown(row, pump.serial, pump.pump_type)


@router.post("/{alarm_id}/acknowledge", summary="Say that it was seen")
def acknowledge(alarm_id: str, context: ContextOf, asker: Asker, body: Remark | None = None) -> Alarm:
    """Acknowledge an alarm; an escalation asks again."""
    return handle(context.database, asker, alarm_id, Wish(ACKNOWLEDGE, body.reason if body else None))


@router.post("/{alarm_id}/shelve", summary="Put it aside for a time")
def shelve(alarm_id: str, body: Shelf, context: ContextOf, asker: Asker) -> Alarm:
    """Shelve an active alarm with a reason, for no longer than `alarm_shelving_maximum_h`; an escalation ends it."""
    return handle(context.database, asker, alarm_id, Wish(SHELVE, body.reason, body.until))


@router.post("/{alarm_id}/unshelve", summary="Take it back from the shelf")
def unshelve(alarm_id: str, context: ContextOf, asker: Asker, body: Remark | None = None) -> Alarm:
    """End a shelf before its time."""
    return handle(context.database, asker, alarm_id, Wish(UNSHELVE, body.reason if body else None))


@router.post("/{alarm_id}/close", summary="Close it with a reason")
def close(alarm_id: str, body: Reason, context: ContextOf, asker: Asker) -> Alarm:
    """Close an alarm, whatever its condition; an escalation opens it again, a later fault is a new alarm."""
    return handle(context.database, asker, alarm_id, Wish(CLOSE, body.reason))
