"""Alarms and what happened to them."""

from typing import NotRequired

from typing_extensions import TypedDict

from service.answers.words import Cause, Instant, Priority, Side, State, shape


@shape
class AlarmEvent(TypedDict):
    """Something that happened to an alarm: by its records, or by a person (then with `by`)."""

    event: str
    """What happened: `raised`, `escalated`, `cleared`, `acknowledged`, `shelved`, `closed` …"""
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
    changed_at: Instant
    """When anything of it last changed."""
    history: list[AlarmEvent]
    """Everything that happened to it, in order."""


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
