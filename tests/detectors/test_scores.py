"""Scores against published values and simulated truth."""

import math

import numpy as np
import pytest

from detectors.evaluation.scores import (
    alpha_lambda,
    bootstrap,
    calibration_error,
    continuous_ranked_probability_score,
    detection_delay,
    episodes,
    interval_coverage,
    proportion,
    roc,
    time_between_false_alarms,
)


def test_wilson_is_the_published() -> None:
    # Newcombe (1998), Statistics in Medicine 17, 857, table I, method 3: 81/263, 15/148, 0/20, 1/29
    for successes, trials, low, high in (
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ):
        found = proportion(successes, trials)
        assert (found.low, found.high) == pytest.approx((low, high), abs=5e-5)
    assert proportion(5, 5).high == 1.0
    assert (proportion(0, 0).low, proportion(0, 0).high) == (0.0, 1.0)
    with pytest.raises(ValueError, match="impossible"):
        proportion(3, 2)


def test_bootstrap_covers_a_mean() -> None:
    rng = np.random.default_rng(1)
    covered = 0
    for seed in range(200):
        found = bootstrap(lambda v: float(v.mean()), rng.normal(3.0, 1.0, 40), seed=seed, n_draws=300)
        covered += found.low <= 3.0 <= found.high
    # percentile intervals of 40 values cover a little less than the nominal 95 %
    assert 0.88 <= covered / 200 <= 0.98
    with pytest.raises(ValueError, match="missing"):
        bootstrap(lambda v: float(v.mean()), [], seed=1)


def test_roc_of_normals_has_the_known_area() -> None:
    rng = np.random.default_rng(2)
    # binormal: area = Phi(d / sqrt 2) = 0.7602 for d = 1
    found = roc(rng.normal(0, 1, 20_000), rng.normal(1, 1, 20_000))
    assert found.area == pytest.approx(0.7602, abs=0.008)
    assert (np.diff(found.false_alarm_rate) >= 0).all()
    assert (np.diff(found.detection_rate) >= 0).all()
    assert roc([1.0, 1.0], [1.0, 1.0]).area == 0.5
    assert roc([0.0, 1.0], [2.0, 3.0]).area == 1.0


def test_calibration_error() -> None:
    rng = np.random.default_rng(3)
    p = rng.uniform(size=50_000)
    assert calibration_error(p, rng.uniform(size=50_000) < p) < 0.015
    # always 0.9 where 0.6 happen
    assert calibration_error(np.full(1000, 0.9), np.arange(1000) < 600) == pytest.approx(0.3)
    with pytest.raises(ValueError, match="between 0 and 1"):
        calibration_error([1.2], [1.0])


def test_episodes_and_delay() -> None:
    alarmed = [0, 1, 1, 0, 1, 0, 0, 0, 1, 1]
    assert episodes(alarmed) == [(1, 2), (4, 4), (8, 9)]
    assert episodes(alarmed, quiet_records=2) == [(1, 4), (8, 9)]
    assert detection_delay(alarmed, 5) == 3
    assert detection_delay(alarmed, 2) == 2
    # an episode that runs over the onset is the earlier false alarm
    assert detection_delay([0, 1, 1, 1], 2) is None


def test_false_alarms_have_the_exact_poisson_interval() -> None:
    # Garwood (1936): 0 events at most 3.689, 10 events 4.795 to 18.390, two-sided 95 %
    none, ten = time_between_false_alarms(0, 1000.0), time_between_false_alarms(10, 1000.0)
    assert none.value == math.inf
    assert none.low == pytest.approx(1000 / 3.689, rel=1e-3)
    assert (ten.low, ten.high) == pytest.approx((1000 / 18.390, 1000 / 4.795), rel=1e-3)
    with pytest.raises(ValueError, match="impossible"):
        time_between_false_alarms(0, 0.0)


def test_coverage_counts_what_is_inside() -> None:
    assert interval_coverage([0, 0, 0, 0], [1, 1, 1, 1], [0.5, 1.0, 1.5, 0.0]).value == 0.75


def test_crps_of_a_normal_has_its_closed_form() -> None:
    samples = np.random.default_rng(4).normal(size=200_000)
    # Gneiting and Raftery (2007): sigma (2 phi(0) - 1 / sqrt pi) at the centre
    expected = 2 / math.sqrt(2 * math.pi) - 1 / math.sqrt(math.pi)
    assert continuous_ranked_probability_score(samples, 0.0) == pytest.approx(expected, abs=0.003)
    assert continuous_ranked_probability_score([2.0], 5.0) == 3.0


def test_alpha_lambda() -> None:
    assert alpha_lambda(110.0, 100.0)
    assert not alpha_lambda(121.0, 100.0)
    assert not alpha_lambda(math.nan, 100.0)
