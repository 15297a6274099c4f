"""Groups, rates, starts, units and foreign columns in every binary format: the flight that was written is what is read."""

from datetime import UTC
from typing import Any

import numpy as np
import pytest

from service.errors import Invalid
from service.ingest.decode import DecodedRecord, Limits, decode
from service.ingest.mapping import ChannelMapping
from service.ingest.parser_pool import ParserPool
from tests.service.layouts import LAYOUTS, START, Group

LIMITS = Limits(50_000_000, 100_000)
N = 200
_RNG = np.random.default_rng(8)
_RUNNING = np.arange(N) > 40
FLIGHT: dict[str, Any] = {
    "discharge_pressure_bar": np.where(_RUNNING, 175.0, 1.0) + _RNG.normal(0, 0.1, N),
    "case_pressure_bar": np.where(_RUNNING, 0.9, 0.5) + _RNG.normal(0, 0.003, N),
    "shaft_speed_rpm": np.where(_RUNNING, 4600.0, 0.0),
    "fluid_temperature_degc": 50.0 + np.arange(N) / 50.0,
    "reservoir_pressure_bar": np.full(N, 0.5) + _RNG.normal(0, 0.001, N),
}
SLOW = "fluid_temperature_degc"
OTHERS = {name: samples for name, samples in FLIGHT.items() if name != SLOW}
METADATA = {"pump_serial": "P", "aircraft": "A", "position": "LH", "flight_id": "1"}


def read(kind: str, groups: list[Group], mapping: ChannelMapping | None = None, **said: str) -> DecodedRecord:
    content_type, written = LAYOUTS[kind]
    return decode(written(groups), content_type, "", {**METADATA, **said}, LIMITS, mapping=mapping)


def refused(kind: str, groups: list[Group], mapping: ChannelMapping | None = None) -> dict[str, str]:
    with pytest.raises(Invalid) as problem:
        read(kind, groups, mapping)
    return {fault.where: fault.problem for fault in problem.value.errors}


def same(decoded: DecodedRecord, name: str, samples: Any) -> None:
    assert np.array_equal(decoded.recording[name], samples, equal_nan=True), name


@pytest.mark.parametrize("kind", LAYOUTS)
def test_a_group_for_every_channel_is_one_record(kind: str) -> None:
    decoded = read(kind, [Group(f"g_{name}", {name: samples}) for name, samples in FLIGHT.items()])
    for name, samples in FLIGHT.items():
        same(decoded, name, samples)
    same(decoded, "time_s", np.arange(N) * 1.0)
    assert decoded.metadata.started_at.astimezone(UTC) == START


@pytest.mark.parametrize("kind", LAYOUTS)
def test_a_slow_channel_stands_at_its_own_times(kind: str) -> None:
    decoded = read(kind, [Group("fast", OTHERS), Group("slow", {SLOW: FLIGHT[SLOW][::10]}, 10.0)])
    expected = np.full(N, np.nan)
    expected[::10] = FLIGHT[SLOW][::10]
    same(decoded, SLOW, expected)
    for name, samples in OTHERS.items():
        same(decoded, name, samples)


@pytest.mark.parametrize("kind", LAYOUTS)
def test_a_group_that_starts_later_is_not_laid_on_the_others_by_index(kind: str) -> None:
    late = {"case_pressure_bar": FLIGHT["case_pressure_bar"][30:]}
    first = {name: samples for name, samples in FLIGHT.items() if name not in late}
    decoded = read(kind, [Group("first", first), Group("late", late, start_s=30.0)])
    expected = FLIGHT["case_pressure_bar"].copy()
    expected[:30] = np.nan
    same(decoded, "case_pressure_bar", expected)
    same(decoded, "discharge_pressure_bar", FLIGHT["discharge_pressure_bar"])


@pytest.mark.parametrize("kind", LAYOUTS)
def test_an_early_slow_group_before_a_fast_one_is_not_lost(kind: str) -> None:
    """The pump-off stretch of the temperature was recorded before the fast group was switched on."""
    fast = {name: samples[50:] for name, samples in OTHERS.items()}
    decoded = read(kind, [Group("fast", fast, start_s=50.0), Group("slow", {SLOW: FLIGHT[SLOW][::10]}, 10.0)])
    time = decoded.recording.time_s
    assert list(time[:6]) == [0.0, 10.0, 20.0, 30.0, 40.0, 50.0]
    assert np.array_equal(time[5:], np.arange(50.0, N))
    assert np.array_equal(decoded.recording[SLOW][:5], FLIGHT[SLOW][:50:10])
    assert np.isnan(decoded.recording["case_pressure_bar"][:5]).all()
    assert np.array_equal(decoded.recording["case_pressure_bar"][5:], FLIGHT["case_pressure_bar"][50:])
    assert decoded.metadata.started_at == START


@pytest.mark.parametrize("kind", LAYOUTS)
def test_foreign_columns_refuse_nothing(kind: str) -> None:
    foreign = {
        "phase": [b"ground"] * 40 + [b"flight"] * (N - 40),
        "gear_down": np.arange(N) < 100,
        "counter": np.arange(N, dtype=np.int32),
    }
    decoded = read(kind, [Group("all", {**FLIGHT, **foreign}), Group("odd", {"engine_nm": np.arange(7.0)}, 13.0)])
    assert "phase (text)" in str(decoded.recording.attributes["not_kept"])
    same(decoded, "counter", np.arange(N) * 1.0)
    same(decoded, "gear_down", (np.arange(N) < 100) * 1.0)
    engine = decoded.recording["engine_nm"]
    assert np.array_equal(np.flatnonzero(np.isfinite(engine)), 13 * np.arange(7))
    assert np.array_equal(engine[::13][:7], np.arange(7.0))


@pytest.mark.parametrize("kind", LAYOUTS)
def test_one_name_in_two_groups_is_refused_by_the_names_of_both(kind: str) -> None:
    found = refused(kind, [Group("left", FLIGHT), Group("right", {"case_pressure_bar": np.arange(N) / 100.0})])
    problem = found["channels.case_pressure_bar"]
    assert "left" in problem
    assert "right" in problem
    # the same samples twice are one channel
    same(read(kind, [Group("left", FLIGHT), Group("again", dict(FLIGHT))]), SLOW, FLIGHT[SLOW])


@pytest.mark.parametrize("kind", LAYOUTS)
def test_the_file_s_own_unit_is_used_and_contradicts_loudly(kind: str) -> None:
    wrong = refused(kind, [Group("all", FLIGHT, units={"case_pressure_bar": "kPa"})])
    assert "kPa" in wrong["channels.case_pressure_bar"]
    # bar says nothing new
    same(read(kind, [Group("all", FLIGHT, units={"case_pressure_bar": "bar"})]), SLOW, FLIGHT[SLOW])
    mapping = ChannelMapping.model_validate({"channels": [{"source": "p_case", "channel": "case_pressure_bar"}]})
    channels = {n: v for n, v in FLIGHT.items() if n != "case_pressure_bar"} | {
        "p_case": FLIGHT["case_pressure_bar"] * 100
    }
    decoded = read(kind, [Group("all", channels, units={"p_case": "kPa"})], mapping)
    assert np.allclose(decoded.recording["case_pressure_bar"], FLIGHT["case_pressure_bar"], rtol=1e-12)


@pytest.mark.parametrize("kind", ["tdms", "hdf5 with instants"])
def test_the_parser_s_process_hands_over_every_clock(kind: str, tmp_path: Any) -> None:
    from service.ingest.decode import checked
    from service.ingest.parser_pool import ParserLimits

    content_type, written = LAYOUTS[kind]
    late = {"case_pressure_bar": FLIGHT["case_pressure_bar"][30:]}
    first = {name: samples for name, samples in FLIGHT.items() if name not in late}
    path = tmp_path / "record"
    path.write_bytes(written([Group("first", first), Group("late", late, start_s=30.0)]))
    pool = ParserPool(tmp_path / "spool", ParserLimits(seconds=20.0))
    try:
        decoded = checked(pool.parsed(path, content_type, "", LIMITS), METADATA)
    finally:
        pool.close()
    assert np.array_equal(decoded.recording["case_pressure_bar"][30:], FLIGHT["case_pressure_bar"][30:])
    assert decoded.metadata.started_at == START
