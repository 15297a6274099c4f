"""Thresholds: what can be set, what holds and from which layer, what other values would have done."""

from typing import Annotated

from pydantic import Field
from typing_extensions import TypedDict

from service.answers.alarms import AlarmOutline
from service.answers.words import Instant, shape


@shape
class ThresholdKey(TypedDict):
    """A number that can be set."""

    key: str
    """Its name."""
    unit: str
    """Unit of default, low and high; `-` for a number without one."""
    default: float
    """Value without any layer, in `unit`."""
    low: float
    """Smallest value that is taken, in `unit`."""
    high: float
    """Largest value that is taken, in `unit`."""
    meaning: str
    """What it does."""


_Origin = TypedDict(
    "_Origin",
    {
        "from": Annotated[
            str,
            Field(description="Where it comes from: `default`, `pump-type limits`, `scope/id`."),
        ]
    },
)


@shape
class EffectiveValue(_Origin):
    """A threshold that holds."""

    value: float
    """Value, in the `unit` beside it."""
    unit: str
    """Unit."""


@shape
class Thresholds(TypedDict):
    """What holds in one layer."""

    scope: str
    """`fleet`, `pump-type`, `operator` or `pump`."""
    id: str
    """Name within the scope."""
    version: int
    """Number of this layer's own version (a count over the whole service); 0 where it has none."""
    effective_version: int
    """Number of the newest version among the layers that hold (a count over the whole service)."""
    own: dict[str, float]
    """What this layer itself sets, each in the unit that `GET /thresholds/keys` names."""
    values: dict[str, EffectiveValue]
    """Every threshold by its key."""


@shape
class ThresholdVersion(TypedDict):
    """A version of one layer."""

    version: int
    """Its number (a count over the whole service)."""
    values: dict[str, float]
    """What it sets, each in the unit that `GET /thresholds/keys` names."""
    author: str
    """Who set it."""
    reason: str
    """Why."""
    created_at: Instant
    """When."""


@shape
class FirstAlarm(TypedDict):
    """When a pump's first alarm is raised on either side."""

    now: Instant | None
    """With today's thresholds; null without an alarm."""
    with_candidate: Instant | None
    """With the candidate; null without an alarm."""
    earlier_by_days: float | None
    """How much earlier the candidate raises it [d]; negative: later."""
    earlier_by_flights: int | None
    """The same as a number of flights (a count); negative: later."""


@shape
class JudgedFindings(TypedDict):
    """How alarms on either side compare with what the workshop found."""

    false_now: int
    """Findings of no fault during an alarm with today's thresholds (a count)."""
    false_with_candidate: int
    """The same with the candidate (a count)."""
    missed_now: int
    """Findings of a fault without an alarm with today's thresholds (a count)."""
    missed_with_candidate: int
    """The same with the candidate (a count)."""


@shape
class PumpPreview(TypedDict):
    """One pump's alarms with today's thresholds beside those with a candidate."""

    pump_serial: str
    """Serial number of the pump."""
    operator: str
    """Operator that it belongs to."""
    alarms_now: int
    """Number of alarms with today's thresholds (a count)."""
    alarms_with_candidate: int
    """Number of alarms with the candidate (a count)."""
    gained: list[AlarmOutline]
    """Alarms that only the candidate raises."""
    lost: list[AlarmOutline]
    """Alarms that the candidate does not raise."""
    changed: bool
    """Whether any alarm differs."""
    first_alarm: FirstAlarm
    """The first alarm on either side."""
    findings: JudgedFindings
    """Beside what the workshop found."""


@shape
class PreviewTotals(TypedDict):
    """Alarms and findings of several pumps together."""

    alarms_now: int
    """Number of alarms with today's thresholds (a count)."""
    alarms_with_candidate: int
    """Number of alarms with the candidate (a count)."""
    gained: int
    """Number of alarms that only the candidate raises (a count)."""
    lost: int
    """Number of alarms that the candidate does not raise (a count)."""
    findings: JudgedFindings
    """Beside what the workshop found."""


@shape
class PreviewCost(TypedDict):
    """What a preview took."""

    pumps: int
    """Number of pumps that were folded (a count)."""
    records: int
    """Number of records that were folded (a count)."""
    limit: int
    """Number of records that one answer may take (a count)."""
    seconds: float
    """Time that it took [s]."""


@shape
class Preview(TypedDict):
    """What other thresholds would have done on the stored history."""

    scope: str
    """Layer of the candidate: `fleet`, `pump-type`, `operator` or `pump`."""
    id: str
    """Name within the scope."""
    totals: PreviewTotals
    """All pumps together."""
    items: list[PumpPreview]
    """Pumps whose alarms differ."""
    cost: PreviewCost
    """What it took."""
