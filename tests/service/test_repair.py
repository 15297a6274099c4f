"""Faults of recorders that are mended: each gives the undisturbed record back and says so; what is a guess is refused."""

import json
from typing import Any

import numpy as np
import pytest

from service.errors import Invalid
from service.ingest.decode import DecodedRecord, Limits, decode
from service.ingest.raw import RawRecord
from service.ingest.repair import repaired

N = 160
Channels = dict[str, np.ndarray]


def plain(rate_hz: float = 1.0) -> Channels:
    time = np.arange(N) / rate_hz
    return {
        "time_s": time,
        "discharge_pressure_bar": 174.0 + np.sin(time),
        "case_pressure_bar": 0.9 + 0.01 * np.cos(time),
        "shaft_speed_rpm": 4600.0 + np.arange(N) % 7,
        "fluid_temperature_degc": 50.0 + 0.01 * time,
    }


def mended(channels: Channels) -> tuple[Channels, list[str]]:
    raw = repaired(RawRecord({}, {k: np.array(v, dtype=float) for k, v in channels.items()}))
    return raw.channels, raw.flags


def rows_of(channels: Channels, order: np.ndarray) -> Channels:
    return {name: samples[order] for name, samples in channels.items()}


def assert_same(found: Channels, wanted: Channels) -> None:
    for name, samples in wanted.items():
        assert np.array_equal(found[name], samples, equal_nan=True), name


def test_a_sound_record_is_left_alone() -> None:
    found, flags = mended(plain())
    assert_same(found, plain())
    assert flags == []


@pytest.mark.parametrize("rate", [0.2, 1.0, 10.0, 10_000.0])
def test_neighbours_out_of_order_are_put_in_order(rate: float) -> None:
    order = np.arange(N)
    for i in (4, 40, 41, 90, 150):
        order[i], order[i + 1] = order[i + 1], order[i]
    found, flags = mended(rows_of(plain(rate), order))
    assert_same(found, plain(rate))
    assert len(flags) == 1
    assert "rows out of order" in flags[0]


@pytest.mark.parametrize("rate", [0.2, 1.0, 10_000.0])
def test_repeated_rows_are_left_out_wherever_they_come(rate: float) -> None:
    for order in (
        np.sort(np.concatenate((np.arange(N), [0, 5, 5, 80, N - 1]))),
        np.concatenate((np.arange(50), np.arange(47, N))),  # a buffer that was written twice
        np.concatenate((np.arange(90), np.arange(20, N))),
    ):
        found, flags = mended(rows_of(plain(rate), order))
        assert_same(found, plain(rate))
        assert len(flags) == 1
        assert f"{len(order) - N} rows" in flags[0]


def test_a_row_that_repeats_an_instant_fills_what_the_first_lacks() -> None:
    order = np.sort(np.append(np.arange(N), 30))
    doubled = rows_of(plain(), order)
    doubled["case_pressure_bar"][30] = np.nan
    found, flags = mended(doubled)
    assert_same(found, plain())
    assert flags == ["1 row at an instant that another row has: left out"]


def test_rows_of_one_instant_that_differ_are_counted() -> None:
    order = np.sort(np.append(np.arange(N), 30))
    doubled = rows_of(plain(), order)
    doubled["case_pressure_bar"][31] = 4.0
    found, flags = mended(doubled)
    assert_same(found, plain())
    assert "1 row of them with other samples" in flags[0]


@pytest.mark.parametrize("back", [2.5, 30.0, 55.0])
def test_a_clock_that_was_set_back_goes_on(back: float) -> None:
    channels = plain()
    channels["time_s"][60:] -= back
    found, flags = mended(channels)
    assert found["time_s"] == pytest.approx(plain()["time_s"])
    assert_same({k: v for k, v in found.items() if k != "time_s"}, {k: v for k, v in plain().items() if k != "time_s"})
    assert len(flags) == 1
    assert f"set back by {back:.4g} s after 59 s" in flags[0] or "set back" in flags[0]


@pytest.mark.parametrize("rate", [2.0, 10.0])
def test_a_clock_coarser_than_its_rows_is_spread(rate: float) -> None:
    fine = plain(rate)
    coarse = {**fine, "time_s": np.floor(fine["time_s"] + 1e-9)}
    found, flags = mended(coarse)
    assert found["time_s"] == pytest.approx(fine["time_s"], abs=1e-9)
    assert "coarser" in flags[0]
    # a record that begins within a second ends where the next one would have begun
    later = int(0.7 * rate)
    late = {name: samples[later:] for name, samples in coarse.items()}
    found, _ = mended(late)
    assert found["time_s"] == pytest.approx(fine["time_s"][later:], abs=1e-9)


def test_single_missing_times_are_taken_from_their_neighbours() -> None:
    channels = plain()
    channels["time_s"][[0, 20, 75, N - 1]] = np.nan
    found, flags = mended(channels)
    assert_same(found, plain())
    assert flags == ["4 rows without a time: taken from the neighbours"]


@pytest.mark.parametrize(
    "name",
    ["reservoir_pressure_bar", "case_flow_lpm", "discharge_flow_lpm", "commanded_flow_lpm", "flight_control_activity"],
)
def test_an_empty_optional_column_is_a_sensor_that_is_not_there(name: str) -> None:
    for empty in (np.full(N, np.nan), np.empty(0)):
        found, flags = mended({**plain(), name: empty})
        assert name not in found
        assert flags == [f"{name} holds no number at all: taken as not recorded"]


def decoded_json(channels: dict[str, Any]) -> DecodedRecord:
    document = {
        "pump_serial": "P-1",
        "aircraft": "F-1",
        "position": "LH",
        "flight_id": "1",
        "started_at": "2026-05-02T07:11:00Z",
        "channels": channels,
    }
    return decode(json.dumps(document).encode(), "application/json", "", {}, Limits(2**26, 10**6))


@pytest.mark.parametrize("nothing", [None, [], [None] * N, ["n/a"] * N])
def test_an_optional_channel_of_a_json_document_may_hold_nothing(nothing: Any) -> None:
    found = {name: samples.tolist() for name, samples in plain().items()} | {"reservoir_pressure_bar": nothing}
    decoded = decoded_json(found)
    assert "reservoir_pressure_bar" not in decoded.recording.channels


def faults_of(time: list[float | None]) -> dict[str, str]:
    channels: dict[str, Any] = {name: samples.tolist() for name, samples in plain().items()}
    try:
        decoded_json({**channels, "time_s": time})
    except Invalid as problem:
        return {fault.where: fault.problem for fault in problem.errors}
    return {}


def test_what_is_no_order_of_a_clock_is_refused() -> None:
    shuffled = np.random.default_rng(3).permutation(np.arange(float(N))).tolist()
    assert any("does not increase" in problem for problem in faults_of(shuffled).values())
    off: list[float | None] = [float(i) for i in range(N)]
    off[20] = 5.0
    assert "channels.time_s[20]" in faults_of(off)
    twice = [float(i % 80) for i in range(N)]
    assert "channels.time_s[80]" in faults_of(list(twice))
    unknown: list[float | None] = [None if i % 3 else float(i) for i in range(N)]
    assert "is not a number" in next(iter(faults_of(unknown).values()))
    assert faults_of([float(i) for i in range(N)]) == {}
