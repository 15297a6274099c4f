"""Errors as problem documents (RFC 9457)."""

from typing import Annotated, NotRequired

from pydantic import Field
from typing_extensions import TypedDict

from service.answers.words import shape


@shape
class ProblemError(TypedDict):
    """One thing wrong with an input."""

    where: str
    """Place of the fault in the input, for example `query.limit`, `body.values` or `channels.time_s`."""
    problem: str
    """What is wrong there."""


@shape
class Problem(TypedDict):
    """A problem document (RFC 9457); a kind of problem may have further members of its own."""

    type: Annotated[str, Field(json_schema_extra={"format": "uri"})]
    """Kind of problem."""
    title: str
    """The kind in words."""
    status: int
    """HTTP status (a code, no quantity)."""
    detail: str
    """What happened, and what to do next."""
    errors: NotRequired[list[ProblemError]]
    """Every fault found in a bad input."""
