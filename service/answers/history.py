"""Beside a pump's records: installations, maintenance, findings."""

from typing import Annotated, NotRequired

from pydantic import Field
from typing_extensions import TypedDict

from service.answers.words import Instant, shape

_Between = TypedDict(
    "_Between",
    {
        "from": Annotated[Instant, Field(description="When it was installed.")],
        "to": Annotated[Instant | None, Field(description="When it was removed; null while it is there.")],
    },
)


@shape
class PlaceInTime(_Between):
    """Where a pump sat, as entered or as its records show."""

    id: str | None
    """Id of the entry; null for what only records show."""
    aircraft: str
    """Tail or serial number of the helicopter."""
    position: str
    """Where the pump sat, for example `LH`."""
    source: str
    """`entry` or `records`."""
    recorded_at: NotRequired[Instant]
    """When it was entered; left out for what only records show."""
    author: NotRequired[str]
    """Who entered it; left out for what only records show."""


@shape
class MaintenanceEvent(TypedDict):
    """What was done to a pump or its circuit."""

    id: str
    """Id of the entry."""
    at: Instant
    """When it was done."""
    action: str
    """What was done, for example `filter_changed`."""
    fluid: str | None
    """Product after `fluid_changed`; null where nobody said."""
    channel: str | None
    """Channel of the sensor of `sensor_replaced`; null where nobody said."""
    note: str
    """Remark of who entered it."""
    recorded_at: Instant
    """When it was entered."""
    author: str
    """Who entered it."""


@shape
class Finding(TypedDict):
    """What the workshop found at teardown or inspection."""

    id: str
    """Id of the entry."""
    at: Instant
    """When it was found."""
    found: str
    """The fault, as a verdict's state names it, or `no_fault_found`."""
    measured_case_flow_lpm: float | None
    """Case flow that was measured on the bench [L/min]."""
    removed: bool
    """Whether the pump was removed for it."""
    note: str
    """Remark of who entered it."""
    recorded_at: Instant
    """When it was entered."""
    author: str
    """Who entered it."""


@shape
class RecordMark(TypedDict):
    """A stretch of a record that an engineer has marked."""

    id: str
    """Id of the mark."""
    start_s: float
    """Start from the record's own [s]."""
    end_s: float
    """End from the record's start [s]."""
    mark: str
    """`good`: a window as it stands; `bad`: no evidence."""
    reason: str
    """Why, in the words of who marked it."""
    recorded_at: Instant
    """When it was marked."""
    author: str
    """Who marked it."""
