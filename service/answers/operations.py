"""Liveness and readiness."""

from typing import NotRequired

from typing_extensions import TypedDict

from service.answers.verdicts import Software
from service.answers.words import shape


@shape
class Alive(TypedDict):
    """The process serves."""

    status: str
    """Always `alive`."""


@shape
class Readiness(TypedDict):
    """Whether the service can do its work."""

    status: str
    """`ready` or `not ready`."""
    checks: dict[str, str]
    """`ok`, or what is wrong, by the part that was asked."""
    software: NotRequired[Software]
    """Release, commit and sources of this process."""
