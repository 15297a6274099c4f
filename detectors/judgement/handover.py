"""What a pump that leaves a position has learnt of it, for the pump that sits there next."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime

from detectors.bank.bank import Bank
from detectors.bank.position import OF_POSITION, Position, position_of
from detectors.judgement.events import Freed, freed_by
from detectors.judgement.isolation import evidence
from detectors.words.observation import Maintenance

EXCHANGED = "pump_exchanged"
"""Word for an exchange beside the actions that can be entered."""
FEWEST_RECORDS = 8
"""Records at a position below which nothing is handed on: before filters are first fitted anew they are surer than they
should be."""
_ENDED_BY_WORK = ("drain_extra", "drain_viscous", "drain_orifice", "case_span")
"""Components that only faults of the position move."""


@dataclass(frozen=True, slots=True)
class Handover:
    """What is known of a position behind its last record ``at``; ``records`` of all pumps there have taught it.

    ``done`` are the entries about the pump that left between that record and the next pump's first one: what they touched of
    the position is as they left it.
    """

    at: datetime
    records: int
    position: Position
    done: tuple[Maintenance, ...] = ()


@dataclass(frozen=True, slots=True)
class Left:
    """A position that a pump has left, with what it knew of it."""

    aircraft: str
    position: str
    handover: Handover


def handed_over(
    bank: Bank, thresholds: Mapping[str, float], at: datetime, records: int, done: Sequence[Maintenance] = ()
) -> Handover:
    """What a bank hands on."""
    found = evidence(bank, thresholds)
    return Handover(at, records, position_of(bank, found.weights, found.by_prior), tuple(done))


def with_left(before: tuple[Left, ...], now: Left) -> tuple[Left, ...]:
    """Positions left so far, each once."""
    return (*(x for x in before if (x.aircraft, x.position) != (now.aircraft, now.position)), now)


def left_at(before: tuple[Left, ...], aircraft: str, position: str) -> Handover | None:
    """What a pump itself knew of a position when it left it; None where it never sat there."""
    return next((x.handover for x in before if (x.aircraft, x.position) == (aircraft, position)), None)


def freed_of_position(entry: Maintenance) -> Freed:
    """What an entry about a pump makes unknown of the position that it has left."""
    return {name: spread for name, spread in freed_by(entry).items() if name in (*OF_POSITION, *_ENDED_BY_WORK)}
