"""A whole record in another unit is refused with that unit; a broken sensor is none, whatever it reads."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from service.ingest.scales import scale_remarks
from service.ingest.validation import unit_faults
from tests.service.records import document
from twin.pumps import PUMP_TYPES

Samples = NDArray[np.float64]
Channels = dict[str, Samples]
CASE, RESERVOIR, DISCHARGE = "case_pressure_bar", "reservoir_pressure_bar", "discharge_pressure_bar"
SPEED, TEMPERATURE = "shaft_speed_rpm", "fluid_temperature_degc"
PSI = 14.503774
PUMP = PUMP_TYPES["h225"]


def channels(rest: float = 0.44, case: float = 1.0, discharge: float = 174.0, degc: float = 53.0) -> Channels:
    """A flight of 40 s at rest and 120 s running, with the noise and the steps of real sensors."""
    noise = np.random.default_rng(3)
    n = 160
    running = np.arange(n) >= 40

    def sensed(off: float, on: float, sigma: float, step: float) -> Samples:
        samples: Samples = np.round((np.where(running, on, off) + noise.normal(0, sigma, n)) / step) * step
        return samples

    return {
        DISCHARGE: sensed(7.0, discharge, 0.1, 0.085),
        CASE: sensed(rest, case, 0.003, 0.00122),
        SPEED: sensed(1.0, 4594.0, 2.0, 1.0),
        TEMPERATURE: sensed(degc, degc, 0.05, 0.1) + np.linspace(0.0, 1.0, n),
        RESERVOIR: sensed(rest, rest, 0.003, 0.00122),
    }


def faults(record: Channels, full_scales: dict[str, float] | None = None) -> dict[str, str]:
    return {f.where.removeprefix("channels."): f.problem for f in unit_faults(record, PUMP, full_scales or {})}


Change = Callable[[Samples], Samples]
UNITS: list[tuple[str, Change, str]] = [
    (CASE, lambda v: v * PSI, "psi"),
    (CASE, lambda v: v * 100.0, "kPa"),
    (CASE, lambda v: v * 1000.0, "mbar"),
    (CASE, lambda v: v * 1e5, "Pa"),
    (CASE, lambda v: (v + 1.013) * PSI, "psi"),
    (RESERVOIR, lambda v: v * 100.0, "kPa"),
    (RESERVOIR, lambda v: (v + 1.013) * PSI, "psi"),
    (RESERVOIR, lambda v: v * 1000.0, "mbar"),
    (DISCHARGE, lambda v: v * PSI, "psi"),
    (DISCHARGE, lambda v: v * 100.0, "kPa"),
    (DISCHARGE, lambda v: v * 0.1, "MPa"),
    (DISCHARGE, lambda v: v * 1e5, "Pa"),
    (TEMPERATURE, lambda v: v * 1.8 + 32.0, "degF"),
    (TEMPERATURE, lambda v: v + 273.15, "K"),
    (SPEED, lambda v: v / 60.0, "Hz"),
    (SPEED, lambda v: v * 2.0 * np.pi / 60.0, "rad/s"),
    (SPEED, lambda v: v / 46.0, "percent"),
    (SPEED, lambda v: v / 1000.0, "1000/min"),
    (SPEED, lambda v: v * 6.0, "deg/s"),
]


@pytest.mark.parametrize(("name", "change", "unit"), UNITS, ids=[f"{n}-{u}-{i}" for i, (n, _, u) in enumerate(UNITS)])
@pytest.mark.parametrize("part", ["whole", "running", "gaps"])
def test_another_unit_is_named(name: str, change: Change, unit: str, part: str) -> None:
    record = channels()
    record[name] = change(record[name])
    if part == "running":
        record = {n: samples[45:] for n, samples in record.items()}
    if part == "gaps":
        record[name][::3] = np.nan
    found = faults(record)
    assert set(found) == {name}
    assert unit in found[name]


@pytest.mark.parametrize("worn", [0.75, 1.0, 1.6, 3.0])
@pytest.mark.parametrize("both", [True, False])
def test_case_pressure_in_psi_from_start_to_end_is_beyond_the_sensor_s_range(worn: float, both: bool) -> None:
    record = channels(case=worn)
    record[CASE] = record[CASE] * PSI
    if both:
        record[RESERVOIR] = record[RESERVOIR] * PSI
    found = faults(record)
    assert "beyond the range of a sensor of 5 bar full scale" in found[CASE]
    assert "psi" in found[CASE].partition("looks like")[2]


def test_every_unit_at_once_is_named_channel_by_channel() -> None:
    record = channels()
    record[CASE], record[DISCHARGE], record[SPEED] = record[CASE] * PSI, record[DISCHARGE] * PSI, record[SPEED] / 60.0
    record[TEMPERATURE] = record[TEMPERATURE] * 1.8 + 32.0
    found = faults(record)
    assert {name: unit in found[name] for name, unit in ((CASE, "psi"), (DISCHARGE, "psi"), (SPEED, "Hz"))} == {
        CASE: True,
        DISCHARGE: True,
        SPEED: True,
    }
    assert "degF" in found[TEMPERATURE]


def broken(name: str, how: Callable[[Samples, NDArray[np.bool_]], Samples]) -> Channels:
    record = channels()
    running = record[SPEED] > 3000.0
    record[name] = how(record[name].copy(), running)
    return record


noise = np.random.default_rng(11)
NO_UNITS: dict[str, Channels] = {
    "good": channels(),
    "worn": channels(case=3.4),
    "blocked drain": channels(case=4.9),
    "pressurised reservoir": channels(rest=2.0, case=2.6),
    "atmospheric reservoir": channels(rest=0.0, case=0.4),
    "cold": channels(degc=-35.0),
    "hot": channels(degc=105.0),
    "no pressure": channels(discharge=3.0),
    "low setting": channels(discharge=90.0),
    "full scale while running": broken(CASE, lambda v, on: np.where(on, 5.0, v)),
    "full scale and a little": broken(CASE, lambda v, on: np.where(on, 5.5, v) + noise.normal(0, 0.001, len(v))),
    "full scale from start to end": broken(CASE, lambda v, _: np.full(len(v), 5.0)),
    "dead": broken(CASE, lambda v, _: np.zeros(len(v))),
    "frozen": broken(CASE, lambda v, _: np.full(len(v), 0.446)),
    "frozen beyond its range": broken(CASE, lambda v, _: np.full(len(v), 14.6)),
    "only noise": broken(CASE, lambda v, _: noise.normal(0.0, 8.0, len(v))),
    "noise about a large mean": broken(CASE, lambda v, _: noise.uniform(0.0, 30.0, len(v))),
    "spikes": broken(CASE, lambda v, _: np.where(np.arange(len(v)) % 9 == 0, 14.6, v)),
    "offset": broken(CASE, lambda v, _: v + 2.0),
    "absolute reservoir": broken(RESERVOIR, lambda v, _: v + 1.013),
    "reservoir at full scale": broken(RESERVOIR, lambda v, _: np.full(len(v), 5.0)),
    "discharge at full scale": broken(DISCHARGE, lambda v, on: np.where(on, 350.0, v)),
    "discharge dead": broken(DISCHARGE, lambda v, _: noise.normal(0.0, 0.1, len(v))),
    "speed dead": broken(SPEED, lambda v, _: np.round(noise.normal(0.0, 2.0, len(v)))),
    "speed frozen": broken(SPEED, lambda v, _: np.full(len(v), 77.0)),
    "speed of a half tooth count": broken(SPEED, lambda v, _: 0.5 * v),
    "thermometer frozen": broken(TEMPERATURE, lambda v, _: np.full(len(v), 150.0)),
    "only running": {n: samples[45:] for n, samples in channels().items()},
    "only at rest": {n: samples[:40] for n, samples in channels().items()},
}


@pytest.mark.parametrize("case", NO_UNITS)
def test_a_broken_sensor_is_no_unit(case: str) -> None:
    assert faults(NO_UNITS[case]) == {}


def test_a_larger_sensor_of_the_aircraft_is_believed() -> None:
    record = channels(case=9.0)
    assert set(faults(record)) == {CASE}
    assert faults(record, {CASE: 20.0}) == {}


def test_what_may_be_right_all_the_same_is_remarked() -> None:
    assert scale_remarks(channels(), PUMP) == ()
    assert scale_remarks(NO_UNITS["atmospheric reservoir"], PUMP) == ()
    (remark,) = scale_remarks(NO_UNITS["absolute reservoir"], PUMP)
    assert remark.startswith("reservoir_pressure_bar reads one atmosphere more")
    assert scale_remarks(channels(rest=1.013, case=1.6), PUMP) == (), "a reservoir may be pressurised"
    small = channels(rest=0.044, case=0.1)
    assert "MPa" in scale_remarks(small, PUMP)[0]
    assert scale_remarks({n: np.array(v, float) for n, v in document()["channels"].items()}, PUMP) == ()
