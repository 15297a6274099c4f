"""Forecasts on simulated truth: coverage, honesty, units; the passage law against its own closed form."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import invgauss

from detectors.prognosis.passage import Forecast, LevelEstimate, NoForecast, _crossed, _Filters, _passage, forecast

LIMIT = 1.5


def estimates(
    rng: np.random.Generator, hours: np.ndarray, level: Callable[[np.ndarray], np.ndarray], noise: float
) -> list[LevelEstimate]:
    values = level(hours) + noise * rng.normal(size=len(hours))
    return [LevelEstimate(float(t), float(v), noise) for t, v in zip(hours, values, strict=True)]


def linear(life: float, base: float = 0.6) -> Callable[[np.ndarray], np.ndarray]:
    return lambda t: base + (LIMIT - base) * t / life


def accelerating(life: float, growth: float, base: float = 0.6) -> Callable[[np.ndarray], np.ndarray]:
    return lambda t: base + (LIMIT - base) * np.expm1(growth * t / life) / np.expm1(growth)


def covered(kind: str, n_tracks: int) -> list[bool]:
    """Whether the central 80 % held the truth, of every track that was forecast."""
    rng = np.random.default_rng(7)
    inside = []
    for _ in range(n_tracks):
        life, base = rng.uniform(600.0, 2500.0), rng.uniform(0.3, 1.0)
        law = accelerating(life, rng.uniform(1.5, 3.5), base) if kind == "accelerating" else linear(life, base)
        hours = np.sort(rng.uniform(0.0, life * rng.uniform(0.4, 0.8), rng.integers(40, 120)))
        found = forecast(estimates(rng, hours, law, 0.15 if kind == "noisy" else 0.04), LIMIT)
        if isinstance(found, Forecast):
            inside.append(found.quantile(0.1) <= life - hours[-1] <= found.quantile(0.9))
    return inside


@pytest.mark.study
@pytest.mark.parametrize("kind", ["linear", "accelerating", "noisy"])
def test_intervals_cover_as_they_say(kind: str) -> None:
    inside = covered(kind, 100)
    # nominal 80 %; the three worlds differ from the priors on either side, 100 tracks spread by 4 %
    assert len(inside) >= 85
    assert 0.68 <= np.mean(inside) <= 0.97


def test_intervals_of_a_few_tracks_cover_as_they_say() -> None:
    inside = covered("linear", 25)
    # nominal 80 %: 25 tracks spread by 8 %
    assert len(inside) >= 20
    assert 0.6 <= np.mean(inside) <= 1.0


def test_the_passage_law_is_the_inverse_gaussian() -> None:
    way, pace, variance = 2.0, 0.01, 0.004
    mean, shape = way / pace, way**2 / variance
    for hours in (50.0, 150.0, 200.0, 400.0):
        expected = invgauss.cdf(hours, mean / shape, scale=shape)
        found = _crossed(np.array([way]), np.array([pace]), np.array([variance]), hours)
        assert found[0] == pytest.approx(expected, rel=1e-9)


def known(level: tuple[float, float], drift: tuple[float, float], growth: float, diffusion: float) -> Forecast:
    """Forecast from one filter whose level and drift are known with these means and one-sigma errors."""
    one = np.ones(1)
    filters = _Filters(
        growth=growth * one,
        level_diffusion=diffusion * one,
        drift_diffusion=0.0 * one,
        noise=one,
        drifts=one > 0.0,
        prior=one,
        drift_sd=one,
        level=level[0] * one,
        drift=drift[0] * one,
        p_ll=level[1] ** 2 * one,
        p_ld=0.0 * one,
        p_dd=drift[1] ** 2 * one,
        log_evidence=0.0 * one,
    )
    found = _passage(filters, one, LIMIT, 2000.0)
    assert isinstance(found, Forecast)
    return found


@pytest.mark.parametrize("within", [20.0, 50.0, 120.0, 300.0])
def test_the_chance_of_crossing_is_the_mixture_of_passage_laws(within: float) -> None:
    """Quadrature of the inverse Gaussian over level and drift."""
    found = known((1.4, 0.02), (8e-4, 2e-4), 0.0, 5e-6)
    z, weight = np.polynomial.hermite_e.hermegauss(60)
    weight /= weight.sum()
    way, pace = LIMIT - (1.4 + 0.02 * z[:, None]), 8e-4 + 2e-4 * z[None, :]
    both = weight[:, None] * weight[None, :] * (pace > 0.0)
    mean, shape = np.maximum(way, 1e-9) / np.maximum(pace, 1e-9), np.maximum(way, 1e-9) ** 2 / 5e-6
    chance = np.where(way <= 0.0, 1.0, invgauss.cdf(within, mean / shape, scale=shape))
    expected = float((both * chance).sum() / both.sum())
    # 2000 draws know a probability to one per cent
    assert found.probability_within(within) == pytest.approx(expected, abs=0.02)


def test_the_chance_of_crossing_is_that_of_simulated_lives() -> None:
    """Lives whose pace grows: each crosses when what it has gained covers the way."""
    found = known((1.3, 0.03), (1e-3, 2e-4), 4e-3, 0.0)
    rng = np.random.default_rng(8)
    level, drift = 1.3 + 0.03 * rng.normal(size=200_000), 1e-3 + 2e-4 * rng.normal(size=200_000)
    for within in (50.0, 150.0, 250.0):
        gained = np.maximum(drift, 0.0) * np.expm1(4e-3 * within) / 4e-3
        assert found.probability_within(within) == pytest.approx(float(np.mean(level + gained >= LIMIT)), abs=0.02)


def test_the_chance_of_crossing_undoes_the_quantile() -> None:
    found = known((1.3, 0.03), (1e-3, 2e-4), 0.0, 1e-6)
    for share in (0.05, 0.5, 0.95):
        assert found.probability_within(found.quantile(share)) == pytest.approx(share, abs=1e-9)
    assert found.probability_within(0.0) == found.probability[0]
    for hours in (-1.0, math.inf, math.nan):
        with pytest.raises(ValueError, match="must be finite and not below 0"):
            found.probability_within(hours)


def test_a_clean_line_is_forecast_to_the_hour() -> None:
    hours = np.linspace(0.0, 500.0, 60)
    found = forecast(estimates(np.random.default_rng(1), hours, linear(1000.0), 0.005), LIMIT)
    assert isinstance(found, Forecast)
    assert found.low < 500.0 < found.high
    assert found.mean == pytest.approx(500.0, rel=0.1)
    assert found.quantile(0.05) == found.low
    assert (np.diff(found.probability) >= 0.0).all()


def test_units_and_order_do_not_matter() -> None:
    hours = np.linspace(0.0, 500.0, 40)
    track = estimates(np.random.default_rng(2), hours, linear(1000.0), 0.02)
    plain = forecast(track, LIMIT)
    assert forecast(track[::-1], LIMIT) is not None
    scaled = [
        LevelEstimate(60.0 * e.flight_hours, 1000.0 * e.mean, 1000.0 * e.standard_deviation)  # type: ignore[operator]
        for e in reversed(track)
    ]
    other = forecast(scaled, 1000.0 * LIMIT, typical_life_hours=60.0 * 2000.0)
    assert isinstance(plain, Forecast)
    assert isinstance(other, Forecast)
    assert (other.mean, other.low, other.high) == pytest.approx(
        (60.0 * plain.mean, 60.0 * plain.low, 60.0 * plain.high), rel=1e-6
    )


def test_one_outlier_changes_little() -> None:
    track = estimates(np.random.default_rng(3), np.linspace(0.0, 500.0, 60), linear(1000.0), 0.02)
    plain = forecast(track, LIMIT)
    spoiled = forecast([*track[:30], LevelEstimate(track[30].flight_hours, 5.0, 0.02), *track[31:]], LIMIT)
    assert isinstance(plain, Forecast)
    assert isinstance(spoiled, Forecast)
    assert spoiled.mean == pytest.approx(plain.mean, rel=0.25)


def flat(n: int, level: float = 0.6) -> list[LevelEstimate]:
    return estimates(np.random.default_rng(4), np.linspace(0.0, 500.0, n), lambda t: np.full(len(t), level), 0.03)


@pytest.mark.parametrize(
    ("track", "words"),
    [
        (flat(60), "no growth is evident"),
        (flat(5), "5 records have an estimate; at least 8"),
        (flat(20, 1.8), "already above the limit"),
        ([LevelEstimate(None, 0.6, 0.03)] * 20, "flight hours are missing for 20 of 20"),
        ([LevelEstimate(100.0, 0.6, 0.03)] * 20, "same flight hours"),
        ([LevelEstimate(float(t), math.nan, math.nan) for t in range(20)], "0 records have an estimate"),
    ],
)
def test_without_grounds_there_is_no_forecast(track: list[LevelEstimate], words: str) -> None:
    found = forecast(track, LIMIT)
    assert isinstance(found, NoForecast)
    assert words in found.reason


def test_healthy_pumps_rarely_get_a_forecast() -> None:
    rng = np.random.default_rng(5)
    given = 0
    for _ in range(40):
        track = estimates(rng, np.linspace(0.0, 800.0, 60), lambda t: np.full(len(t), 0.6), 0.05)
        given += isinstance(forecast(track, LIMIT), Forecast)
    assert given <= 2


def test_bad_numbers_are_all_named() -> None:
    with pytest.raises(ValueError, match=r"limit is not a number; typical_life_hours is 0; .*standard_deviation of 2"):
        forecast([LevelEstimate(1.0, 1.0, 0.0), LevelEstimate(1.0, 1.0, -1.0)], math.nan, typical_life_hours=0.0)
    found = forecast(estimates(np.random.default_rng(6), np.linspace(0, 500, 40), linear(1000.0), 0.02), LIMIT)
    assert isinstance(found, Forecast)
    with pytest.raises(ValueError, match="share is 1"):
        found.quantile(1.0)
