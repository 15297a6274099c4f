"""Headline, probabilities, advice and interval are one statement: held over simulated histories."""

from dataclasses import replace

import pytest

from detectors.evaluation.ground_runs import GroundRuns
from detectors.evaluation.reality import REALITIES, fleet
from detectors.evaluation.sensing import Sensing, histories
from detectors.evaluation.study import seed_of
from detectors.judgement.assessment import assess
from detectors.words.observation import History
from detectors.words.thresholds import effective
from tests.detectors.fleet import CIRCUIT, FAULTS, PUMP, Fault, growing, history
from tests.detectors.sentences import disagreements, held_by

THRESHOLDS = effective({}, PUMP)


def step(field: str, amount: float, start: int, *, factor: bool = False, half: bool = False) -> Fault:
    """A fault that is there at once from flight ``start`` on, or on every second flight from there."""
    whole = growing(field, amount, n=2, start=0, factor=factor)
    return lambda i, own: whole(1, own) if i >= start and not (half and i % 2) else own


SUDDEN: dict[str, Fault | None] = {
    "healthy": None,
    "worn at once": step("pump_leakage_scale", 1.0, 14, factor=True),
    "worn on arrival": step("pump_leakage_scale", 1.3, 0, factor=True),
    "drain x3": step("drain_resistance_scale", 2.0, 12, factor=True),
    "drain x10": step("drain_resistance_scale", 9.0, 12, factor=True),
    "half the flights": step("system_leakage_lpm", 3.0, 10, half=True),
    "setting at once": step("pressure_setting_change_bar", 2.0, 15),
}


def faults_of(found: History) -> list[str]:
    observations = sorted(found.observations, key=lambda o: (o.at, o.record_id))
    wrong = []
    for assessment, held in zip(assess(found, PUMP, CIRCUIT, THRESHOLDS), held_by(observations), strict=True):
        wrong += [f"{assessment.record_id} {w}" for w in disagreements(assessment.verdict, held, THRESHOLDS)]
    return wrong


@pytest.mark.parametrize("name", [*SUDDEN, *FAULTS])
def test_words_agree_with_numbers(name: str) -> None:
    assert faults_of(history(5, 30, (SUDDEN | FAULTS)[name])) == []


@pytest.mark.parametrize("lost", ["zero", "reservoir", "both", "warmth"])
def test_words_agree_where_something_is_not_seen(lost: str) -> None:
    found = history(
        6, 26, FAULTS["worn"], with_zero=lost not in ("zero", "both"), with_reservoir=lost not in ("reservoir", "both")
    )
    if lost == "warmth":
        found = replace(found, observations=found.observations[:26])
    assert faults_of(found) == []


@pytest.mark.study
@pytest.mark.parametrize("seed", range(24))
def test_words_agree_with_numbers_over_many_histories(seed: int) -> None:
    wrong = []
    for name, fault in (SUDDEN | FAULTS).items():
        for sight in ({}, {"with_zero": False}, {"with_reservoir": False}, {"spikes": True}, {"zero_step_bar": 0.3}):
            wrong += [f"{name} {sight} {w}" for w in faults_of(history(seed, 60, fault, **sight))]
    assert wrong == []


@pytest.mark.study
@pytest.mark.parametrize("seed", range(6))
def test_words_agree_where_the_history_holds_all_that_can_be_asked(seed: int) -> None:
    rng = seed_of(seed, "sentences")
    wrong = []
    for reality in REALITIES:
        flights = fleet(reality, PUMP, CIRCUIT, rng, 4, 60)
        for found in histories(flights, PUMP, Sensing(burst=True, ground_runs=GroundRuns(6)), rng):
            wrong += faults_of(found)
    assert wrong == []
