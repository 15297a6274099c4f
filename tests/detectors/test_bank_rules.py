"""Single steps of a filter bank against the textbook: prior, walk, passing time, one linear update, one density."""

import math

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from detectors.bank.bank import Bank
from detectors.bank.hypotheses import (
    FAULT_KINDS,
    GONE,
    N_KINDS,
    OTHER,
    directions,
    laws,
    log_priors,
    prior,
    pure_kinds,
    walk_variance,
)
from detectors.bank.kernel import GROWS_ON, STUDENT_DEGREES, _cholesky, _whitened, advance, begun, remembered, step
from detectors.bank.prediction import N_MEASURED, predicted
from detectors.bank.shapes import ALIKE, ARRIVAL, N_SHAPES, ON_OFF, OPEN, RAMP, STATED, STEP, Filters, Walks
from detectors.bank.tables import DIRECTIONS
from detectors.bank.window import Measurement
from detectors.expectation import components as c
from detectors.expectation.anchor import anchors
from detectors.expectation.components import AMPLITUDE, LAW, N_COMPONENTS, N_SLOW, N_STATE, PLACE, RATE, SETTING
from detectors.words.states import FAULTS, State
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
    assert not spread[[AMPLITUDE, RATE, LAW]].any()


def test_the_case_zero_wanders_by_its_population_spread_over_a_hundred_flights() -> None:
    """A random walk grows with the root of its length: 0.06 bar over a hundred records are 0.006 in one."""
    variance = walk_variance()
    assert math.sqrt(100.0 * variance[PLACE["case_offset"]]) == pytest.approx(0.06)
    assert not variance[[AMPLITUDE, RATE, LAW]].any()


def test_faults_move_what_they_name_by_their_shares() -> None:
    """Per unit of the amplitude, and per unit of its product with the place of the law."""
    table = directions()
    assert table.shape == (len(FAULT_KINDS), 2, N_COMPONENTS)
    for rows, kind in zip(table, FAULT_KINDS, strict=True):
        for row, moves in zip(rows, (kind.moves, kind.law.moves), strict=True):
            assert {c.COMPONENTS[i]: row[i] for i in np.flatnonzero(row)} == dict(moves)


def test_a_law_is_a_place_between_others() -> None:
    """The prior's mean lies where the field expects it; what names no law has no spread there."""
    for (mean, sd), kind in zip(laws(), FAULT_KINDS, strict=False):
        assert (mean, sd) == (kind.law.mean, kind.law.sd), kind.name
        assert (sd > 0.0) == bool(kind.law.moves), kind.name
    assert not laws()[-1].any()  # of the healthy pump


def test_pure_kinds_stand_at_the_ends_of_their_laws() -> None:
    """A leak of 1 L/min through a gap alone moves the gap's component alone; so does each law that is one thing alone."""
    moves = {k.name: dict(k.moves) for k in pure_kinds()}
    assert moves["leakage, slippers"] == {"slipper_extra": 1.0}
    assert moves["leakage, throttled"] == {"throttled": 1.0}
    assert moves["leakage, mixed"] == {"slipper_extra": 0.5, "throttled": 0.5}
    assert moves["system leakage, orifice"] == {"system_orifice": 1.0}
    assert moves["system leakage, laminar"] == {"system_laminar": 1.0}
    assert moves["drain restriction"] == {"drain_extra": 1.0}
    assert len(moves) == len(pure_kinds())  # no name twice
    assert not any(k.law.moves for k in pure_kinds())


@pytest.mark.parametrize("which", [STATED, ALIKE])
def test_every_state_has_the_same_prior(which: int) -> None:
    """4 in 1000 between two onsets, however many kinds a state has: nothing is known of which is the likelier.

    A kind that never comes and goes leaves that tenth to nobody, and two faults together add e^-4 = 0.018 to the first one's
    state: between 0.90 and 1.02 of the whole, a tenth of a nat where an alarm asks for three.
    """
    priors = np.exp(log_priors(math.log(0.1))[which])
    for state in FAULTS:
        of_state = [k for k, kind in enumerate(FAULT_KINDS) if kind.state is state]
        total = priors[np.ix_((STEP, RAMP, ON_OFF), of_state)].sum()
        assert 0.899 * 4e-3 < total < 1.02 * 4e-3, state
        assert sum(FAULT_KINDS[k].share for k in of_state if FAULT_KINDS[k].beside is None) == pytest.approx(1.0), state


def test_shapes_cost_the_same_for_every_cause_where_nothing_is_known_of_it() -> None:
    """Under the shape-neutral prior a step is as likely against a ramp whatever it is that steps."""
    priors = log_priors(math.log(0.1))
    both = np.isfinite(priors[ALIKE, STEP]) & np.isfinite(priors[ALIKE, RAMP])
    assert both.sum() > 5
    assert np.array_equal(priors[ALIKE, STEP, both], priors[ALIKE, RAMP, both])
    # as stated, wear grows: one leak in six of those that step or grow sets in at once
    pump = both & [k.state is State.PUMP_DEGRADATION for k in FAULT_KINDS]
    odds = np.exp(priors[STATED, STEP, pump] - priors[STATED, RAMP, pump])
    assert odds == pytest.approx(0.15 / 0.75)
    for k, kind in enumerate(FAULT_KINDS):
        if kind.state is not State.PUMP_DEGRADATION:
            assert np.array_equal(priors[STATED, :, k], priors[ALIKE, :, k]), kind.name


def test_what_never_occurs_in_a_shape_has_no_prior_there() -> None:
    priors = log_priors(math.log(0.1))
    assert priors[:, ARRIVAL] == pytest.approx(math.log(0.1))
    for k, kind in enumerate(FAULT_KINDS):
        if k == OTHER:
            continue
        for shape, occurs in ((STEP, kind.sudden), (RAMP, kind.growing), (ON_OFF, kind.comes_and_goes)):
            assert np.isfinite(priors[:, shape, k]).all() == occurs, (kind.name, shape)
        assert not np.isfinite(priors[:, OPEN, k]).any(), kind.name
    open_to_all = np.isfinite(priors[STATED, :, OTHER])
    assert set(np.flatnonzero(open_to_all)) == {ARRIVAL, OPEN}
    # rarer than any state that has a name; that a fault is gone is so rare that no new candidate holds an alarm back
    assert math.exp(priors[STATED, OPEN, OTHER]) < 4e-3
    assert math.exp(priors[STATED, STEP, GONE]) < math.exp(-7.0)


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


def beside(mean: np.ndarray, covariance: np.ndarray, kind: int, shape: int) -> Filters:
    """Filters of one kind and shape side by side, at the beginning of everything."""
    n = len(mean)
    none = np.zeros(n, dtype=np.int64)
    return Filters(
        mean=mean,
        covariance=covariance,
        kind=np.full(n, kind),
        shape=np.full(n, shape),
        onset=none.copy(),
        log_evidence=np.zeros(n),
        setting_at_onset=np.zeros(n),
        scale=np.zeros(n),
        prior=np.zeros((n, 2)),
        misfit=np.zeros(n),
        unexplained=none.copy(),
        shown=none.copy(),
    )


def test_time_passes_as_in_the_textbook() -> None:
    """``m = F m`` and ``P = F P F' + Q`` with the amplitude growing by a rate that fades (Bar-Shalom 2001, section 5.2)."""
    rng = np.random.default_rng(3)
    mean, root = rng.normal(size=(2, N_STATE)), rng.normal(size=(2, N_STATE, N_STATE))
    covariance = root @ root.transpose(0, 2, 1)
    covariance[1, RATE, :] = covariance[1, :, RATE] = 0.0  # the second does not grow
    mean[1, RATE] = 0.0
    walk = rng.uniform(0.0, 1.0, N_STATE)
    own = rng.uniform(0.0, 1.0, (3, N_KINDS + 1))
    into = np.eye(N_STATE)
    into[AMPLITUDE, RATE] = 1.0
    into[RATE, RATE] = GROWS_ON
    expected_mean = mean @ into.T
    noise = np.array([np.diag(walk)] * 2)
    for f in range(2):
        for place, variance in zip((AMPLITUDE, RATE, SETTING), own[:, f], strict=True):
            noise[f, place, place] += variance
    expected = into @ covariance @ into.T + noise
    filters = beside(mean, covariance, 0, STEP)
    filters.kind[:] = 0, 1
    by_shape = np.zeros((2, N_SHAPES, N_KINDS + 1))
    by_shape[:, STEP] = own[:2]
    advance(filters, 2, Walks(walk, by_shape[0], by_shape[1], own[2]))
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
    full = np.empty(N_COMPONENTS)
    predicted(mean, DIRECTIONS[-1], ROW, np.zeros((2, N_COMPONENTS)), full, y, H, N_MEASURED)
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
    predicted(mean[0], DIRECTIONS[-1], ROW, m.ripple, np.empty(N_COMPONENTS), y, H, N_MEASURED)
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
    filters = beside(mean, P, -1, STEP)._replace(log_evidence=evidence)
    step(filters, 1, DIRECTIONS, m.reading, N_SLOW, 1)
    assert evidence[0] == pytest.approx(density)
    assert mean[0, :N_SLOW] == pytest.approx(before_mean + gain @ innovation)
    assert P[0, :N_SLOW, :N_SLOW] == pytest.approx(before - gain @ H @ before, abs=1e-12)


def test_a_measurement_that_says_what_was_expected_moves_nothing() -> None:
    bank = Bank(PUMP)
    before = bank.filters.mean[0].copy()
    bank._take(measured(before, np.zeros(3), np.array([0.35, 0.02, 0.01])), 1)
    assert bank.filters.mean[0] == pytest.approx(before, abs=1e-12)


@pytest.mark.parametrize("kind", [k.name for k in FAULT_KINDS])
def test_slopes_of_what_sensors_show_are_differences(kind: str) -> None:
    """Central differences of the six numbers by every place of the state, amplitude and law among them."""
    state, _ = prior(PUMP)
    state[[AMPLITUDE, LAW, SETTING, PLACE["case_offset"], PLACE["reservoir"]]] = 0.4, 0.3, 1.0, 0.05, -0.1
    direction = DIRECTIONS[[k.name for k in FAULT_KINDS].index(kind)]
    ripple = np.random.default_rng(2).normal(0.0, 0.2, (2, N_COMPONENTS))
    full = np.empty(N_COMPONENTS)

    def shown(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        y, H = np.empty(N_MEASURED), np.empty((N_MEASURED, N_STATE + N_COMPONENTS - c.N_LIVING))
        predicted(at, direction, ROW, ripple, full, y, H, N_MEASURED)
        return y, H

    _, H = shown(state)
    for i in range(N_STATE):
        if i == RATE:
            continue
        step_i = np.zeros(N_STATE)
        step_i[i] = 1e-5
        slope = (shown(state + step_i)[0] - shown(state - step_i)[0]) / 2e-5
        assert H[:, i] == pytest.approx(slope, rel=1e-5, abs=1e-6), i


def one(shape: int, kind: str, amplitude: float) -> Filters:
    """One filter of a fault whose size is known to a hair."""
    bank = Bank(PUMP)
    mean, P = bank.filters.mean[:1].copy(), bank.filters.covariance[:1].copy()
    mean[0, AMPLITUDE], P[0, AMPLITUDE, AMPLITUDE] = amplitude, 1e-8
    return beside(mean, P, [k.name for k in FAULT_KINDS].index(kind), shape)


def shown_with(filters: Filters, off: np.ndarray) -> Measurement:
    """What the filter's fault shows, and ``off`` on top."""
    sd = np.array([0.35, 0.02, 0.01])
    reading = measured(filters.mean[0], np.zeros(3), sd)
    y, H = np.empty(N_MEASURED), np.empty((N_MEASURED, N_STATE + N_COMPONENTS - c.N_LIVING))
    full = np.empty(N_COMPONENTS)
    direction = DIRECTIONS[filters.kind[0]]
    predicted(filters.mean[0], direction, ROW, reading.ripple, full, y, H, N_MEASURED)
    values = reading.values.copy()
    values[:3] = y[:3] + off
    return Measurement(values, reading.noise, reading.seen, ROW, reading.ripple, True)


def test_what_comes_and_goes_is_half_with_its_fault_and_half_without() -> None:
    """Its density is the mean of both; it goes on from the likelier and remembers which that was."""
    for present in (True, False):
        filters = one(ON_OFF, "drain restriction", 1.0)
        reading = shown_with(filters if present else one(ON_OFF, "drain restriction", 0.0), np.array([0.2, 0.01, 0.0]))
        densities, ends = [], []
        for amplitude in (1.0, 0.0):
            alone = one(STEP, "drain restriction", amplitude)
            if amplitude == 0.0:
                alone.kind[0] = -1
            step(alone, 1, DIRECTIONS, reading.reading, N_SLOW, 1)
            densities.append(alone.log_evidence[0])
            ends.append(alone.mean[0].copy())
        begun(filters, 1)
        step(filters, 1, DIRECTIONS, reading.reading, N_SLOW, 1)
        expected = np.logaddexp(*densities) - math.log(2.0)
        assert filters.log_evidence[0] == pytest.approx(expected, rel=1e-9)
        assert filters.shown[0] == int(present)
        assert (densities[0] > densities[1]) == present
        where = ends[0] if present else ends[1]
        others = [i for i in range(N_SLOW) if i != AMPLITUDE]
        assert filters.mean[0, others] == pytest.approx(where[others], abs=1e-9)
        # the size of a fault that did not show is not what the record speaks of
        assert filters.mean[0, AMPLITUDE] == pytest.approx(1.0, abs=1e-3)


def test_none_of_these_knows_only_how_far_apart_two_records_lie() -> None:
    """A Student-t about the healthy pump, 5 bar of discharge pressure and half a bar of case pressure wide; it learns nothing."""
    for off in (np.zeros(3), np.array([-20.0, 1.5, 0.2])):
        filters = one(OPEN, "none of these", 0.0)
        before = filters.mean.copy()
        reading = shown_with(filters, off)
        step(filters, 1, DIRECTIONS, reading.reading, N_SLOW, 1)
        variance = np.array([0.35, 0.02, 0.01]) ** 2 + np.array([5.0, 0.5, 0.3]) ** 2
        distance = float((off**2 / variance).sum())
        expected = -0.5 * np.log(variance).sum() - 0.5 * (STUDENT_DEGREES + 3) * math.log1p(distance / STUDENT_DEGREES)
        assert filters.log_evidence[0] == pytest.approx(expected)
        assert np.array_equal(filters.mean, before)
        remembered(filters, 1)
        assert filters.unexplained[0] == 1  # it explains nothing


def test_a_filter_remembers_twenty_records() -> None:
    """Bits, the latest lowest: what lies beyond what one good record in 16,000 exceeds is not explained."""
    filters = one(STEP, "setting", 1.0)
    misfits = [0.0, 2.0, 0.5, 1.5] + [0.0] * 17
    for misfit in misfits:
        begun(filters, 1)
        filters.misfit[0] = misfit
        remembered(filters, 1)
    bits = [int(filters.unexplained[0]) >> back & 1 for back in range(24)]
    assert bits == [int(m > 1.0) for m in reversed(misfits)][:20] + [0] * 4
    assert filters.misfit[0] == 0.0
