"""The fleet at a glance."""

from typing_extensions import TypedDict

from service.answers.pumps import Pump, TrendPoint
from service.answers.shares import Share
from service.answers.words import shape


@shape
class Agreement(TypedDict):
    """How often the workshop agreed."""

    count: int
    """Number of findings (a count)."""
    false_alarms: Share
    """Of the findings on a pump in alarm, those where nothing was found."""
    missed: Share
    """Of the findings of a fault, those on a pump that was not in alarm."""
    side_right: Share
    """Of the faults found on a pump whose alarm named a side, those on that side."""


@shape
class FleetSummary(TypedDict):
    """Counts, and the pumps that want attention or have gone silent."""

    pumps: int
    """Number of pumps (a count)."""
    records: int
    """Number of records that count (a count)."""
    by_state: dict[str, int]
    """Number of pumps by the state of their verdict (counts)."""
    by_side: dict[str, int]
    """Number of pumps by the side of their verdict (counts)."""
    attention_pumps: int
    """Number of pumps that want attention (a count)."""
    attention: list[Pump]
    """Pumps that want attention, the most urgent first."""
    silent_pumps: int
    """Number of pumps that have sent nothing for unusually long (a count)."""
    silent: list[Pump]
    """Pumps that have sent nothing for unusually long."""
    findings: Agreement
    """How often the workshop agreed."""


@shape
class FleetTrendPoint(TrendPoint):
    """A point of a group's trend."""

    pump_serial: str
    """Serial number of the pump."""
    operator: str
    """Operator that it belongs to."""


@shape
class TrendGroup(TypedDict):
    """Trend of one group of pumps."""

    group: str
    """What its pumps have in common."""
    pumps: int
    """Number of pumps in it (a count)."""
    items: list[FleetTrendPoint]
    """Points in event order, in the trend's `unit`."""


@shape
class FleetTrend(TypedDict):
    """A metric over the fleet, by group."""

    metric: str
    """Name of the metric."""
    unit: str
    """Unit of value, low and high."""
    group_by: str
    """What the groups are made by."""
    items: list[TrendGroup]
    """The groups."""
    next: str | None
    """Always null: there is one page."""
