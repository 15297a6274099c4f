"""Several clocks on one base: every sample at its own time, none invented, none lost without a word."""

import time
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.errors import TooLarge
from service.ingest.raw import RawFile, RawRecord, Table
from service.ingest.time_base import on_one_base

START = datetime(2026, 5, 2, 7, 11, tzinfo=UTC)
CASE, SPEED, TEMPERATURE = "case_pressure_bar", "shaft_speed_rpm", "fluid_temperature_degc"


def table(name: str, times: Any, start: datetime | None = None, **channels: Any) -> Table:
    times = np.asarray(times, dtype=np.float64)
    return Table({n: np.asarray(v, dtype=np.float64) for n, v in channels.items()}, name=name, time=times, start=start)


def merged(*tables: Table, **metadata: Any) -> RawRecord:
    return on_one_base(RawFile(metadata, tables))


def times_of(record: RawRecord, name: str) -> Any:
    return record.channels["time_s"][np.isfinite(record.channels[name])]


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    fast=st.sampled_from([0.001, 0.1, 1.0]),
    ratio=st.floats(1.0, 50.0),
    late=st.floats(-20.0, 20.0),
    jitter=st.floats(0.0, 0.2),
    lost=st.floats(0.0, 0.3),
)
def test_no_sample_is_moved_far_and_none_of_the_base_is_touched(
    seed: int, fast: float, ratio: float, late: float, jitter: float, lost: float
) -> None:
    """Against the truth: each sample says its own time, so where it stands says how far it was moved."""
    rng = np.random.default_rng(seed)
    base = (np.arange(300) + jitter * rng.uniform(-1, 1, 300)) * fast
    base = base[rng.random(300) >= lost]
    slow = late * fast + np.arange(40) * fast * ratio * 1.01
    record = merged(table("fast", base, START, **{CASE: base}), table("slow", slow, START, **{TEMPERATURE: slow}))
    zero = datetime.fromisoformat(record.metadata["started_at"])
    assert zero == START
    case, temperature, at = record.channels[CASE], record.channels[TEMPERATURE], record.channels["time_s"]
    assert np.array_equal(case[np.isfinite(case)], base)
    assert np.array_equal(at[np.isfinite(case)], base)
    assert np.all(np.diff(at) >= 0.0)
    there = np.isfinite(temperature)
    moved = np.abs(at[there] - temperature[there])
    assert moved.max() <= max(0.76 * fast, min(1.0, 0.76 * fast * ratio))
    if ratio > 2.0:
        # only where rows of the base are lost there may be none near enough that is free
        missing = np.setdiff1d(slow, temperature[there])
        after = np.clip(np.searchsorted(base, missing), 1, len(base) - 1)
        assert np.all(base[after] - base[after - 1] > 1.5 * fast)
        assert lost > 0.0 or not missing.size


def test_starts_align_whatever_zone_they_are_written_in() -> None:
    tables = (
        table("a", np.arange(100.0), START, **{CASE: np.arange(100.0)}),
        table("b", np.arange(40.0), START + timedelta(seconds=60), **{SPEED: 60.0 + np.arange(40.0)}),
    )
    record = merged(*tables)
    assert np.array_equal(times_of(record, SPEED), record.channels[SPEED][60:])
    # metadata say the instant of time 0 themselves
    assert merged(*tables, started_at="2026-05-02T07:11:00Z").metadata["started_at"] == "2026-05-02T07:11:00Z"


def test_a_burst_inside_a_slow_flight_keeps_both() -> None:
    """Ten seconds at 100 Hz of one pressure; all else was recorded at 1 Hz before, during and after."""
    slow, burst = np.arange(200.0), 100.0 + np.arange(1000) / 100.0
    record = merged(
        table("slow", slow, **{CASE: slow, SPEED: slow, TEMPERATURE: slow}),
        table("burst", burst, discharge_pressure_bar=burst),
    )
    assert np.array_equal(times_of(record, "discharge_pressure_bar"), burst)
    assert np.array_equal(times_of(record, CASE), slow)
    assert np.array_equal(times_of(record, TEMPERATURE), slow)


def test_pressures_lose_nothing_to_a_faster_or_slower_channel() -> None:
    slow, fast = np.arange(50.0), np.arange(4901) / 100.0
    record = merged(table("p", slow, **{CASE: slow}), table("n", fast, **{SPEED: fast, "torque_nm": fast}))
    assert np.array_equal(record.channels["time_s"], slow)
    assert np.array_equal(record.channels[CASE], slow)
    assert np.array_equal(record.channels[SPEED], slow)
    assert "4851 of its 4901 samples" in record.not_kept[SPEED]
    assert "4851 of its 4901 samples" in record.not_kept["torque_nm"]


def test_columns_of_any_length_without_times_are_named() -> None:
    one = table("a", np.arange(20.0), **{CASE: np.arange(20.0), "calibration": np.arange(7.0)})
    record = merged(one, Table({"matrix_row": np.arange(3.0)}, name="b"))
    assert set(record.not_kept) == {"calibration", "matrix_row"}
    assert not record.faults
    assert len(record.channels[CASE]) == 20


def test_a_foreign_name_in_two_tables_gets_the_table_s() -> None:
    times = np.arange(20.0)
    record = merged(
        table("a", times, **{CASE: times, "spare": times}), table("b", times, **{SPEED: times, "spare": -times})
    )
    assert np.array_equal(record.channels["spare"], times)
    assert np.array_equal(record.channels["b.spare"], -times)


def test_what_cannot_be_aligned_is_refused_by_name() -> None:
    times = np.arange(30.0)
    stated = table("stated", times, START, **{CASE: times})
    bare = table("bare", times * 2.0, **{SPEED: times})
    (fault,) = merged(stated, bare).faults
    assert fault.where == f"channels.{SPEED}"
    assert "'stated'" in fault.problem
    assert "'bare'" in fault.problem
    # the very times of a clock with a start are that clock
    assert not merged(stated, table("same", times, **{SPEED: times})).faults
    # a foreign channel is named and refuses nothing
    record = merged(stated, table("bare", times * 2.0, oil_level=times))
    assert not record.faults
    assert "'bare'" in record.not_kept["oil_level"]


def test_a_second_clock_that_was_set_back_is_refused_by_name() -> None:
    times = np.arange(100.0)
    back = np.concatenate((times[:50], times[:50]))
    (fault,) = merged(table("a", times, **{CASE: times}), table("b", back, **{SPEED: times})).faults
    assert "'b' run back by 49 s" in fault.problem
    # neighbours out of order stand where their times say
    swapped = times.copy()
    swapped[[10, 11]] = swapped[[11, 10]]
    record = merged(table("a", times, **{CASE: times}), table("b", swapped, **{SPEED: swapped}))
    assert np.array_equal(record.channels[SPEED], times)


def test_tables_that_contradict_each_other_s_metadata_are_refused() -> None:
    times = np.arange(30.0)
    one = Table({CASE: times}, name="a", time=times, attributes={"pump_serial": "1", "note": "x"})
    other = Table({SPEED: times}, name="b", time=times, attributes={"pump_serial": "2", "note": "y"})
    record = on_one_base(RawFile({}, (one, other)))
    assert [fault.where for fault in record.faults] == ["pump_serial"]
    assert (record.metadata["note"], record.metadata["b.note"]) == ("x", "y")


def test_what_the_base_would_take_is_bounded() -> None:
    fast, slow = np.arange(10_000.0) / 10.0, np.arange(100.0) * 10.0
    foreign = {f"x{i}": slow for i in range(20)}
    tables = (table("fast", fast, **{CASE: fast}), table("slow", slow, **{TEMPERATURE: slow}, **foreign))
    record = on_one_base(RawFile({}, tables), most_bytes=8 * 10_000 * 5)
    assert {TEMPERATURE, "x0", "x1"} < set(record.channels)
    assert "too large" in record.not_kept["x19"]
    with pytest.raises(TooLarge):
        on_one_base(RawFile({}, tables), most_bytes=8 * 10_000 * 2)


def test_twice_the_samples_take_about_twice_the_time() -> None:
    def seconds(n: int) -> float:
        fast, slow = np.arange(float(n)), np.arange(n / 7.0) * 7.3 + 0.4
        begun = time.process_time()
        merged(table("fast", fast, START, **{CASE: fast}), table("slow", slow, START, **{TEMPERATURE: slow, "x": slow}))
        return time.process_time() - begun

    seconds(1000)
    assert seconds(800_000) < 0.3 + 12.0 * seconds(200_000)
