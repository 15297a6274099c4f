"""Alarms and what happened to them."""

from typing import NotRequired

from typing_extensions import TypedDict

from service.answers.shares import Share
from service.answers.words import Cause, Instant, Priority, Side, State, shape


@shape
class AlarmEvent(TypedDict):
    """Something that happened to an alarm: by its records, or by a person (then with `by`)."""

    event: str
    """What happened: `raised`, `escalated`, `cleared`, `acknowledged`, `shelved`, `closed`, `commented`, `planned` …"""
    at: Instant | None
    """When: of records in event time, of persons when they did it."""
    reason: str | None
    """Why."""
    record_id: NotRequired[str]
    """Record that showed it."""
    state: NotRequired[State]
    """State of the verdict then."""
    priority: NotRequired[Priority]
    """Priority from then on."""
    by: NotRequired[str]
    """Who did it."""
    until: NotRequired[Instant | None]
    """End of the shelf."""
    effective: NotRequired[bool]
    """False where the alarm had become more urgent than what the person had seen."""
    assignee: NotRequired[str | None]
    """Of `planned`: who sees to it from then on."""
    due_at: NotRequired[Instant | None]
    """Of `planned`: until when."""
    work_order: NotRequired[str | None]
    """Of `planned`: number of the work order in another system."""


@shape
class Alarm(TypedDict):
    """An alarm of one pump with its history."""

    id: str
    """Id of the alarm."""
    pump_serial: str
    """Serial number of the pump."""
    pump_type: str
    """Id of its pump type."""
    operator: str
    """Operator that it belongs to."""
    state: str
    """`active_unacknowledged`, `active_acknowledged`, `cleared_unacknowledged`, `cleared_acknowledged`, `closed` or
    `withdrawn` (ISA-18.2)."""
    condition: str
    """`active` or `cleared`."""
    acknowledged: bool
    """Whether somebody has seen it."""
    shelved: bool
    """Whether it is put aside now."""
    shelved_until: Instant | None
    """End of the shelf."""
    priority: Priority
    """How urgent it is."""
    verdict_state: State
    """State of the verdict that it stands for."""
    side: Side
    """Where to look."""
    candidates: list[Cause]
    """What remains possible where that state is `indeterminate`."""
    beyond_limit: bool
    """Whether the case flow is beyond its limit."""
    case_pressure_beyond: bool
    """Whether case over reservoir pressure is at twice its own reference or beyond its limit, whatever the cause."""
    onset_at: Instant
    """Event time of the first record that showed it."""
    raised_at: Instant
    """Event time at which it had lasted long enough."""
    record_id: str
    """Record at which it was raised."""
    cleared_at: Instant | None
    """Event time at which it was gone for long enough."""
    closed_at: Instant | None
    """When somebody closed it."""
    withdrawn_at: Instant | None
    """When the records no longer supported it."""
    cause: str | None
    """Why it was withdrawn."""
    assignee: str | None
    """Who sees to it; null where nobody was named."""
    due_at: Instant | None
    """Until when it shall be seen to."""
    overdue: bool
    """Whether that is past while the alarm still wants attention or an end."""
    work_order: str | None
    """Number of its work order in another system."""
    comments: int
    """Number of comments in its history (a count)."""
    changed_at: Instant
    """When anything of it last changed."""
    history: list[AlarmEvent]
    """Everything that happened to it, in order."""


@shape
class AlarmHandled(TypedDict):
    """What became of one alarm of many."""

    id: str
    """Id of the alarm."""
    done: bool
    """Whether it was done."""
    alarm: Alarm | None
    """The alarm as it is now; null where nothing was done."""
    problem: str | None
    """Why nothing was done."""


@shape
class AlarmsHandled(TypedDict):
    """What became of many alarms about which the same was to be done."""

    done: int
    """Number of alarms about which it was done (a count)."""
    items: list[AlarmHandled]
    """Each alarm, in the order that was given."""


@shape
class AlarmFigures(TypedDict):
    """How often alarms came, how long they lasted, and how many of them were a nuisance."""

    raised: int
    """Number of alarms raised (a count), without the withdrawn."""
    open: int
    """Number of them that want attention or an end now (a count)."""
    cleared: int
    """Number of them whose condition has ended (a count)."""
    withdrawn: int
    """Number of alarms that the records no longer support (a count); in no other figure."""
    escalations: int
    """Number of times that one became more urgent (a count)."""
    reopened: int
    """Number of times that one asked again after somebody had dealt with it (a count)."""
    median_days: float | None
    """Median duration from onset to clearance, in days of event time [d]; null without any that cleared."""
    longest_days: float | None
    """Longest duration from onset to clearance, in days of event time [d]; null without any that cleared."""
    median_hours_to_acknowledge: float | None
    """Median time from when the alarm was known to its first acknowledgement [h]; null without any acknowledged."""
    nuisance: Share
    """Of the alarms that are decided, those that ended without anything having been done or found, or that a finding
    refuted. Decided: cleared, or refuted by a finding."""


@shape
class KindFigures(AlarmFigures):
    """Figures of one kind of alarm."""

    verdict_state: State
    """State of the verdict that they stand for."""


@shape
class PumpFigures(AlarmFigures):
    """Figures of one pump."""

    pump_serial: str
    """Serial number of the pump."""
    operator: str
    """Operator that it belongs to."""


@shape
class AlarmStatistics(TypedDict):
    """Alarms raised within a time, counted."""

    all: AlarmFigures
    """Of all of them."""
    by_kind: list[KindFigures]
    """By the state of the verdict, the most frequent first."""
    by_pump: list[PumpFigures]
    """By pump, the most frequent first; those with the most alarms where there are more than `limit`."""
    pumps: int
    """Number of pumps that had any (a count)."""


@shape
class AlarmOutline(TypedDict):
    """An alarm as a comparison shows it."""

    onset_at: Instant
    """Event time of the first record that showed it."""
    raised_at: Instant
    """Event time at which it had lasted long enough."""
    cleared_at: Instant | None
    """Event time at which it was gone for long enough."""
    verdict_state: State
    """State of the verdict that it stands for."""
    priority: Priority
    """How urgent it is."""


@shape
class AlarmChanges(TypedDict):
    """Alarms that only one side of a comparison has."""

    gained: list[AlarmOutline]
    """Those that there were none of before."""
    lost: list[AlarmOutline]
    """Those that there are none of afterwards."""
