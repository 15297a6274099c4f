"""Parameter sets: one file per pump, every number with unit and source."""

from collections.abc import Mapping

from twin.parameters import Circuit, PumpType
from twin.pumps.circuits import CIRCUITS
from twin.pumps.h225 import H225
from twin.pumps.h225_thesis import H225_THESIS

PUMP_TYPES: Mapping[str, PumpType] = {kind.name: kind for kind in (H225, H225_THESIS)}


def pump_type(name: str) -> PumpType:
    """Parameter set of a pump type.

    Raises
    ------
    KeyError
        naming the types that exist.
    """
    if name not in PUMP_TYPES:
        raise KeyError(f"no pump type {name!r}; known: {', '.join(sorted(PUMP_TYPES))}")
    return PUMP_TYPES[name]


def circuit_parameters(name: str) -> Circuit:
    """Parameters of a circuit: ``shared_return``, ``separate_drain`` or ``acceptance_stand``.

    Raises
    ------
    KeyError
        naming the circuits that exist.
    """
    if name not in CIRCUITS:
        raise KeyError(f"no circuit {name!r}; known: {', '.join(sorted(CIRCUITS))}")
    return CIRCUITS[name]
