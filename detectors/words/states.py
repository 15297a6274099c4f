"""The states of a pump, and all that anybody says of one: its side, word, label, mark, urgency and alarm priority.

Pages, reports, ranking, alarms and the judge itself read this table; a new state is a new row of it.
"""

from collections.abc import Mapping
from enum import StrEnum
from typing import NamedTuple


class State(StrEnum):
    """What the pump and its circuit are judged to be in."""

    INSUFFICIENT_DATA = "insufficient_data"
    HEALTHY = "healthy"
    PUMP_DEGRADATION = "pump_degradation"
    COMPENSATOR_FAULT = "compensator_fault"
    SYSTEM_LEAKAGE = "system_leakage"
    DRAIN_RESTRICTION = "drain_restriction"
    SENSOR_FAULT = "sensor_fault"
    INDETERMINATE = "indeterminate"
    OTHER = "other"
    """None of the known causes: never a verdict's state, but one of its candidates and probabilities."""


class Side(StrEnum):
    """Where to look."""

    PUMP = "pump"
    SYSTEM = "system"
    SENSOR = "sensor"
    NONE = "none"
    UNKNOWN = "unknown"


class StateRow(NamedTuple):
    """One state as people meet it.

    Attributes
    ----------
    side
        Where to look.
    word, label, mark
        In the middle of a sentence, at the head of a page, and the sign beside it for those who see no colours.
    urgency
        Rank in a list of pumps, 0 first (our choice: what grounds a pump before what blinds a sensor).
    priority
        Of an alarm that the state raises, within the pump type's limits (our choice; ISA-18.2 asks for a few that people
        can tell apart); None where nothing is wrong as far as anybody can tell.
    """

    side: Side
    word: str
    label: str
    mark: str
    urgency: int
    priority: str | None


STATES: Mapping[State, StateRow] = {
    State.INSUFFICIENT_DATA: StateRow(Side.UNKNOWN, "no baseline yet", "Baseline", "○", 6, None),
    State.HEALTHY: StateRow(Side.NONE, "healthy", "Healthy", "✓", 7, None),
    State.PUMP_DEGRADATION: StateRow(Side.PUMP, "worn pump", "Worn pump", "▲", 0, "high"),
    State.COMPENSATOR_FAULT: StateRow(Side.PUMP, "compensator fault", "Compensator", "▲", 1, "high"),
    State.SYSTEM_LEAKAGE: StateRow(Side.SYSTEM, "leakage in the circuit", "Leak in circuit", "◆", 2, "high"),
    State.DRAIN_RESTRICTION: StateRow(Side.SYSTEM, "restricted drain line", "Drain restricted", "◆", 3, "high"),
    State.SENSOR_FAULT: StateRow(Side.SENSOR, "moved sensor", "Sensor moved", "■", 5, "low"),
    State.INDETERMINATE: StateRow(Side.UNKNOWN, "cannot tell yet", "Cannot tell yet", "?", 4, "medium"),
    State.OTHER: StateRow(Side.UNKNOWN, "none of the known causes", "Unexplained", "?", 4, "medium"),
}
SIDE_OF: Mapping[State, Side] = {state: row.side for state, row in STATES.items()}
QUIET: tuple[State, ...] = tuple(state for state, row in STATES.items() if row.priority is None)
"""States in which nothing is wrong as far as anybody can tell."""
FAULTS: tuple[State, ...] = tuple(s for s in State if SIDE_OF[s] in (Side.PUMP, Side.SYSTEM, Side.SENSOR))
"""States that compete with ``healthy`` by evidence."""
CAUSES: tuple[State, ...] = (State.HEALTHY, *FAULTS, State.OTHER)
"""Explanations that share the probability, in their order."""
VERDICTS: tuple[State, ...] = tuple(s for s in State if s is not State.OTHER)
"""States that a verdict can be in."""
BY_URGENCY: tuple[State, ...] = tuple(sorted(VERDICTS, key=lambda state: STATES[state].urgency))
"""From the most to the least urgent."""


def row_of(word: str) -> StateRow:
    """Row of a state by its word; one that another release knows and this one does not is taken as ``indeterminate``."""
    return STATES[State(word)] if word in set(State) else STATES[State.INDETERMINATE]
