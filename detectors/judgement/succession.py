"""Pumps that follow each other at their positions, judged together: each takes over what the one before knew of the place."""

from collections.abc import Mapping, Sequence
from datetime import datetime

from detectors.expectation.type_correction import HealthyCurve
from detectors.judgement.assessment import Fold
from detectors.judgement.events import due
from detectors.judgement.handover import Handover, left_at
from detectors.words.flights import outline_of, roles_of
from detectors.words.observation import History, Observation
from detectors.words.verdict import Assessment
from twin.parameters import Circuit, PumpType


def assess_together(
    histories: Sequence[History],
    pump: PumpType,
    circuit: Circuit,
    thresholds: Mapping[str, float],
    healthy: HealthyCurve | None = None,
) -> tuple[tuple[Assessment, ...], ...]:
    """Assess pumps of one operator, of one type in one kind of circuit, that may have shared positions.

    Parameters
    ----------
    histories
        One for each pump, observations in any order; the rest as ``assessment.assess`` takes it.

    Returns
    -------
    tuple
        Assessments of each pump, in event order. Where a pump begins a stay, it begins with what the last record of another
        pump at that position has taught; where that was its own, with what it knew itself when it left.
    """
    folds = [Fold(pump, circuit, thresholds, healthy) for _ in histories]
    sequences = [sorted(h.observations, key=lambda o: (o.at, o.record_id)) for h in histories]
    given: list[dict[str, Handover]] = [{} for _ in histories]
    running = [
        fold.continued(observations, roles_of([outline_of(o) for o in observations]), h, handovers=taken)
        for fold, observations, h, taken in zip(folds, sequences, histories, given, strict=True)
    ]
    found: list[list[Assessment]] = [[] for _ in histories]
    last_at: dict[tuple[str, str], int] = {}
    order = sorted((o.at, o.record_id, i, o) for i, observations in enumerate(sequences) for o in observations)
    for _, _, i, observation in order:
        place = (observation.aircraft, observation.position)
        before = last_at.get(place)
        if before is not None and before != i and folds[i].begins_a_stay(observation, histories[i]):
            handover = _left_by(folds[before], histories[before], place, observation)
            if handover is not None:
                given[i][observation.record_id] = handover
        found[i].append(next(running[i]))
        last_at[place] = i
    return tuple(tuple(assessments) for assessments in found)


def _left_by(fold: Fold, history: History, place: tuple[str, str], coming: Observation) -> Handover | None:
    """What a pump knows of a position at which it had the last record before another one comes."""
    latest = fold.latest
    if latest is not None and (latest.aircraft, latest.position) == place:
        return fold.handover(until(history, latest.at, coming.at))
    return left_at(fold.left, *place)


def until(history: History, after: datetime, coming: datetime) -> list:
    """Entries about the pump that left before the next one came."""
    return due(history.maintenance, after, coming)
