"""Spreads learnt from healthy pumps, against posteriors and fleets whose spreads are known."""

import math
from dataclasses import replace

import numpy as np
import pytest

from detectors.bank.hypotheses import prior
from detectors.evaluation.reality import REALITIES, fleet
from detectors.evaluation.sensing import Sensing, histories
from detectors.expectation.components import N_STATE, PLACE
from detectors.judgement.assessment import Fold, outline_of
from detectors.judgement.population import FEWEST_PUMPS, Posterior, learnt, posterior_of
from detectors.words.flights import roles_of
from detectors.words.thresholds import effective
from tests.detectors.fleet import CIRCUIT, FAULTS, PUMP, history

MEAN, SD = prior(PUMP)


def posteriors(n: int, true: dict[str, float], error: float, begun: np.ndarray = SD, seed: int = 1) -> list[Posterior]:
    """Exact posteriors of pumps drawn with other spreads, whose records err by a share of the type's."""
    rng = np.random.default_rng(seed)
    spread = SD.copy()
    for name, value in true.items():
        spread[PLACE[name]] = value
    found = []
    for _ in range(n):
        noise = (error * SD) ** 2
        said = MEAN + spread * rng.standard_normal(N_STATE) + error * SD * rng.standard_normal(N_STATE)
        alive = SD > 0.0
        variance, mean = np.zeros(N_STATE), np.zeros(N_STATE)
        variance[alive] = 1.0 / (1.0 / begun[alive] ** 2 + 1.0 / noise[alive])
        mean[alive] = variance[alive] * (MEAN[alive] / begun[alive] ** 2 + said[alive] / noise[alive])
        found.append(Posterior(mean, variance))
    return found


def test_well_known_pumps_give_their_spread() -> None:
    # 300 pumps know their spread to 4 % (one sigma) and a spread of 1 that is worth ten of them adds 8 %; 3000 to 1 % each
    found = {s.name: s for s in learnt(posteriors(3000, {"setting": 0.4, "ln_drain": 0.35}, 0.1), PUMP)}
    for name, true in (("pressure_setting_bar", 0.4), ("drain_resistance_scale", 0.35)):
        assert found[name].value == pytest.approx(true, rel=0.07)
        # 3000 draws tell a spread to 1 / sqrt(2 * 3000); the pumps' own errors add little: 90 or 95 % of it
        width = (found[name].high - found[name].low) / (2.0 * true / math.sqrt(6000.0))
        assert 1.5 < width < 2.5
        assert found[name].pumps == 3000
    assert found["case_zero_bar"].value == pytest.approx(found["case_zero_bar"].before, rel=0.1)
    assert found["pressure_setting_bar"].unit == "bar"


def test_every_step_goes_towards_the_truth_and_never_beyond() -> None:
    true, place = 0.4, PLACE["setting"]
    kind, begun, before = PUMP, SD.copy(), 1.0
    for _ in range(40):
        # records that err by half of the spread before: a thousand pumps know theirs to 5 %
        found = {s.name: s for s in learnt(posteriors(1000, {"setting": true}, 0.5, begun), kind)}
        value = found["pressure_setting_bar"].value
        assert true - 0.05 < value < before + 1e-3
        before, begun[place] = value, value
        quantity = replace(kind.population["pressure_setting_bar"], value=value)
        population = {**kind.population, "pressure_setting_bar": quantity}
        kind = replace(kind, population=population)
    assert before < true + 0.1  # steps grow small near the end


def test_few_pumps_or_silent_ones_move_little() -> None:
    few = {s.name: s for s in learnt(posteriors(FEWEST_PUMPS, {"setting": 0.1}, 0.2), PUMP)}["pressure_setting_bar"]
    many = {s.name: s for s in learnt(posteriors(100, {"setting": 0.1}, 0.2), PUMP)}["pressure_setting_bar"]
    assert 0.1 < many.value < few.value < few.before
    silent = learnt([Posterior(MEAN, SD**2)] * 50, PUMP)
    for spread in silent:
        assert (spread.value, spread.pumps) == (pytest.approx(spread.before), 0)


def test_too_few_pumps_teach_nothing() -> None:
    with pytest.raises(ValueError, match="7 healthy pumps of type h225"):
        learnt(posteriors(7, {}, 0.2), PUMP)


def test_a_simulated_fleet_moves_the_spreads_to_its_own() -> None:
    """True spreads: setting 0.8 bar (clipped), drain 0.18, leakage 0.25 (clipped); the judge began with 1, 0.2 and 0.3."""
    rng = np.random.default_rng(6)
    found = []
    for h in histories(fleet(REALITIES[0], PUMP, CIRCUIT, rng, 30, 45), PUMP, Sensing(), rng):
        fold = Fold(PUMP, CIRCUIT, effective({}))
        observations = sorted(h.observations, key=lambda o: o.at)
        for _ in fold.continued(observations, roles_of([outline_of(o) for o in observations]), h):
            pass
        found.append(posterior_of(fold))
    known = [p for p in found if p is not None]
    assert len(known) >= 26
    learned = {s.name: s for s in learnt(known, PUMP)}
    for name, true in (("pressure_setting_bar", 0.8), ("drain_resistance_scale", 0.18), ("pump_leakage_scale", 0.22)):
        spread = learned[name]
        assert 0.8 * true < spread.value < spread.before, spread
        assert spread.pumps >= 25


def test_a_worn_pump_and_a_new_one_do_not_count() -> None:
    for h, n in ((history(3, 40, FAULTS["worn"]), 40), (history(3, 12), 12)):
        fold = Fold(PUMP, CIRCUIT, effective({}))
        observations = list(h.observations)
        assert len(list(fold.continued(observations, roles_of([outline_of(o) for o in observations]), h))) == n
        assert posterior_of(fold) is None
