"""A share of cases with its interval."""

from typing_extensions import TypedDict

from service.answers.words import shape


@shape
class Share(TypedDict):
    """A share of cases with its Wilson 95 % interval."""

    cases: int
    """Number of cases (a count)."""
    of: int
    """Number that they are out of (a count)."""
    share: float | None
    """Their share, from 0 to 1; null without any."""
    low: float | None
    """Lower end of the share's interval."""
    high: float | None
    """Upper end of the share's interval."""
