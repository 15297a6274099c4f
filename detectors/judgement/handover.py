"""What a pump that leaves a position has learnt of it, for the pump that sits there next."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime

from detectors.bank.bank import Bank
from detectors.bank.position import OF_POSITION, Position, log_odds_of, position_of
from detectors.judgement.events import Freed, freed_by
from detectors.judgement.isolation import evidence
from detectors.words.observation import Maintenance

FEWEST_RECORDS = 8
"""Records at a position below which nothing is handed on: before filters are first fitted anew they are surer than they
should be."""
_MOST_SURVIVAL = 6.0
"""What the next pump's records may say at most [nat] (our choice: as much as is handed on)."""
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

    def with_done(self, done: Sequence[Maintenance]) -> "Handover":
        """The same where something was done since."""
        return replace(self, done=tuple(done))


@dataclass(frozen=True, slots=True)
class Left:
    """A position that a pump has left behind its first ``records`` records, with what it knew of it."""

    aircraft: str
    position: str
    handover: Handover
    records: int


@dataclass(frozen=True, slots=True)
class Inherited:
    """What a pump has taken over that may be wrong with its position: the log odds [nat] then, and the onset of its filters.

    ``at`` is the last record of the pump before.
    """

    at: datetime
    onset: int
    log_odds: float


@dataclass(frozen=True, slots=True)
class FromOthers:
    """What a record of one pump takes over from others.

    ``handover`` is what the pump before has learnt of the position; ``survival`` how far the records of the next pump at the
    position that was left last speak for what was wrong there being the position's [nat].
    """

    handover: Handover | None = None
    survival: float | None = None


LIKELY = 0.5
"""Probability that something is wrong with a position from which the alarm goes on for the next pump there."""
NOTHING = FromOthers()
ALONE: Mapping[str, FromOthers] = {}
"""What records take over where no other pump sat there."""


def handed_over(
    bank: Bank, thresholds: Mapping[str, float], at: datetime, records: int, done: Sequence[Maintenance] = ()
) -> Handover:
    """What a bank hands on."""
    found = evidence(bank, thresholds)
    return Handover(at, records, position_of(bank, found.weights, found.by_prior), tuple(done))


def survival_of(bank: Bank, thresholds: Mapping[str, float], inherited: Inherited | None) -> float | None:
    """How far what a bank has seen speaks for what it took over being wrong with its position [nat]; None: nothing was."""
    if inherited is None:
        return None
    now = log_odds_of(bank, evidence(bank, thresholds).weights, inherited.onset)
    return max(-_MOST_SURVIVAL, min(_MOST_SURVIVAL, now - inherited.log_odds))


def with_left(before: tuple[Left, ...], now: Left) -> tuple[Left, ...]:
    """Positions left so far, each once."""
    return (*(x for x in before if (x.aircraft, x.position) != (now.aircraft, now.position)), now)


def left_at(before: tuple[Left, ...], aircraft: str, position: str) -> Handover | None:
    """What a pump itself knew of a position when it left it; None where it never sat there."""
    return next((x.handover for x in before if (x.aircraft, x.position) == (aircraft, position)), None)


def freed_of_position(entry: Maintenance) -> Freed:
    """What an entry about a pump makes unknown of the position that it has left."""
    return {name: spread for name, spread in freed_by(entry).items() if name in (*OF_POSITION, *_ENDED_BY_WORK)}
