"""Single steps of a filter bank against the textbook: prior, walk, passing time, one linear update, one density."""

import math

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from detectors.bank.bank import DIRECTIONS, Bank, Measurement
from detectors.bank.hypotheses import FAULT_KINDS, directions, log_hazards, prior, walk_variance
from detectors.bank.kernel import N_MEASURED, STUDENT_DEGREES, _cholesky, _whitened, advance, predicted, step
from detectors.bank.shapes import Filters, Walks
from detectors.expectation import components as c
from detectors.expectation.anchor import anchors
from detectors.expectation.components import AMPLITUDE, N_COMPONENTS, N_SLOW, N_STATE, PLACE, RATE, SETTING
from twin.condition import Condition
from twin.pumps import circuit_parameters, pump_type

PUMP = pump_type("h225")
ROW = anchors([Condition(4600.0, 55.0, 0.5)], PUMP, circuit_parameters("shared_return"))[0][0]


def test_a_new_pump_is_one_of_its_population() -> None:
    """Spreads of the pump type's parameter set, each in its own component's place."""
    _, spread = prior(PUMP)
    for component, quantity in (
        ("setting", "pressure_setting_bar"),
        ("ln_slipper", "pump_leakage_scale"),
        ("ln_laminar", "pump_leakage_scale"),
        ("ln_drain", "drain_resistance_scale"),
        ("case_offset", "case_zero_bar"),
    ):
        assert spread[PLACE[component]] == PUMP.population[quantity].value
    assert not spread[[AMPLITUDE, RATE]].any()


def test_the_case_zero_wanders_by_its_population_spread_over_a_hundred_flights() -> None:
    """A random walk grows with the root of its length: 0.06 bar over a hundred records are 0.006 in one."""
    variance = walk_variance()
    assert math.sqrt(100.0 * variance[PLACE["case_offset"]]) == pytest.approx(0.06)
    assert not variance[[AMPLITUDE, RATE]].any()


def test_faults_move_what_they_name_by_their_shares() -> None:
    table = directions()
    for row, kind in zip(table, FAULT_KINDS, strict=True):
        assert {c.COMPONENTS[i]: row[i] for i in np.flatnonzero(row)} == dict(kind.moves)


def test_what_never_sets_in_has_no_hazard() -> None:
    """One fault of a kind in a thousand; ``None`` is never, the rest are factors in nat."""
    table = log_hazards()
    for column, kind in enumerate(FAULT_KINDS):
        for row, likelier in enumerate((kind.sudden, kind.growing)):
            expected = 0.0 if likelier is None else 1e-3 * math.exp(likelier)
            assert math.exp(table[row, column]) == pytest.approx(expected, rel=1e-12)


def test_without_the_reservoir_sensor_its_pressure_goes_where_it_likes() -> None:
    """0.2 bar from flight to flight; and its sensor cannot be at fault."""
    bank = Bank(PUMP)
    place, fault = PLACE["reservoir"], [k.component for k in FAULT_KINDS].index("reservoir")
    assert bank._most_onsets()[:, fault].any()
    variance = bank.filters.covariance[: bank.n, place, place]
    before = variance.copy()
    bank._pass_time()
    assert (variance - before < 0.01**2).all()
    bank.reservoir_measured = False
    before = variance.copy()
    bank._pass_time()
    assert variance - before == pytest.approx(0.2**2, rel=1e-4)
    assert not bank._most_onsets()[:, fault].any()


def test_time_passes_as_in_the_textbook() -> None:
    """``m = F m`` and ``P = F P F' + Q`` with the amplitude growing by its rate (Bar-Shalom 2001, section 5.2)."""
    rng = np.random.default_rng(3)
    mean, root = rng.normal(size=(2, N_STATE)), rng.normal(size=(2, N_STATE, N_STATE))
    covariance = root @ root.transpose(0, 2, 1)
    covariance[1, RATE, :] = covariance[1, :, RATE] = 0.0  # the second does not grow
    mean[1, RATE] = 0.0
    walk = rng.uniform(0.0, 1.0, N_STATE)
    own = rng.uniform(0.0, 1.0, (3, 2))
    into = np.eye(N_STATE)
    into[AMPLITUDE, RATE] = 1.0
    expected_mean = mean @ into.T
    noise = np.array([np.diag(walk)] * 2)
    for f in range(2):
        for place, variance in zip((AMPLITUDE, RATE, SETTING), own[:, f], strict=True):
            noise[f, place, place] += variance
    expected = into @ covariance @ into.T + noise
    nothing, none = np.zeros(2), np.zeros(2, dtype=np.int64)
    filters = Filters(mean, covariance, none, none, none, nothing, nothing)
    advance(filters, 2, Walks(walk, own[0], own[1], own[2]))
    assert mean == pytest.approx(expected_mean)
    assert covariance == pytest.approx(expected)


def test_factor_and_density_are_those_of_a_normal_distribution() -> None:
    rng = np.random.default_rng(4)
    root = rng.normal(size=(N_MEASURED, N_MEASURED))
    matrix = root @ root.T + np.eye(N_MEASURED)
    factor, white, off = matrix.copy(), np.empty(N_MEASURED), rng.normal(size=N_MEASURED)
    assert _cholesky(factor, N_MEASURED)
    assert np.tril(factor) == pytest.approx(np.linalg.cholesky(matrix))
    distance, log_det = _whitened(factor, off, white, N_MEASURED)
    assert log_det == pytest.approx(np.linalg.slogdet(matrix)[1])
    log_density = -0.5 * (distance + log_det + N_MEASURED * math.log(2.0 * math.pi))
    assert log_density == pytest.approx(multivariate_normal(cov=matrix).logpdf(off))


def measured(mean: np.ndarray, off: np.ndarray, sd: np.ndarray) -> Measurement:
    """Both pressures and the zero, away from what the state says they are."""
    y, H = np.empty(N_MEASURED), np.empty((N_MEASURED, N_STATE + N_COMPONENTS - c.N_LIVING))
    full, slopes = np.empty(N_COMPONENTS), np.empty((3, N_COMPONENTS))
    predicted(mean, DIRECTIONS[-1], ROW, np.zeros((2, N_COMPONENTS)), full, slopes, y, H, N_MEASURED)
    values = y.copy()
    values[:3] += off
    noise = np.diag(np.concatenate((sd, np.ones(3))) ** 2)
    return Measurement(values, noise, np.arange(3), ROW, np.zeros((2, N_COMPONENTS)), True)


@pytest.mark.parametrize("sigmas", [0.3, 30.0])
def test_one_update_is_kalman_s_with_student_s_weight(sigmas: float) -> None:
    """Innovation, gain and covariance of the textbook; beyond the mean distance the noise grows (Roth 2013, eq. 11).

    The predictive density is Student's with 5 degrees of freedom, so that one outlier costs a bounded amount.
    """
    bank = Bank(PUMP)
    mean, P = bank.filters.mean[:1].copy(), bank.filters.covariance[:1].copy()
    m = measured(mean[0], np.array([0.4, 0.02, 0.01]) * sigmas, np.array([0.35, 0.02, 0.01]))
    y, H = np.empty(N_MEASURED), np.empty((N_MEASURED, N_STATE + N_COMPONENTS - c.N_LIVING))
    predicted(
        mean[0], DIRECTIONS[-1], ROW, m.ripple, np.empty(N_COMPONENTS), np.empty((3, N_COMPONENTS)), y, H, N_MEASURED
    )
    H = H[:3, :N_SLOW]
    before_mean, before = mean[0, :N_SLOW].copy(), P[0, :N_SLOW, :N_SLOW].copy()
    innovation, R = (m.values - y)[:3], m.noise[:3, :3]
    S = H @ before @ H.T + R
    distance = float(innovation @ np.linalg.solve(S, innovation))
    density = -0.5 * np.linalg.slogdet(S)[1]
    density -= 0.5 * (STUDENT_DEGREES + 3) * math.log1p(distance / STUDENT_DEGREES)
    widened = H @ before @ H.T + max(1.0, (STUDENT_DEGREES + distance) / (STUDENT_DEGREES + 3)) * R
    gain = before @ H.T @ np.linalg.inv(widened)
    evidence = np.zeros(1)
    none = np.zeros(1, dtype=np.int64)
    filters = Filters(mean, P, np.full(1, -1), none, none, evidence, np.zeros(1))
    step(filters, 1, DIRECTIONS, m.reading, N_SLOW, 1)
    assert evidence[0] == pytest.approx(density)
    assert mean[0, :N_SLOW] == pytest.approx(before_mean + gain @ innovation)
    assert P[0, :N_SLOW, :N_SLOW] == pytest.approx(before - gain @ H @ before, abs=1e-12)


def test_a_measurement_that_says_what_was_expected_moves_nothing() -> None:
    bank = Bank(PUMP)
    before = bank.filters.mean[0].copy()
    bank._take(measured(before, np.zeros(3), np.array([0.35, 0.02, 0.01])), 1)
    assert bank.filters.mean[0] == pytest.approx(before, abs=1e-12)
