"""Means and their standard errors: coverage on correlated noise, robustness against spikes and gaps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from detectors.reduction.statistics import block_means, correlation_time, mean_with_error, without_spikes


def ar1(rng: np.random.Generator, n: int, phi: float) -> np.ndarray:
    """Unit-variance AR(1) noise: its integrated correlation time is (1 + phi) / (1 - phi)."""
    out = np.empty(n)
    out[0] = rng.normal()
    steps = rng.normal(size=n) * np.sqrt(1 - phi**2)
    for i in range(1, n):
        out[i] = phi * out[i - 1] + steps[i]
    return out


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9])
def test_standard_error_covers_the_truth(phi: float) -> None:
    rng = np.random.default_rng(3)
    n_trials, n = 400, 400
    inside = 0
    for _ in range(n_trials):
        mean = mean_with_error(5.0 + ar1(rng, n, phi))
        assert mean is not None
        inside += abs(mean.mean - 5.0) < 1.96 * mean.standard_error
    # 95 % nominal; the binomial spread of 400 trials is 1.1 %, short correlated stretches cost a few more
    assert inside / n_trials == pytest.approx(0.95, abs=0.05)


def test_correlation_time_of_ar1() -> None:
    rng = np.random.default_rng(4)
    assert correlation_time(ar1(rng, 100_000, 0.8)) == pytest.approx(1.8 / 0.2, rel=0.1)
    assert correlation_time(rng.normal(size=100_000)) == pytest.approx(1.0, rel=0.05)


@given(
    scale=st.floats(1e-3, 1e3),
    shift=st.floats(-1e3, 1e3),
)
def test_mean_follows_units(scale: float, shift: float) -> None:
    samples = np.random.default_rng(1).normal(size=200)
    one, other = mean_with_error(samples), mean_with_error(scale * samples + shift)
    assert one is not None
    assert other is not None
    assert other.mean == pytest.approx(scale * one.mean + shift, rel=1e-6, abs=1e-6 * scale)
    assert other.standard_error == pytest.approx(scale * one.standard_error, rel=1e-4)


def test_spikes_and_gaps_cost_nothing() -> None:
    samples = np.random.default_rng(2).normal(1.0, 0.01, 300)
    clean = mean_with_error(samples)
    dirty = samples.copy()
    dirty[[10, 100, 200]] = (170.0, -5.0, np.inf)
    dirty[50:70] = np.nan
    spoiled = mean_with_error(dirty)
    assert clean is not None
    assert spoiled is not None
    assert spoiled.mean == pytest.approx(clean.mean, abs=0.002)
    assert spoiled.standard_error < 2.0 * clean.standard_error


def test_nothing_gives_nothing() -> None:
    assert mean_with_error(np.array([])) is None
    assert mean_with_error(np.full(5, np.nan)) is None


def test_a_constant_quantised_channel_keeps_an_honest_error() -> None:
    mean = mean_with_error(np.full(100, 0.5), smallest_sigma=0.1)
    assert mean is not None
    assert mean.standard_error == pytest.approx(0.1 / np.sqrt(1200))


def test_spikes_are_judged_by_the_median() -> None:
    samples = np.array([1.0, 1.1, 0.9, 1.05, 0.95, 50.0])
    assert np.isnan(without_spikes(samples)[-1])
    assert np.isfinite(without_spikes(samples)[:-1]).all()


def test_block_means_keep_gaps_empty() -> None:
    time = np.array([0.0, 0.5, 1.0, 1.5, 4.0, 4.5])
    start, mean = block_means(time, np.array([1.0, 3.0, 5.0, np.nan, 7.0, 9.0]), 1.0)
    assert start == pytest.approx([0, 1, 2, 3, 4])
    assert mean == pytest.approx([2, 5, np.nan, np.nan, 8], nan_ok=True)
