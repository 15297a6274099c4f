"""What an adapter hands over before anything is checked: columns of numbers and texts, metadata of any kind."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from service.errors import Fault

MOST_FAULTS_OF_A_KIND = 5


@dataclass(frozen=True, slots=True)
class RawRecord:
    """Decoded content of a file.

    Attributes
    ----------
    metadata
        Keys and values as the file gives them.
    channels
        Name to samples as numbers, shape (n,) each but not yet of equal length; missing samples are NaN.
    faults
        What was wrong already in single cells, with the place of each.
    """

    metadata: dict[str, Any]
    channels: dict[str, NDArray[np.float64]]
    faults: list[Fault] = field(default_factory=list)


def capped(faults: list[Fault], more: int, what: str, where: str) -> list[Fault]:
    """Faults of one kind, the first few by name and the rest as a count."""
    if more <= 0:
        return faults
    return [*faults, Fault(where, f"{more} more {what}")]
