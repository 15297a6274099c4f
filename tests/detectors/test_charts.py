"""One suite for all charts: false alarms as wanted, delay near Lorden's bound, invariances, restart, gaps."""

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from benchmarks.charts import (
    Chart,
    Cusum,
    EvidenceChart,
    Ewma,
    Glr,
    LevelChart,
    Shape,
    Side,
    Standardised,
    calibrated_threshold,
    cusum_arl,
    cusum_threshold,
    ewma_arl,
    ewma_threshold,
    glr_arl,
    glr_threshold,
    independent_normal,
    run,
    siegmund_arl,
)
from detectors.evaluation.delays import evidence_threshold

# only benchmarks use these charts
pytestmark = pytest.mark.study

ARL = 500.0
SHIFT = 1.0
STEP_AND_RAMP = (Shape.STEP, Shape.RAMP)


class LogRatio:
    """A chart of log likelihood ratios fed with standardised values: the ratio for a step of ``SHIFT``."""

    def __init__(self, threshold: float) -> None:
        self.chart = EvidenceChart(threshold)
        self.threshold = threshold

    def start(self, shape: tuple[int, ...] = ()) -> Any:
        return self.chart.start(shape)

    def update(self, state: Any, x: Any) -> tuple[Any, Any]:
        return self.chart.update(state, SHIFT * np.asarray(x) - 0.5 * SHIFT**2)


CHARTS: dict[str, Callable[[], Chart[Any]]] = {
    "CUSUM two-sided": lambda: Cusum(0.5 * SHIFT, cusum_threshold(0.5 * SHIFT, ARL)),
    "CUSUM upper": lambda: Cusum(0.5 * SHIFT, cusum_threshold(0.5 * SHIFT, ARL, Side.UPPER), Side.UPPER),
    "EWMA": lambda: Ewma(0.1, ewma_threshold(0.1, ARL)),
    "GLR step": lambda: Glr(40, glr_threshold(40, ARL).threshold),
    "GLR step or ramp, upper": lambda: Glr(
        40, glr_threshold(40, ARL, STEP_AND_RAMP, Side.UPPER).threshold, STEP_AND_RAMP, Side.UPPER
    ),
    "log evidence": lambda: LogRatio(
        calibrated_threshold(LogRatio(1.0), ARL, independent_normal, seed=5, n_sequences=1000).threshold
    ),
}


@pytest.fixture(scope="module", params=CHARTS)
def chart(request: pytest.FixtureRequest) -> Chart[Any]:
    return CHARTS[request.param]()


def run_lengths(chart: Chart[Any], values: Iterator[np.ndarray], n_paths: int, n_steps: int) -> np.ndarray:
    """Step of the first alarm of each sequence; the end where there was none."""
    state, found = chart.start((n_paths,)), np.full(n_paths, n_steps)
    for step in range(1, n_steps + 1):
        state, statistic = chart.update(state, next(values))
        found = np.where((statistic >= chart.threshold) & (found == n_steps), step, found)
    return found


def test_false_alarms_come_as_rarely_as_wanted(chart: Chart[Any]) -> None:
    rng = np.random.default_rng(11)
    lengths = run_lengths(chart, independent_normal(rng, 1500), 1500, 4000)
    # censored geometric run lengths: records over alarms; 1500 sequences give 2.6 %, calibrations 3 % more
    arl = lengths.sum() / (lengths < 4000).sum()
    assert arl == pytest.approx(ARL, rel=0.12)


def test_delay_is_near_the_bound(chart: Chart[Any]) -> None:
    rng = np.random.default_rng(12)
    lengths = run_lengths(chart, (x + SHIFT for x in independent_normal(rng, 1000)), 1000, 400)
    # Lorden (1971): log ARL / KL is the least mean delay to first order; KL of a step of one sd is 1/2 nat
    bound = math.log(ARL) / (0.5 * SHIFT**2)
    assert lengths.mean() < 1.5 * bound + 5.0
    assert lengths.mean() > 0.5 * bound


def test_gaps_change_nothing(chart: Chart[Any]) -> None:
    x = np.random.default_rng(13).normal(size=200)
    full = run(chart, x)
    with_gaps = np.insert(x, [0, 50, 50, 120], np.nan)
    known = np.isfinite(with_gaps)
    assert run(chart, with_gaps)[known] == pytest.approx(full)
    assert np.isfinite(run(chart, with_gaps)).all()


def test_the_future_is_not_read_and_states_are_values(chart: Chart[Any]) -> None:
    x = np.random.default_rng(14).normal(size=100)
    other = x.copy()
    other[60:] += 5.0
    assert (run(chart, x)[:60] == run(chart, other)[:60]).all()
    state = chart.start()
    for value in x[:60]:
        state, _ = chart.update(state, value)
    first = [chart.update(state, value)[1] for value in other[60:]]
    again = state
    unbroken = []
    for value in x[60:]:
        again, statistic = chart.update(again, value)
        unbroken.append(statistic)
    assert unbroken == pytest.approx(run(chart, x)[60:])
    assert first[0] == pytest.approx(run(chart, other)[60])


def test_charts_do_not_reset_themselves(chart: Chart[Any]) -> None:
    statistic = run(chart, np.full(60, 3.0))
    alarm = int(np.argmax(statistic >= chart.threshold))
    assert (statistic[alarm:] >= chart.threshold).all()


def test_side_by_side_is_one_by_one(chart: Chart[Any]) -> None:
    x = np.random.default_rng(15).normal(size=(80, 3))
    x[10:20, 1] = np.nan
    together = run(chart, x)
    assert together == pytest.approx(np.stack([run(chart, x[:, j]) for j in range(3)], axis=1))


def test_units_and_zero_do_not_matter(chart: Chart[Any]) -> None:
    x = np.random.default_rng(16).normal(size=100)
    plain = run(Standardised(chart, 0.0, 1.0, 0.4), x)
    assert run(Standardised(chart, 190.0, 0.03, 0.4), 190.0 + 0.03 * x) == pytest.approx(plain, abs=1e-6)


@pytest.mark.parametrize(
    ("up", "down"),
    [
        (Cusum(0.5, 4.0, Side.UPPER), Cusum(0.5, 4.0, Side.LOWER)),
        (Glr(20, 6.0, STEP_AND_RAMP, Side.UPPER), Glr(20, 6.0, STEP_AND_RAMP, Side.LOWER)),
        (Cusum(0.5, 4.0), Cusum(0.5, 4.0)),
        (Ewma(0.2, 3.0), Ewma(0.2, 3.0)),
        (Glr(20, 6.0), Glr(20, 6.0)),
    ],
)
def test_a_mirrored_sequence_mirrors_the_chart(up: Chart[Any], down: Chart[Any]) -> None:
    x = np.random.default_rng(17).normal(size=100)
    assert run(up, x) == pytest.approx(run(down, -x))


# Montgomery, Introduction to Statistical Quality Control, tables 9.3 and 9.4: two-sided CUSUM, k = 1/2
@pytest.mark.parametrize(
    ("threshold", "shift", "arl", "tolerance"),
    [
        (4.0, 0.0, 168.0, 0.5),
        (4.0, 1.0, 8.38, 0.006),
        (4.0, 2.0, 3.34, 0.006),
        (5.0, 0.0, 465.0, 0.6),
        (5.0, 1.0, 10.4, 0.06),
        (4.77, 0.0, 370.0, 2.0),
    ],
)
def test_cusum_run_lengths_are_the_published(threshold: float, shift: float, arl: float, tolerance: float) -> None:
    assert cusum_arl(0.5, threshold, shift=shift) == pytest.approx(arl, abs=tolerance)


def test_siegmund_agrees_with_the_chain() -> None:
    # Montgomery section 9.1: within a few percent for such charts
    assert siegmund_arl(0.5, 5.0) == pytest.approx(cusum_arl(0.5, 5.0, Side.UPPER), rel=0.03)
    assert siegmund_arl(0.5, 5.0, 0.5) == pytest.approx(cusum_arl(0.5, 5.0, Side.UPPER, 0.5), rel=0.03)


# Lucas and Saccucci (1990), table 3: EWMA, all with ARL0 500
@pytest.mark.parametrize(
    ("weight", "limit", "arl_1"),
    [(0.40, 3.054, 14.3), (0.25, 2.998, 11.1), (0.20, 2.962, 10.5), (0.10, 2.814, 10.3), (0.05, 2.615, 11.4)],
)
def test_ewma_run_lengths_are_the_published(weight: float, limit: float, arl_1: float) -> None:
    assert ewma_arl(weight, limit) == pytest.approx(500.0, rel=0.003)
    assert ewma_arl(weight, limit, 1.0) == pytest.approx(arl_1, abs=0.06)
    assert ewma_threshold(weight, 500.0) == pytest.approx(limit, abs=0.001)


def test_an_ewma_of_the_newest_value_alone_is_a_shewhart_chart() -> None:
    # three sigma: 1 / 0.0027 = 370.4
    assert ewma_arl(1.0, 3.0) == pytest.approx(370.4, abs=0.1)


def test_importance_sampling_agrees_with_plain_simulation() -> None:
    plain = calibrated_threshold(
        Glr(20, 1.0, STEP_AND_RAMP, Side.LOWER), 1000.0, independent_normal, seed=3, n_sequences=600
    )
    arl, error = glr_arl(Glr(20, plain.threshold, STEP_AND_RAMP, Side.LOWER))
    assert abs(math.log(arl / 1000.0)) < 3.0 * math.hypot(error, plain.log_arl_standard_error)


def test_a_shorter_window_of_one_record_has_a_known_rate() -> None:
    # one record, step, two-sided: |x| > sqrt(2 h), here three sigma
    arl, error = glr_arl(Glr(1, 4.5), n_paths=20_000)
    assert abs(math.log(arl / 370.4)) < 4.0 * error
    assert error < 0.03


def test_whitening_keeps_the_false_alarm_rate() -> None:
    phi = 0.7

    def correlated(rng: np.random.Generator, m: int) -> Iterator[np.ndarray]:
        x = rng.standard_normal(m)
        while True:
            yield x
            x = phi * x + math.sqrt(1 - phi**2) * rng.standard_normal(m)

    plain = Cusum(0.5, cusum_threshold(0.5, ARL))
    rng = np.random.default_rng(18)
    white = run_lengths(Standardised(plain, 0.0, 1.0, phi), correlated(rng, 1000), 1000, 4000)
    assert white.sum() / (white < 4000).sum() == pytest.approx(ARL, rel=0.12)
    raw = run_lengths(plain, correlated(rng, 300), 300, 2000)
    assert raw.mean() < 0.2 * ARL


def test_whitening_spans_gaps() -> None:
    seen = Standardised(EvidenceChart(1e9), 0.0, 1.0, 0.5)
    statistic = run(seen, [2.0, np.nan, np.nan, 1.0])
    # after three records 1/8 of the last value is expected: the sum of both innovations
    innovation = (1.0 - 0.125 * 2.0) / math.sqrt(1.0 - 0.125**2)
    assert statistic == pytest.approx([2.0, 2.0, 2.0, 2.0 + innovation])


def test_the_bound_for_true_evidence_holds() -> None:
    threshold = evidence_threshold(100.0)
    rng = np.random.default_rng(19)
    lengths = run_lengths(LogRatio(threshold), independent_normal(rng, 500), 500, 3000)
    assert lengths.mean() > 100.0


def test_a_level_must_hold_for_its_records() -> None:
    chart = LevelChart(4.0, 3)
    levels = [5.0, 5.0, 3.0, 5.0, np.nan, 6.0, 4.5, 7.0]
    alarmed = run(chart, levels) >= chart.threshold
    assert alarmed.tolist() == [False, False, False, False, False, False, True, True]


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: Cusum(-1.0, 0.0), ("reference", "threshold")),
        (lambda: Ewma(0.0, -1.0), ("weight", "threshold")),
        (lambda: Glr(0, -1.0, ()), ("window", "threshold", "shapes")),
        (lambda: Standardised(Cusum(0.5, 4.0), math.nan, 0.0, 1.0), ("mean", "standard_deviation", "autocorrelation")),
        (lambda: LevelChart(1.0, 0), ("n_records",)),
        (lambda: cusum_threshold(0.5, 1.0), ("arl",)),
        (lambda: ewma_threshold(0.1, 0.5), ("arl",)),
        (lambda: glr_threshold(40, 100.0), ("arl",)),
        (lambda: evidence_threshold(1.0), ("arl",)),
        (lambda: calibrated_threshold(Cusum(0.5, 1.0), 1.0, independent_normal, seed=1, n_sequences=2, horizon=0.1),
         ("arl", "n_sequences", "horizon")),
    ],
)  # fmt: skip
def test_bad_numbers_are_all_named(make: Callable[[], object], named: tuple[str, ...]) -> None:
    with pytest.raises(ValueError, match=".*".join(named)):
        make()
