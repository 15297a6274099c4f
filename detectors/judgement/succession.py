"""Pumps that follow each other at their positions: who takes over from whom, and all of them judged together.

A pump that begins a stay takes over what the last record of another pump there has taught of the position. In hindsight, once
the next pump at a position that it left has shown whether what was wrong there was the position's, it learns that too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import pairwise
from typing import NamedTuple

from detectors.expectation.type_correction import HealthyCurve
from detectors.judgement.assessment import Fold
from detectors.judgement.events import due
from detectors.judgement.handover import FromOthers, Handover
from detectors.words.flights import outline_of, roles_of
from detectors.words.observation import History
from detectors.words.verdict import Assessment
from twin.parameters import Circuit, PumpType

FOLLOWED = 12
"""Records of the next pump at a position after which is asked whether what was wrong was the position's (our choice: four more
than a baseline has)."""
Place = tuple[str, str]
"""Aircraft and position."""


class Seat(NamedTuple):
    """One record of a pump at a place; seats order by event."""

    at: datetime
    record_id: str
    pump: int
    place: Place


@dataclass(frozen=True, slots=True)
class Sources:
    """Whom a pump's records take over from, as (pump, record), by the record that does.

    ``arrivals`` are those that begin a stay where another pump sat, ``hindsights`` the first ones behind what the next pump
    at the position left last has shown.
    """

    arrivals: Mapping[str, tuple[int, str]]
    hindsights: Mapping[str, tuple[int, str]]

    def wanted(self) -> set[tuple[int, str]]:
        """Every record that is taken over from."""
        return {*self.arrivals.values(), *self.hindsights.values()}


def sources_of(own: Sequence[Seat], there: Mapping[Place, Sequence[Seat]], installed_at: Sequence[datetime]) -> Sources:
    """Whom one pump takes over from.

    Parameters
    ----------
    own
        Seats of the pump in event order.
    there
        By place, at least for those of ``own``: seats of all pumps in event order, its own among them.
    installed_at
        Instants at which the pump was put in or taken out.
    """
    arrivals, hindsights = {}, {}
    starts = [0] if own else []
    for i, (before, here) in enumerate(pairwise(own), 1):
        if before.place != here.place or any(before.at < t <= here.at for t in installed_at):
            starts.append(i)
    for k, start in enumerate(starts):
        first = own[start]
        earlier = [s for s in there[first.place] if s < first]
        if earlier and earlier[-1].pump != first.pump:
            arrivals[first.record_id] = (earlier[-1].pump, earlier[-1].record_id)
        if k == 0:
            continue
        left = own[start - 1]
        followed = [s for s in there[left.place] if s > left][:FOLLOWED]
        next_ones = {s.pump for s in followed}
        if len(followed) < FOLLOWED or len(next_ones) > 1 or left.pump in next_ones:
            continue
        end = starts[k + 1] if k + 1 < len(starts) else len(own)
        behind = [s for s in own[start:end] if s > followed[-1]]
        if behind:
            hindsights[behind[0].record_id] = (followed[-1].pump, followed[-1].record_id)
    return Sources(arrivals, hindsights)


@dataclass(frozen=True, slots=True)
class Judged:
    """Assessments of one pump in event order, and what its records took over from others, by record."""

    assessments: tuple[Assessment, ...]
    others: Mapping[str, FromOthers]


def assess_together(
    histories: Sequence[History],
    pump: PumpType,
    circuit: Circuit,
    thresholds: Mapping[str, float],
    healthy: HealthyCurve | None = None,
) -> tuple[Judged, ...]:
    """Assess pumps of one operator, of one type in one kind of circuit, that may have shared positions.

    Parameters
    ----------
    histories
        One for each pump, observations in any order; the rest as ``assessment.assess`` takes it.

    Returns
    -------
    tuple
        One for each pump.
    """
    folds = [Fold(pump, circuit, thresholds, healthy) for _ in histories]
    sequences = [sorted(h.observations, key=lambda o: (o.at, o.record_id)) for h in histories]
    seats = [[Seat(o.at, o.record_id, i, (o.aircraft, o.position)) for o in found] for i, found in enumerate(sequences)]
    order = sorted(seat for own in seats for seat in own)
    there: dict[Place, list[Seat]] = {}
    for seat in order:
        there.setdefault(seat.place, []).append(seat)
    sources = [sources_of(own, there, h.installed_at) for own, h in zip(seats, histories, strict=True)]
    wanted = set().union(*(s.wanted() for s in sources))
    given: list[dict[str, FromOthers]] = [{} for _ in histories]
    running = [
        fold.continued(observations, roles_of([outline_of(o) for o in observations]), h, others=taken)
        for fold, observations, h, taken in zip(folds, sequences, histories, given, strict=True)
    ]
    found: list[list[Assessment]] = [[] for _ in histories]
    learnt: dict[tuple[int, str], tuple[Handover, float | None]] = {}
    for at, record_id, i, _ in order:
        arrival, hindsight = sources[i].arrivals.get(record_id), sources[i].hindsights.get(record_id)
        if arrival or hindsight:
            handover = None
            if arrival:
                handover = learnt[arrival][0]
                done = due(histories[arrival[0]].maintenance, handover.at, at)
                handover = handover.with_done(done)
            given[i][record_id] = FromOthers(handover, learnt[hindsight][1] if hindsight else None)
        found[i].append(next(running[i]))
        if (i, record_id) in wanted:
            learnt[i, record_id] = folds[i].handover(), folds[i].survival()
    return tuple(Judged(tuple(a), taken) for a, taken in zip(found, given, strict=True))
