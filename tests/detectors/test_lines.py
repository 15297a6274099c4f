"""Scatter of a pump's line at once per revolution: von Neumann's differences against what it was drawn with."""

import numpy as np
import pytest

from detectors.bank.lines import LineScatter


def learnt(lines: np.ndarray, error: float = 0.0) -> LineScatter:
    scatter = LineScatter()
    for line in lines:
        scatter = scatter.with_line(float(line), error**2)
    return scatter


def test_before_a_second_burst_it_is_the_type_s() -> None:
    """Half of what figure 3-3 of the thesis leaves open: 3 mbar."""
    assert LineScatter().variance == pytest.approx(0.003**2)
    assert learnt(np.array([0.05])).variance == pytest.approx(0.003**2)


@pytest.mark.parametrize("sd", [0.002, 0.005, 0.01])
def test_many_bursts_show_the_pump_s_own(sd: float) -> None:
    """Differences of white scatter have twice its variance; cut at three of their spreads they lose a little."""
    lines = 0.05 + sd * np.random.default_rng(1).standard_normal(600)
    assert np.sqrt(learnt(lines).variance) == pytest.approx(sd, rel=0.08)


def test_the_error_of_the_measurement_is_taken_out() -> None:
    rng = np.random.default_rng(2)
    lines = 0.05 + 0.006 * rng.standard_normal(800) + 0.003 * rng.standard_normal(800)
    found = np.sqrt(learnt(lines, 0.003).variance)
    assert found == pytest.approx(0.006, rel=0.15)
    assert found < np.sqrt(learnt(lines).variance)


def test_growth_is_no_scatter() -> None:
    """A line that grows from 30 to 280 mbar within a hundred flights, as uneven wear draws it."""
    noise = 0.004 * np.random.default_rng(3).standard_normal(100)
    steady, growing = learnt(0.03 + noise), learnt(np.linspace(0.03, 0.28, 100) + noise)
    assert np.sqrt(growing.variance) == pytest.approx(np.sqrt(steady.variance), rel=0.15)


def test_a_step_counts_as_what_scatter_could_make() -> None:
    """One jump of 200 mbar among a hundred bursts would make 14 mbar of it: it is cut to three spreads."""
    lines = 0.05 + 0.004 * np.random.default_rng(4).standard_normal(100)
    stepped = lines + 0.2 * (np.arange(100) >= 50)
    assert np.sqrt(learnt(stepped).variance) == pytest.approx(np.sqrt(learnt(lines).variance), rel=0.1)


def test_no_pump_repeats_better_than_the_converter() -> None:
    assert np.sqrt(learnt(np.full(10_000, 0.05)).variance) == pytest.approx(0.001)
