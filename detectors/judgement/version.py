"""Version of the twin behind a verdict: the sources of twin and judge, and the numbers of the parameter set."""

from functools import cache

from detectors.expectation import residuals
from detectors.judgement import assessment, succession
from detectors.reduction import recording as reduction
from detectors.words import thresholds
from twin import operating_point
from twin.parameters import PumpType
from twin.pumps import fluids
from twin.sources import sources_hash
from twin.version import numbers_hash

_HEX = 8
_MODULES = (operating_point, fluids, reduction, residuals, assessment, succession, thresholds)
"""From a recording to a verdict, with built-in priors and thresholds; everything that they import counts."""


def twin_version(pump: PumpType) -> str:
    """Version of the twin of one pump type, e.g. ``h225-0c1f7a52-5f3c09ab``; the same on every machine.

    The first group of digits follows from the sources of twin and judge, so that no number is raised by hand, the
    second one from the parameter set. With the version of the thresholds it names everything, besides what is known
    of a pump, that a verdict is a function of.
    """
    return f"{pump.name}-{code_version()}-{numbers_hash(pump)}"


@cache
def code_version() -> str:
    """Hash over the sources of all that makes verdicts of recordings, 8 hexadecimal digits."""
    return sources_hash(*(module.__name__ for module in _MODULES))[:_HEX]
