"""Faults that come and go, and faults that went: on simulated pumps whose laws differ from the judge's."""

from collections.abc import Sequence
from functools import cache

import numpy as np
import pytest

from detectors.evaluation.reality import REALITIES, Course, fleet
from detectors.evaluation.sensing import Sensing, histories
from detectors.evaluation.study import seed_of
from detectors.judgement.assessment import assess
from detectors.words.states import FAULTS, State
from detectors.words.thresholds import effective
from detectors.words.verdict import Assessment
from tests.detectors.fleet import CIRCUIT, PUMP

THRESHOLDS = effective({})
N_PUMPS, N_FLIGHTS, ONSET = 4, 90, 40
SIZES = {"slippers": 0.6, "drain": 1.0, "system": 3.0}


@cache
def flown(kind: str, end: int = N_FLIGHTS) -> tuple[tuple[np.ndarray, tuple[Assessment, ...]], ...]:
    """Pumps with a fault on half of the flights from ``ONSET`` to before ``end``: whether it was there, and what was said."""
    rng = seed_of(7, "on and off", kind)
    flights = np.arange(N_FLIGHTS)
    there = (flights >= ONSET) & (flights < end) & (rng.uniform(size=(N_PUMPS, N_FLIGHTS)) < 0.5)
    course = Course(kind, SIZES[kind] * there.astype(float))
    flown = fleet(REALITIES[0], PUMP, CIRCUIT, rng, N_PUMPS, N_FLIGHTS, (course,))
    seen = histories(flown, PUMP, Sensing(), rng)
    return tuple((own, assess(h, PUMP, CIRCUIT, THRESHOLDS)) for own, h in zip(there, seen, strict=True))


def showed_on(there: np.ndarray, assessed: Sequence[Assessment], last: int) -> int:
    """True number of flights with the fault among the last records."""
    return int(sum(there[int(a.record_id)] for a in assessed[-last:]))


@pytest.mark.parametrize("kind", SIZES)
def test_a_fault_on_half_of_the_flights_is_said_to_come_and_go(kind: str) -> None:
    """Within twenty flights, and to the end; on as many of the last ones as it was there, give or take one in ten."""
    for there, assessed in flown(kind):
        verdicts = [a.verdict for a in assessed if int(a.record_id) >= ONSET + 20]
        assert all(v.state not in (State.HEALTHY, State.INSUFFICIENT_DATA) for v in verdicts)
        final = verdicts[-1]
        found = final.intermittent
        assert found is not None
        assert found.state in (final.state, *final.candidates)
        assert found.of == 20
        assert abs(found.records - showed_on(there, assessed, found.of)) <= 2
        assert f"comes and goes: it showed on {found.records} of {found.of} flights" in final.advice


@pytest.mark.parametrize("kind", SIZES)
def test_a_fault_that_comes_and_goes_is_there_among_what_is_possible(kind: str) -> None:
    """Nobody else is named: in at least three pumps of four the right cause is named or possible."""
    right = {"slippers": State.PUMP_DEGRADATION, "drain": State.DRAIN_RESTRICTION, "system": State.SYSTEM_LEAKAGE}[kind]
    last = [assessed[-1].verdict for _, assessed in flown(kind)]
    assert sum(right in (v.state, *v.candidates) for v in last) >= 3
    assert all(v.state in (right, State.INDETERMINATE) for v in last)


@pytest.mark.parametrize("kind", SIZES)
def test_a_fault_that_vanished_is_remembered_behind_a_healthy_state(kind: str) -> None:
    """Twenty flights of coming and going, then thirty without: healthy, and what there was since when is still said."""
    for there, assessed in flown(kind, ONSET + 20):
        final = assessed[-1].verdict
        assert final.state is State.HEALTHY
        found = final.intermittent
        assert found is not None
        assert found.state in FAULTS
        alarms = [a for a in assessed if a.verdict.state not in (State.HEALTHY, State.INSUFFICIENT_DATA)]
        assert found.state in {s for a in alarms for s in (a.verdict.state, *a.verdict.candidates)}
        first = next(a.at for a in assessed if there[int(a.record_id)])
        assert first <= found.since <= alarms[-1].at
        assert 0 < found.records <= found.of
        assert "comes and goes" in final.advice


def test_one_flight_is_an_outlier_and_two_are_chance() -> None:
    """A drain twice as resistant on a single flight, or on two that lie twenty apart, raises no alarm."""
    for flights in ((50,), (50, 70)):
        rng = seed_of(9, "outlier")
        there = np.isin(np.arange(N_FLIGHTS), flights)
        course = Course("drain", np.tile(there.astype(float), (N_PUMPS, 1)))
        flown = fleet(REALITIES[0], PUMP, CIRCUIT, rng, N_PUMPS, N_FLIGHTS, (course,))
        for found in histories(flown, PUMP, Sensing(outlier=0.0, dropout=0.0), rng):
            states = {a.verdict.state for a in assess(found, PUMP, CIRCUIT, THRESHOLDS)[8:]}
            assert states == {State.HEALTHY}
