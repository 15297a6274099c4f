"""A measured healthy curve in place of the twin's, against pumps whose drain is not the twin's."""

from dataclasses import astuple, replace

import numpy as np
import pytest

from detectors.bank.measurement import measured_windows
from detectors.expectation.type_correction import HealthyCurve, HealthyPoint, followed
from detectors.judgement.assessment import assess
from detectors.words.observation import History, Observation, Residual
from detectors.words.thresholds import effective
from tests.detectors.fleet import CIRCUIT, PUMP, history
from twin.condition import Condition, Health, input_rows
from twin.operating_point import operating_points

TRUE_DRAIN = 1.6
"""Drain of every pump of the type over the twin's."""
RISE = "case_pressure_bar"


def curve(temperatures: tuple[float, ...] = (25.0, 40.0, 55.0, 70.0), drain: float = TRUE_DRAIN) -> HealthyCurve:
    """Bench points of the true type over demand and temperature, read to some millibar."""
    rng = np.random.default_rng(5)
    demands = (0.0, 2.0, 5.0, 8.0)
    conditions = [Condition(4600.0, t, 0.0) for t in temperatures for _ in demands]
    healths = [Health(system_leakage_lpm=q, drain_resistance_scale=drain) for _ in temperatures for q in demands]
    points = operating_points(PUMP.pump, input_rows(conditions, healths), CIRCUIT)
    discharge = points.value("discharge_pressure_bar") + rng.normal(0.0, 0.1, len(conditions))
    rise = points.value(RISE) + rng.normal(0.0, 0.005, len(conditions))
    return HealthyCurve(
        tuple(
            HealthyPoint(float(p), float(y), c.fluid_temperature_degc, c.speed_rpm)
            for p, y, c in zip(discharge, rise, conditions, strict=True)
        )
    )


@pytest.fixture(scope="module")
def observations() -> list[Observation]:
    """Windows at 25 to 75 degC of healthy pumps of the true type: the demand is none, the leakages nominal."""
    found = sorted(history(31, 40).observations, key=lambda o: o.at)
    rng = np.random.default_rng(8)
    made = []
    for observation in found:
        window = observation.reduction.windows[0]
        means = dict(window.means)
        condition = Condition(*(means[n].mean for n in ("shaft_speed_rpm", "fluid_temperature_degc")), 0.5)
        truth = operating_points(
            PUMP.pump, input_rows([condition], [Health(drain_resistance_scale=TRUE_DRAIN)]), CIRCUIT
        )
        for name, noise, offset in (
            (RISE, 0.004, observation.reduction.zero.offset_bar),
            ("discharge_pressure_bar", 0.1, 0.0),
        ):
            means[name] = replace(means[name], mean=float(truth.value(name)[0]) + offset + rng.normal(0.0, noise))
        means["reservoir_pressure_bar"] = replace(means["reservoir_pressure_bar"], mean=0.5)
        windows = (replace(window, means=means),)
        made.append(replace(observation, reduction=replace(observation.reduction, windows=windows)))
    return made


def test_the_drain_of_the_type_is_no_residual_of_the_pump(observations: list[Observation]) -> None:
    plain = measured_windows(observations, {}, PUMP, CIRCUIT)
    judged = measured_windows(observations, {}, PUMP, CIRCUIT, curve())
    without = np.array([m.residuals[RISE].residual for m in plain.values()])
    residuals = [m.residuals[RISE] for m in judged.values()]
    with_curve = np.array([r.residual for r in residuals])
    claimed = float(np.median([r.standard_deviation for r in residuals]))
    assert without.min() > 0.1
    assert abs(with_curve.mean()) < claimed
    # also along the temperature: the drain's law bends with it
    warmest_first = np.argsort([-temperature_of(o) for o in observations])
    for half in np.array_split(warmest_first, 2):
        assert abs(with_curve[half].mean()) < claimed
    for one in observations:
        bare, corrected = plain[one.record_id].measurements[0], judged[one.record_id].measurements[0]
        assert corrected.noise[1, 1] > bare.noise[1, 1]
        assert corrected.values[0] == bare.values[0]
        name = "discharge_pressure_bar"
        assert judged[one.record_id].residuals[name] == plain[one.record_id].residuals[name]


def test_outside_its_range_the_twin_stays_and_the_verdict_says_so(observations: list[Observation]) -> None:
    warm = curve((60.0, 70.0))
    plain = measured_windows(observations, {}, PUMP, CIRCUIT)
    judged = measured_windows(observations, {}, PUMP, CIRCUIT, warm)
    n_outside = 0
    for one in observations:
        found = judged[one.record_id]
        # five kelvin beyond the points is how far the curve reaches
        if 55.0 <= temperature_of(one) <= 75.0:
            assert found.outside_curve == ()
        else:
            n_outside += 1
            assert found.outside_curve == ("fluid_temperature_degc",)
            assert found.residuals == plain[one.record_id].residuals
            assert (found.measurements[0].values == plain[one.record_id].measurements[0].values).all()
    assert 0 < n_outside < 40
    verdict = assess(history_of(observations), PUMP, CIRCUIT, effective({}), warm)[-1].verdict
    expected = f"{n_outside} of 40 records outside the measured healthy curve (fluid_temperature_degc)"
    assert any(flag.startswith(expected) for flag in verdict.quality.flags)
    whole = assess(history_of(observations), PUMP, CIRCUIT, effective({}), curve())[-1].verdict
    assert not any("healthy curve" in flag for flag in whole.quality.flags)
    assert whole.state.value == "healthy"


def assert_same(one: dict[str, Residual], other: dict[str, Residual]) -> None:
    """Equal but for the rounding of sums taken in another order."""
    assert one.keys() == other.keys()
    for metric, residual in one.items():
        assert astuple(residual) == pytest.approx(astuple(other[metric]), rel=1e-12, abs=1e-12)


def test_the_order_of_the_points_decides_nothing(observations: list[Observation]) -> None:
    there = curve()
    back = HealthyCurve(there.points[::-1])
    assert there.version == back.version != curve(drain=1.5).version
    few = observations[:3]
    first, second = (measured_windows(few, {}, PUMP, CIRCUIT, c) for c in (there, back))
    for one, other in zip(first.values(), second.values(), strict=True):
        assert_same(one.residuals, other.residuals)


def test_points_that_the_twin_cannot_follow_are_told_and_left_out(observations: list[Observation]) -> None:
    good = curve()
    impossible = HealthyPoint(174.0, 0.4, 50.0, 20.0)
    mixed = HealthyCurve((*good.points, impossible))
    assert list(followed(mixed, PUMP, CIRCUIT)) == [True] * len(good.points) + [False]
    few = observations[:3]
    first, second = (measured_windows(few, {}, PUMP, CIRCUIT, c) for c in (good, mixed))
    for one, other in zip(first.values(), second.values(), strict=True):
        assert_same(one.residuals, other.residuals)
    lost = measured_windows(few, {}, PUMP, CIRCUIT, HealthyCurve((impossible,) * 2))
    assert all("cannot follow" in m.outside_curve[0] for m in lost.values())


def temperature_of(observation: Observation) -> float:
    return observation.reduction.windows[0].means["fluid_temperature_degc"].mean


def history_of(observations: list[Observation]) -> History:
    return History(tuple(observations))
