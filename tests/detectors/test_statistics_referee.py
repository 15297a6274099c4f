"""Means and their errors against their definitions written as loops, on any samples."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from detectors.reduction.statistics import block_means, correlation_time, mean_with_error, without_spikes

quantised = st.integers(-40, 40).map(lambda k: 0.25 * k)
"""Coarse samples: ties, constant stretches and whole zeros come up often."""
smooth = st.floats(-50.0, 50.0).map(lambda x: round(x, 3))
broken = st.sampled_from([math.nan, math.inf, -math.inf, 1.0e4, -1.0e4])
samples = st.lists(quantised | smooth | broken, max_size=60)
noise = st.tuples(st.integers(0, 10_000), st.integers(2, 80), st.floats(0.0, 0.98))
floors = st.sampled_from([0.0, 0.01, 0.5])
quick = settings(max_examples=150, deadline=None, derandomize=True, database=None)


def wandering(seed: int, n: int, memory: float) -> list[float]:
    rng = np.random.default_rng(seed)
    found = [0.0]
    for _ in range(n - 1):
        found.append(memory * found[-1] + float(rng.normal()))
    return found


def median(values: list[float]) -> float:
    ordered, n = sorted(values), len(values)
    return ordered[n // 2] if n % 2 else 0.5 * (ordered[n // 2 - 1] + ordered[n // 2])


def plain_without_spikes(values: list[float], smallest: float) -> list[float]:
    known = [v for v in values if math.isfinite(v)]
    if len(known) < 3:
        return [v if math.isfinite(v) else math.nan for v in values]
    middle = median(known)
    # the median absolute deviation of a normal distribution is its 75 % point, 0.6745 sigma
    sigma = max(1.4826 * median([abs(v - middle) for v in known]), smallest, 1e-12)
    return [v if math.isfinite(v) and abs(v - middle) <= 6.0 * sigma else math.nan for v in values]


def plain_correlation_time(values: list[float]) -> float:
    """Geyer 1992, section 3.3: twice the sum of the first positive pairs of autocorrelations, less one."""
    n = len(values)
    mean = math.fsum(values) / n
    covariance = [math.fsum((values[i] - mean) * (values[i + k] - mean) for i in range(n - k)) / n for k in range(n)]
    if n < 4 or covariance[0] <= 0.0:
        return 1.0
    total = 0.0
    for k in range(0, 2 * (n // 2), 2):
        pair = covariance[k] + covariance[k + 1]
        if pair <= 0.0:
            break
        total += pair
    return max(1.0, 2.0 * total / covariance[0] - 1.0)


@quick
@given(samples, floors)
def test_spikes(values: list[float], smallest: float) -> None:
    found = without_spikes(np.array(values, dtype=float), smallest)
    assert found == pytest.approx(plain_without_spikes(values, smallest), rel=0.0, abs=0.0, nan_ok=True)


@quick
@given(noise)
def test_correlation_time(drawn: tuple[int, int, float]) -> None:
    values = wandering(*drawn)
    assert correlation_time(np.array(values)) == pytest.approx(plain_correlation_time(values), rel=1e-9)


@quick
@given(noise, floors, st.lists(st.tuples(st.integers(0, 79), broken), max_size=6))
def test_mean_and_error(drawn: tuple[int, int, float], smallest: float, faults: list[tuple[int, float]]) -> None:
    values = wandering(*drawn)
    for place, fault in faults:
        values[place % len(values)] = fault
    found = mean_with_error(np.array(values), smallest)
    known = [v for v in plain_without_spikes(values, smallest) if math.isfinite(v)]
    n = len(known)
    if n == 0:
        assert found is None
        return
    assert found is not None
    mean = math.fsum(known) / n
    assert found.mean == pytest.approx(mean, rel=1e-12, abs=1e-12)
    if n == 1:
        assert found.standard_error == smallest
        return
    tau = plain_correlation_time(known)
    # expected square deviation from the own mean is sigma^2 (1 - tau / n); two samples at least are independent
    variance = math.fsum((v - mean) ** 2 for v in known) / n / max(1.0 - tau / n, 0.5 / (n - 1))
    error = max(math.sqrt(variance * min(tau / n, 1.0)), smallest / math.sqrt(12.0 * n))
    assert found.standard_error == pytest.approx(error, rel=1e-9, abs=1e-12)


@quick
@given(st.lists(st.tuples(st.integers(1, 30), quantised | st.just(math.nan)), min_size=1, max_size=50))
def test_block_means(steps: list[tuple[int, float]]) -> None:
    """Instants in tenths of a second, blocks of one second from the first on; a gap leaves blocks empty."""
    tenths = np.cumsum([step for step, _ in steps])
    values = [value for _, value in steps]
    start, mean = block_means(tenths / 10.0, np.array(values), 1.0)
    n_blocks = (tenths[-1] - tenths[0]) // 10 + 1
    expected = []
    for block in range(n_blocks):
        inside = [v for t, v in zip(tenths - tenths[0], values, strict=True) if t // 10 == block and not math.isnan(v)]
        expected.append(math.fsum(inside) / len(inside) if inside else math.nan)
    assert start == pytest.approx(tenths[0] / 10.0 + np.arange(n_blocks))
    assert mean == pytest.approx(expected, nan_ok=True)
