"""What is known of a pump's numbers before a point is measured: a spread per number, each with its source."""

from collections.abc import Mapping
from typing import NamedTuple

from twin.parameters import PumpType, Quantity

CIRCUIT_PARTS = "circuit"
_USUAL_SPREAD = 0.2
_SCREW = 0.06
"""Setting of a pump that comes to a shop, over its nominal one: estimate, some 10 bar of the adjusting screw."""
_POPULATION: Mapping[str, str] = {
    "compensator.k_spool": "droop_scale",
    "circuit.k_c": "drain_resistance_scale",
    "circuit.w_nu": "drain_viscosity_weight",
    "circuit.w_Q": "drain_flow_weight",
}
"""Numbers that differ between pumps and benches by more than their own source says: by the population's spread."""
_LINEAR = ("circuit.w_nu", "circuit.w_Q")
"""Weights of the drain law: they may be zero and below, so that their spread is absolute and not a ratio."""


class Prior(NamedTuple):
    """Spread of a number, one sigma, about the set's value.

    ``is_ratio``: the logarithm is normal with that sigma, so that the number keeps its sign; else the number itself.
    """

    spread: float
    is_ratio: bool
    source: str


def prior_of(kind: PumpType, quantity: Quantity, path: str) -> Prior:
    """Prior of one number: the larger of its stated uncertainty and of what pumps differ by.

    A number without either takes a fifth, and says so.
    """
    own = quantity.uncertainty
    is_ratio = path not in _LINEAR
    named = _POPULATION.get(path)
    between = kind.population[named].value if named is not None and named in kind.population else 0.0
    if path == "compensator.F_preload":
        between = _SCREW
    scale = 1.0 if is_ratio or not quantity.value else abs(quantity.value)
    stated = (own or 0.0) * scale
    if between > stated:
        words = "the adjusting screw's range (estimate)" if named is None else f"population: {named}"
        return Prior(between, is_ratio, words)
    if own:
        return Prior(stated, is_ratio, "the number's own uncertainty")
    return Prior(_USUAL_SPREAD * scale, is_ratio, "a fifth: its source states no uncertainty (estimate)")
