"""Which record stands for its flight, and which bursts add to it: decided by outlines, without a record's numbers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

from detectors.words.observation import Observation


@dataclass(frozen=True, slots=True)
class Outline:
    """What of an observation decides its part in the history.

    ``has_zero_flow`` is True with an accepted zero-flow window, ``has_spectrum`` where the record is fast enough for one.
    """

    record_id: str
    at: datetime
    aircraft: str
    position: str
    flight_id: str
    segment: str | None
    has_zero_flow: bool
    has_spectrum: bool

    @property
    def flight(self) -> tuple[str, str, str]:
        """What the records of one flight of one pump share."""
        return self.aircraft, self.position, self.flight_id


@dataclass(frozen=True, slots=True)
class Roles:
    """Parts of a history's records: those that stand for their flight, and for a burst the one that it adds to."""

    counted: frozenset[str]
    adds_to: Mapping[str, str]


def outline_of(observation: Observation) -> Outline:
    """Outline of a whole observation."""
    return Outline(
        record_id=observation.record_id,
        at=observation.at,
        aircraft=observation.aircraft,
        position=observation.position,
        flight_id=observation.flight_id,
        segment=observation.segment,
        has_zero_flow=observation.reduction.zero_flow is not None,
        has_spectrum=observation.reduction.spectrum is not None,
    )


def roles_of(outlines: Sequence[Outline]) -> Roles:
    """Roles of a history's records, given in event order.

    A flight counts once: its main record where that has a zero-flow window, else its first segment that has one.
    Later records of the flight that hold a spectrum add their lines to it.
    """
    best: dict[tuple[str, str, str], Outline] = {}
    for outline in outlines:
        if not outline.has_zero_flow:
            continue
        held = best.get(outline.flight)
        if held is None or (held.segment is not None and outline.segment is None):
            best[outline.flight] = outline
    counted = frozenset(o.record_id for o in best.values())
    stands: dict[tuple[str, str, str], str] = {}
    adds_to: dict[str, str] = {}
    for outline in outlines:
        if outline.record_id in counted:
            stands[outline.flight] = outline.record_id
        elif outline.has_spectrum and outline.flight in stands:
            adds_to[outline.record_id] = stands[outline.flight]
    return Roles(counted, adds_to)
