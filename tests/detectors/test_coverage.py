"""Blind spots and missing evidence in counts: what a history holds is never asked for."""

import itertools
from dataclasses import replace

import pytest

from detectors.evaluation.ground_runs import GroundRuns
from detectors.evaluation.reality import REALITIES, fleet
from detectors.evaluation.sensing import Sensing, histories
from detectors.evaluation.study import seed_of
from detectors.judgement.assessment import assess
from detectors.judgement.coverage import Coverage, blind_spots, missing_evidence
from detectors.words.observation import History
from detectors.words.states import FAULTS, State
from detectors.words.thresholds import effective
from tests.detectors.fleet import CIRCUIT, PUMP, history
from tests.detectors.fleet import FAULTS as SIMULATED

P, C, L, D, S = FAULTS
X = State.OTHER
LEAK, DRAIN = "pump_leakage_change_lpm", "drain_resistance_change_percent"
FULL = Coverage(records=40, coldest=30.0, warmest=75.0, zeros=40, reservoirs=40, loaded=4, bursts=10)
"""A history that holds everything that can be asked of it."""
WORDS = {"pump-off": "zeros", "ground runs": "loaded", "bursts": "bursts", "different fluid temperatures": "span_k"}
"""What is asked for, by words of the request, and the count that answers it."""


def covered(found: History) -> Coverage:
    coverage = Coverage()
    for observation in found.observations:
        coverage = coverage.grown(observation)
    return coverage


def asked(candidates: tuple[State, ...], history: Coverage) -> dict[str, int]:
    """Records that are asked for, by the words above."""
    found = missing_evidence(candidates, history)
    return {word: m.records for m in found for word in WORDS if word in m.what}


def test_a_history_is_counted_as_it_is() -> None:
    found = history(3, 30)
    counted = covered(found)
    warmth = [w.means["fluid_temperature_degc"].mean for o in found.observations for w in o.reduction.windows]
    assert counted == Coverage(30, min(warmth), max(warmth), 30, 30, 0, 0)
    assert counted.span_k == max(warmth) - min(warmth)
    deaf = covered(history(3, 30, with_zero=False, with_reservoir=False))
    assert (deaf.records, deaf.zeros, deaf.reservoirs) == (30, 0, 0)


def test_ground_runs_and_bursts_are_counted() -> None:
    rng = seed_of(5, "coverage")
    flights = fleet(REALITIES[0], PUMP, CIRCUIT, rng, 1, 40)
    (found,) = histories(flights, PUMP, Sensing(burst=True, ground_runs=GroundRuns(10)), rng)
    counted = covered(found)
    assert counted.records == counted.bursts == len(found.observations)
    assert counted.loaded == sum(int(o.record_id) % 10 == 0 for o in found.observations)


def test_nothing_is_known_of_an_empty_history() -> None:
    assert blind_spots(Coverage(), {}) == ()
    assert Coverage().span_k == 0.0


def test_channels_that_are_there_leave_no_blind_spot() -> None:
    assert blind_spots(FULL, {LEAK: 0.3, DRAIN: 10.0}) == ()


@pytest.mark.parametrize(
    ("missing", "quantity", "below", "because"),
    [
        ({"reservoirs": 19}, LEAK, 0.6, "reservoir pressure is not measured"),
        ({"zeros": 19}, LEAK, 0.3, "no pump-off stretch"),
        ({"coldest": 60.0}, DRAIN, None, "within 15 K"),
    ],
)
def test_what_is_missing_is_a_blind_spot(
    missing: dict[str, float], quantity: str, below: float | None, because: str
) -> None:
    """Half of the records must hold it; what the filters find no smaller anyway is the bound."""
    poor = replace(FULL, **missing)  # type: ignore[arg-type]
    (found,) = blind_spots(poor, {LEAK: 0.1})
    assert (found.quantity, found.below) == (quantity, below)
    assert because in found.because
    (larger,) = blind_spots(poor, {LEAK: 0.9})
    assert larger.below == (None if below is None else 0.9)


def test_half_of_the_records_are_enough() -> None:
    assert blind_spots(replace(FULL, reservoirs=20, zeros=20), {}) == ()


def test_nothing_is_asked_for_that_the_history_holds() -> None:
    """Every pair and triple of causes, on a history that has it all: a gauge, a bench or an inspection is what remains."""
    for n in (2, 3, 6):
        for candidates in itertools.combinations((*FAULTS, X), n):
            assert asked(candidates, FULL) == {}, candidates
            assert missing_evidence(candidates, FULL), candidates


def test_what_is_asked_for_is_what_is_left_of_it() -> None:
    """Four ground runs and ten bursts decide: one that is there is one less to ask for."""
    for held in range(5):
        assert asked((P, L), replace(FULL, loaded=held)).get("ground runs", 0) == 4 - held
    for held in range(0, 11, 2):
        assert asked((P, D), replace(FULL, bursts=held)).get("bursts", 0) == 10 - held
    assert asked((P, D), replace(FULL, coldest=60.0)) == {"different fluid temperatures": 4}
    assert asked((P, S), replace(FULL, zeros=0)) == {"pump-off": 3}


def test_only_what_would_decide_is_asked_for() -> None:
    """Load tells the circuit from the pump, ripple the pump from its drain, warmth a drain from a leak."""
    nothing = Coverage(records=40, coldest=50.0, warmest=55.0, zeros=40, reservoirs=40)
    assert set(asked((P, L), nothing)) == {"ground runs"}
    assert set(asked((L, D), nothing)) == {"bursts"}
    assert set(asked((P, D), nothing)) == {"bursts", "different fluid temperatures"}
    assert set(asked((P, C), nothing)) == set()
    for candidates in itertools.combinations((*FAULTS, X), 3):
        for found in missing_evidence(candidates, nothing):
            assert found.records > 0
            assert set(found.would_decide) <= set(candidates)
            assert len(found.would_decide) > 1


def test_a_single_cause_leaves_nothing_to_decide() -> None:
    for candidates in ((), (P,), (X,)):
        assert missing_evidence(candidates, Coverage()) == ()


def test_a_verdict_says_its_blind_spots_and_asks_for_what_it_lacks() -> None:
    thresholds = effective({})
    blind = assess(history(11, 20, with_reservoir=False), PUMP, CIRCUIT, thresholds)[-1].verdict
    assert [spot.quantity for spot in blind.blind_spots] == [LEAK]
    assert blind.state is State.HEALTHY
    assert "leakage above" in blind.advice  # healthy as far as that goes
    assert "reservoir pressure is not measured" in blind.advice
    assert not assess(history(11, 20), PUMP, CIRCUIT, thresholds)[-1].verdict.blind_spots
    undecided = [
        a.verdict
        for a in assess(history(2, 40, SIMULATED["worn"]), PUMP, CIRCUIT, thresholds)
        if a.verdict.state is State.INDETERMINATE
    ]
    assert undecided
    for verdict in undecided:
        (first, *_) = verdict.missing_evidence
        assert verdict.resolving_measurement == first.what
        assert f"{first.records} more would decide" in verdict.advice
        assert "at clearly different fluid temperatures" not in verdict.advice  # the windows span 50 K already
