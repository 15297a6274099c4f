"""Measured reference: known truth, honest bands, refusals that name their cause, units, few points."""

import math

import numpy as np
import pytest

from detectors.expectation.reference_curve import (
    Departure,
    OutsideRange,
    Reference,
    ReferenceCurve,
    Regressor,
    fit_reference,
)

PRESSURE = Regressor("discharge_pressure_bar", "bar", scale=2.0, margin=0.5, degree=2)
TEMPERATURE = Regressor("fluid_temperature_degc", "degC", scale=10.0, margin=3.0)
NOISE = 0.008


def truth(x: np.ndarray) -> np.ndarray:
    """Case-minus-reservoir pressure [bar] of an invented pump: curved in pressure, falling with temperature."""
    p, temperature = x[..., 0] - 175.0, x[..., 1] - 50.0
    return np.asarray(0.40 - 0.03 * p + 0.002 * p**2 - 0.001 * temperature)


def twin(x: np.ndarray) -> np.ndarray:
    """The twin's idea of it: right shape, slopes 20 % off, level 50 mbar off."""
    p, temperature = x[..., 0] - 175.0, x[..., 1] - 50.0
    return np.asarray(0.45 - 0.024 * p + 0.0016 * p**2 - 0.0012 * temperature)


def points(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    x = np.column_stack([rng.uniform(172.0, 178.0, n), rng.uniform(40.0, 70.0, n)])
    return x, truth(x) + NOISE * rng.normal(size=n)


def fitted(x: np.ndarray, y: np.ndarray, **extra: object) -> ReferenceCurve:
    settings: dict[str, object] = {"repeatability": 0.01, "departure": 0.1, **extra}
    return fit_reference([PRESSURE, TEMPERATURE], x, y, **settings)  # type: ignore[arg-type]


def at(curve: ReferenceCurve, pressure: float, temperature: float) -> Reference:
    found = curve.at({"discharge_pressure_bar": pressure, "fluid_temperature_degc": temperature})
    assert isinstance(found, Reference), found
    return found


def test_the_truth_is_found() -> None:
    curve = fitted(*points(np.random.default_rng(1), 200))
    for pressure, temperature in ((175.0, 50.0), (173.0, 65.0), (177.5, 42.0)):
        found = at(curve, pressure, temperature)
        expected = float(truth(np.array([pressure, temperature])))
        assert abs(found.mean - expected) < 4.0 * found.standard_deviation
        assert found.standard_deviation < 0.003
        slope = -0.03 + 0.004 * (pressure - 175.0)
        assert found.slope["discharge_pressure_bar"] == pytest.approx(slope, abs=0.003)
        assert found.slope["fluid_temperature_degc"] == pytest.approx(-0.001, abs=0.0003)


@pytest.mark.parametrize("n", [6, 12, 60])
def test_the_band_covers_nine_in_ten(n: int) -> None:
    rng = np.random.default_rng(2)
    inside = []
    for _ in range(300):
        x, y = points(rng, n)
        curve = fitted(x, y, repeatability=NOISE)
        new, response = points(rng, 4)
        for row, value in zip(new, response, strict=True):
            found = curve.at({"discharge_pressure_bar": row[0], "fluid_temperature_degc": row[1]})
            if isinstance(found, Reference):
                inside.append(found.low <= value <= found.high)
    assert len(inside) > 300
    assert 0.85 <= np.mean(inside) <= 0.95


def test_the_band_covers_groups_that_share_an_error() -> None:
    rng = np.random.default_rng(3)
    inside = []
    for _ in range(200):
        block = np.repeat(np.arange(9), 10)
        x = np.column_stack([rng.uniform(172, 178, 90), np.repeat(rng.uniform(40, 70, 9), 10)])
        y = truth(x) + 0.02 * rng.normal(size=9)[block] + 0.005 * rng.normal(size=90)
        curve = fitted(x[:80], y[:80], repeatability=0.02, groups=block[:80])
        for row, value in zip(x[80:81], y[80:81], strict=True):
            found = curve.at({"discharge_pressure_bar": row[0], "fluid_temperature_degc": row[1]})
            if isinstance(found, Reference):
                inside.append(found.low <= value <= found.high)
    # 200 fits: a binomial spread of 2 %
    assert 0.83 <= np.mean(inside) <= 0.97


def test_the_band_widens_outside_the_points() -> None:
    curve = fitted(*points(np.random.default_rng(4), 30))
    sds = [at(curve, p, 55.0).predictive_sd for p in (175.0, 177.9, 178.4)]
    assert sds[0] < sds[1] < sds[2]


def test_outliers_do_not_bend_the_curve() -> None:
    x, y = points(np.random.default_rng(5), 60)
    spoiled = y.copy()
    spoiled[[3, 17, 40]] += (0.5, -0.3, 0.8)
    clean, robust = at(fitted(x, y), 175.0, 55.0), at(fitted(x, spoiled), 175.0, 55.0)
    assert robust.mean == pytest.approx(clean.mean, abs=0.004)
    assert robust.predictive_sd < 4.0 * clean.predictive_sd


@pytest.mark.parametrize(
    ("pressure", "temperature", "named"),
    [
        (190.0, 55.0, ("discharge_pressure_bar",)),
        (175.0, 20.0, ("fluid_temperature_degc",)),
        (160.0, 95.0, ("discharge_pressure_bar", "fluid_temperature_degc")),
    ],
)
def test_outside_its_range_it_refuses_and_says_why(pressure: float, temperature: float, named: tuple[str, ...]) -> None:
    curve = fitted(*points(np.random.default_rng(6), 40))
    found = curve.at({"discharge_pressure_bar": pressure, "fluid_temperature_degc": temperature})
    assert isinstance(found, OutsideRange)
    assert len(found.reasons) == len(named)
    for reason, name in zip(found.reasons, named, strict=True):
        assert reason.startswith(name)
        assert "measured from" in reason


def test_a_corner_that_was_never_measured_is_outside() -> None:
    # pressure and temperature always moved together: the other corners of the rectangle are unknown
    rng = np.random.default_rng(7)
    along = rng.uniform(-1.0, 1.0, 60)
    x = np.column_stack([175.0 + 3.0 * along, 55.0 + 15.0 * along + 0.5 * rng.normal(size=60)])
    curve = fitted(x, truth(x) + NOISE * rng.normal(size=60))
    assert isinstance(curve.at({"discharge_pressure_bar": 177.0, "fluid_temperature_degc": 65.0}), Reference)
    found = curve.at({"discharge_pressure_bar": 177.8, "fluid_temperature_degc": 41.0})
    assert isinstance(found, OutsideRange)
    assert "never measured together" in found.reasons[0]


def test_a_gap_between_points_is_outside_where_a_limit_is_set() -> None:
    rng = np.random.default_rng(13)
    temperature = np.concatenate([rng.uniform(35.0, 37.0, 30), rng.uniform(55.0, 57.0, 30)])[:, None]
    y = 190.0 - 0.06 * temperature[:, 0]
    regressor = Regressor("fluid_temperature_degc", "degC", 5.0, 2.0, gap=3.0)
    curve = fit_reference([regressor], temperature, y, repeatability=0.02, departure=0.5)
    assert isinstance(curve.at({"fluid_temperature_degc": 39.0}), Reference)
    found = curve.at({"fluid_temperature_degc": 45.0})
    assert isinstance(found, OutsideRange)
    assert "nearest measured point" in found.reasons[0]


def test_few_points_keep_the_twins_shape() -> None:
    x, y = points(np.random.default_rng(8), 3)
    x[:, 1] = 50.0
    y = truth(x)
    curve = fitted(x, y, shape=twin, departure=0.02)
    pressure = float(np.median(x[:, 0]))
    found = at(curve, pressure, 52.0)
    # the level is learnt, the temperature slope was never seen and stays the twin's
    assert found.mean == pytest.approx(float(truth(np.array([pressure, 52.0]))), abs=0.02)
    assert found.slope["fluid_temperature_degc"] == pytest.approx(-0.0012, abs=1e-6)
    many = at(fitted(*points(np.random.default_rng(8), 100), shape=twin), 175.0, 52.0)
    assert found.predictive_sd > 1.1 * many.predictive_sd
    assert many.slope["fluid_temperature_degc"] == pytest.approx(-0.001, abs=0.0003)


def test_units_follow() -> None:
    x, y = points(np.random.default_rng(9), 40)
    plain = at(fitted(x, y), 174.0, 60.0)
    millibar = fitted(x, 1000.0 * y, repeatability=10.0, departure=100.0)
    assert at(millibar, 174.0, 60.0).mean == pytest.approx(1000.0 * plain.mean)
    assert at(millibar, 174.0, 60.0).predictive_sd == pytest.approx(1000.0 * plain.predictive_sd, rel=1e-6)
    pascal = Regressor("discharge_pressure_pa", "Pa", 2e5, 5e4, degree=2)
    other = fit_reference([pascal, TEMPERATURE], x * (1e5, 1.0), y, repeatability=0.01, departure=0.1)
    found = other.at({"discharge_pressure_pa": 174e5, "fluid_temperature_degc": 60.0})
    assert isinstance(found, Reference)
    assert found.mean == pytest.approx(plain.mean, abs=1e-9)
    assert found.slope["discharge_pressure_pa"] == pytest.approx(plain.slope["discharge_pressure_bar"] / 1e5)


def test_a_leak_lifts_and_a_demand_moves_along() -> None:
    curve = fitted(*points(np.random.default_rng(10), 200))
    noise = np.diag([0.3**2, 0.004**2])

    def departure(pressure: float, lift: float) -> Departure:
        condition = {"discharge_pressure_bar": pressure, "fluid_temperature_degc": 50.0}
        found = curve.departure(condition, float(truth(np.array([pressure, 50.0]))) + lift, 176.0, noise)
        assert isinstance(found, Departure)
        return found

    demand, leak = departure(173.0, 0.0), departure(176.0, 0.1)
    assert demand.along == pytest.approx(-3.0)
    assert demand.across == pytest.approx(0.0, abs=0.005)
    assert leak.along == pytest.approx(0.0)
    assert leak.across == pytest.approx(0.1, abs=0.005)
    # the slope turns the discharge sensor's noise into apparent lift, against the displacement
    slope = -0.03 + 0.004
    (aa, ab), (ba, bb) = leak.covariance
    assert ab == ba == pytest.approx(-slope * 0.09, rel=0.1)
    assert bb == pytest.approx(0.09)
    assert aa > slope**2 * 0.09


def test_missing_numbers_are_left_out() -> None:
    x, y = points(np.random.default_rng(11), 40)
    with_gaps, response = np.vstack([x, [[np.nan, 50.0], [175.0, 50.0]]]), np.append(y, [0.4, np.nan])
    assert at(fitted(with_gaps, response), 175.0, 50.0) == at(fitted(x, y), 175.0, 50.0)


def test_bad_input_is_named_whole() -> None:
    with pytest.raises(
        ValueError, match=r"scale of a .*margin of a .*degree of a .*repeatability .*departure .*1 points"
    ):
        fit_reference(
            [Regressor("a", "bar", 0.0, -1.0, 9)], [[1.0], [math.nan]], [1.0, 2.0], repeatability=0.0, departure=-1.0
        )
    with pytest.raises(ValueError, match=r"values have shape \(1, 2\).*groups have shape \(3,\)"):
        fit_reference([TEMPERATURE], [[1.0, 2.0]], [1.0], repeatability=1.0, departure=1.0, groups=[1, 2, 3])
    curve = fitted(*points(np.random.default_rng(12), 10))
    with pytest.raises(ValueError, match=r"discharge_pressure_bar \[bar\] is missing; fluid_.* is not a number"):
        curve.at({"fluid_temperature_degc": math.nan})
    with pytest.raises(ValueError, match="covariance must be"):
        curve.departure({"discharge_pressure_bar": 175.0, "fluid_temperature_degc": 50.0}, 0.4, 176.0, np.eye(3))
