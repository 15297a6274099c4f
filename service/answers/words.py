"""What all answers share: instants, words of the field, pages, and how a shape is declared.

Shapes are typed dictionaries, so that an answer is checked where it is made, costs nothing to give, and is the same
object for the reader of the client. The sentence under each field is its description in the API's document.
"""

from collections.abc import Callable
from datetime import datetime
from typing import Annotated, Any, Generic, TypeVar, overload

from pydantic import ConfigDict, Field, with_config
from typing_extensions import TypedDict

from service.answers.documents import JsonObject

Shape = TypeVar("Shape", bound=type)
Item = TypeVar("Item")

SHAPES: dict[str, type] = {}
"""Every declared shape by its name, which is its name in the API's document."""


def _open(schema: JsonObject) -> None:
    # a later release may add fields: readers shall not refuse them
    schema.pop("additionalProperties", None)


_config: Callable[[Any], Any] = with_config(
    ConfigDict(use_attribute_docstrings=True, extra="forbid", json_schema_extra=_open)
)


def shape(kind: Shape) -> Shape:
    """Declare a typed dictionary as the shape of an answer.

    Raises
    ------
    ValueError
        when there is one of that name.
    """
    if kind.__name__ in SHAPES:
        raise ValueError(f"there are two shapes {kind.__name__}")
    declared: Shape = _config(kind)
    SHAPES[kind.__name__] = declared
    return declared


Instant = Annotated[str, Field(json_schema_extra={"format": "date-time"})]
"""RFC 3339 in UTC, ending in ``Z``."""

STATES = (
    "insufficient_data",
    "healthy",
    "pump_degradation",
    "compensator_fault",
    "system_leakage",
    "drain_restriction",
    "sensor_fault",
    "indeterminate",
)
"""What a verdict can be in."""
CAUSES = (*(state for state in STATES if state not in ("insufficient_data", "indeterminate")), "other")
"""What shares the probability; ``other``: no known cause."""
SIDES = ("pump", "system", "sensor", "none", "unknown")
State = Annotated[str, Field(json_schema_extra={"enum": list(STATES)})]
Cause = Annotated[str, Field(json_schema_extra={"enum": list(CAUSES)})]
Side = Annotated[str, Field(json_schema_extra={"enum": list(SIDES)})]
Priority = Annotated[str, Field(json_schema_extra={"enum": ["low", "medium", "high", "critical"]})]


@overload
def instant(moment: datetime) -> str: ...
@overload
def instant(moment: None) -> None: ...
@overload
def instant(moment: datetime | None) -> str | None: ...
def instant(moment: datetime | None) -> str | None:
    """An instant in UTC as answers write it; None stays None."""
    return None if moment is None else moment.isoformat().replace("+00:00", "Z")


@shape
class Page(TypedDict, Generic[Item]):
    """One page of a list."""

    items: list[Item]
    """What the page holds, in the order that the call states."""
    next: str | None
    """Cursor of the next page, handed back as `cursor`; null on the last one."""
