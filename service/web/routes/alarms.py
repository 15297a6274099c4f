"""Alarms: what wants attention, and what is done about it."""

from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Annotated, Literal, cast

from fastapi import APIRouter, Depends, Query
from pydantic import ConfigDict, Field

from service.alarms import reading
from service.alarms.handling import PartOfPlan, Wish, handle, handle_many
from service.alarms.life_cycle import ACKNOWLEDGE, CLOSE, COMMENT, PLAN, SHELVE, UNSHELVE
from service.answers.alarms import Alarm, AlarmHandled, AlarmsHandled, AlarmStatistics
from service.answers.words import Page
from service.bodies import Body
from service.errors import Problem
from service.reading.alarm_statistics import Period, statistics
from service.registry.fields import Instant, Name, Note, Written
from service.registry.fields import Reason as Reasoned
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
    until: Written


class Comment(Body):
    """A word about an alarm."""

    model_config = ConfigDict(json_schema_extra={"examples": [{"text": "oil analysis asked for on 4 May"}]})
    text: Reasoned


class Planned(Body):
    """Who sees to an alarm, until when, and the work order elsewhere: null takes back, what is not named stays."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"assignee": "line 2", "due_at": "2099-05-08T12:00:00Z", "work_order": "WO-4711"}]
        }
    )
    assignee: Annotated[Name | None, Field(description="Who sees to it")] = None
    due_at: Instant | None = None
    work_order: Annotated[Name | None, Field(description="Its number in another system")] = None
    reason: Note | None = None

    def wish(self) -> Wish:
        """What shall be done, with those fields only that were named."""
        return Wish(PLAN, self.reason, None, self.part_of_plan())

    def part_of_plan(self) -> PartOfPlan:
        """The fields of a plan that were named."""
        named = self.model_dump(include=self.model_fields_set & {"assignee", "due_at", "work_order"})
        return cast("PartOfPlan", named)


class Many(Planned):
    """The same for many alarms: what is done, and what that needs."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"alarms": ["0123abcd"], "action": "acknowledge", "reason": "seen at the meeting"}]
        }
    )
    alarms: list[Annotated[str, Field(max_length=100)]] = Field(min_length=1, max_length=200)
    action: Literal["acknowledge", "shelve", "unshelve", "close", "comment", "plan"]
    until: Written | None = None

    def wish(self) -> Wish:
        """What shall be done about each of them."""
        return Wish(self.action, self.reason, self.until, self.part_of_plan())


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

    assignee: Annotated[str | None, Query(description="Who sees to it")] = None
    work_order: Annotated[str | None, Query(description="Number of the work order")] = None
    overdue: Annotated[bool | None, Query(description="Its due date is past and it still wants attention")] = None


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


@router.post("/actions", summary="Do the same about many")
def act_on_many(body: Many, context: ContextOf, asker: Asker) -> AlarmsHandled:
    """Acknowledge, shelve, close, plan or comment many alarms, each for itself; what could not be done is said of each."""
    done = handle_many(context.database, asker, body.alarms, body.wish())
    items = [_handled(name, result) for name, result in zip(dict.fromkeys(body.alarms), done, strict=True)]
    return {"done": sum(item["done"] for item in items), "items": items}


def _handled(alarm_id: str, result: Alarm | Problem) -> AlarmHandled:
    if isinstance(result, Problem):
        faults = [f"{f.where} {f.problem}" for f in result.errors]
        return {"id": alarm_id, "done": False, "alarm": None, "problem": "; ".join([result.detail, *faults])}
    return {"id": alarm_id, "done": True, "alarm": result, "problem": None}


@router.get("/statistics", summary="How often, how long, and how many were a nuisance")
def counted(
    context: ContextOf,
    asker: Asker,
    operator: str | None = None,
    pump_type: str | None = None,
    aircraft: Annotated[str | None, Query(description="Where the pump sat when it was raised")] = None,
    since: Annotated[Instant | None, Query(alias="from")] = None,
    until: Annotated[Instant | None, Query(alias="to")] = None,
    limit: Annotated[int, Query(ge=1, le=MOST_ITEMS, description="Most pumps listed")] = DEFAULT_ITEMS,
) -> AlarmStatistics:
    """Count the alarms raised within a time [from, to), over all, by kind and by pump."""
    wanted = reading.Wanted(operator=operator, pump_type=pump_type, aircraft=aircraft)
    with context.database.reading() as session:
        return statistics(session, asker, wanted, Period(since, until), limit)


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


@router.patch("/{alarm_id}", summary="Plan who sees to it, until when, under which work order")
def plan(alarm_id: str, body: Planned, context: ContextOf, asker: Asker) -> Alarm:
    """Set assignee, due date and work order; a plan says nothing of the alarm's life, which goes on as before."""
    return handle(context.database, asker, alarm_id, body.wish())


@router.post("/{alarm_id}/comments", summary="Say something about it")
def comment(alarm_id: str, body: Comment, context: ContextOf, asker: Asker) -> Alarm:
    """Add a comment to the alarm's history."""
    return handle(context.database, asker, alarm_id, Wish(COMMENT, body.text))
