"""What only one format can say: invalid bits, conversions, waveforms, scales, structs, nested and typed columns."""

import io
import struct
import time
from collections.abc import Mapping
from datetime import UTC, datetime
from decimal import Decimal
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from service.errors import Invalid, TooLarge, Undecodable
from service.ingest.decode import Limits, decode
from service.ingest.parse import parsed
from service.ingest.raw import RawFile
from service.ingest.time_base import on_one_base
from tests.service.layouts import HDF5, MATLAB, MDF4, PARQUET, START, TDMS

LIMITS = Limits(200_000_000, 1_000_000)
N = 200
TIME = np.arange(N) * 1.0
CASE = 0.5 + TIME / 1000.0


def record(content: bytes, kind: str) -> Any:
    return on_one_base(read(content, kind))


def read(content: bytes, kind: str) -> RawFile:
    return parsed(content, kind, "", LIMITS)


# MDF4


def mdf4(signals: Any, **options: Any) -> bytes:
    from asammdf import MDF

    with MDF(version="4.10") as file:
        file.header.start_time = START
        file.append(signals, common_timebase=True, **options)
        out = io.BytesIO()
        file.save(out)
    return out.getvalue()


def signal(samples: Any, name: str, **said: Any) -> Any:
    from asammdf import Signal

    return Signal(np.asarray(samples), TIME, name=name, **said)


def test_mdf4_samples_that_the_file_calls_invalid_are_missing() -> None:
    invalid = np.zeros(N, dtype=bool)
    invalid[20:30] = True
    content = mdf4([signal(CASE, "case_pressure_bar", invalidation_bits=invalid), signal(TIME * 2, "other")])
    made = record(content, MDF4)
    assert np.array_equal(made.channels["case_pressure_bar"], np.where(invalid, np.nan, CASE), equal_nan=True)
    assert np.array_equal(made.channels["other"], TIME * 2)


def test_mdf4_conversions_are_applied_and_no_formula_is_run_as_code() -> None:
    raw = np.arange(N, dtype=np.uint16)
    table = {"raw_0": 0, "phys_0": 0.0, "raw_1": 100, "phys_1": 1.0, "interpolation": True}
    content = mdf4(
        [
            signal(raw, "case_pressure_bar", conversion={"a": 0.01, "b": -0.5}),
            signal(raw, "ratio", conversion={"P1": 0, "P2": 2, "P3": 1, "P4": 0, "P5": 0, "P6": 4}),
            signal(raw, "table", conversion=table),
            signal(raw % 2, "phase", conversion={"val_0": 0, "text_0": b"off", "val_1": 1, "text_1": b"on"}),
            signal(raw, "formula", conversion={"formula": "X1**2 * 0.5 - 1"}),
            signal(raw, "code", conversion={"formula": "__import__('os').getpid() + X1"}),
        ]
    )
    found = read(content, MDF4)
    channels = found.tables[0].channels
    assert np.allclose(channels["case_pressure_bar"], raw * 0.01 - 0.5)
    assert np.allclose(channels["ratio"], (2.0 * raw + 1.0) / 4.0)
    assert np.allclose(channels["table"], np.minimum(raw, 100) / 100.0)
    assert found.tables[0].texts["phase"][:2] == ["off", "on"]
    assert np.allclose(channels["formula"], raw.astype(float) ** 2 * 0.5 - 1.0)
    assert "formula" in found.not_kept["code"]


def test_mdf4_arrays_structures_and_bytes_are_named_and_refuse_nothing() -> None:
    array = np.rec.array([(np.arange(3) + i,) for i in range(N)], dtype=[("wave", "(3,)<f8")])
    pair = np.rec.fromarrays([TIME, TIME * 2], names="left,right")
    content = mdf4([signal(CASE, "case_pressure_bar"), signal(array, "wave"), signal(pair, "pair")])
    made = record(content, MDF4)
    assert {made.not_kept["wave"], made.not_kept["pair"]} == {"an array", "a structure"}
    assert np.array_equal(made.channels["right"], TIME * 2)
    assert np.array_equal(made.channels["case_pressure_bar"], CASE)


def test_mdf4_a_file_that_was_cut_says_so() -> None:
    content = mdf4([signal(CASE, "case_pressure_bar")])
    for size in range(200, len(content) - 200, len(content) // 9):
        with pytest.raises(Undecodable, match="cut short"):
            read(content[:size], MDF4)


def test_mdf4_links_in_a_circle_and_unfinished_files_end_in_time() -> None:
    content = bytearray(mdf4([signal(CASE, "case_pressure_bar")]))
    for block, link in ((b"##DG", 0), (b"##CN", 0), (b"##CN", 1)):
        circle = bytearray(content)
        place = circle.index(block)
        struct.pack_into("<Q", circle, place + 24 + 8 * link, place)
        begun = time.monotonic()
        with pytest.raises(Undecodable, match="circle"):
            read(bytes(circle), MDF4)
        assert time.monotonic() - begun < 2.0
    unfinished = b"UnFinMF " + bytes(content[8:])
    assert np.array_equal(record(unfinished, MDF4).channels["case_pressure_bar"], CASE)


# TDMS


def tdms(channels: Mapping[str, tuple[Any, dict[str, Any]]], group: str = "rig") -> bytes:
    from nptdms import ChannelObject, TdmsWriter

    out = io.BytesIO()
    with TdmsWriter(out) as writer:
        writer.write_segment([ChannelObject(group, name, data, said) for name, (data, said) in channels.items()])
    return out.getvalue()


def waveform(start: datetime | None = START, step: float = 1.0, offset: float = 0.0) -> dict[str, Any]:
    at = {} if start is None else {"wf_start_time": np.datetime64(start.replace(tzinfo=None))}
    return {**at, "wf_increment": step, "wf_start_offset": offset}


def test_tdms_waveforms_of_one_group_stand_at_their_own_start_offset_and_step() -> None:
    made = record(
        tdms(
            {
                "discharge_pressure_bar": (CASE, waveform()),
                "case_pressure_bar": (CASE[60:], waveform(START.replace(minute=12))),
                "fluid_temperature_degc": (CASE[::10], waveform(step=10.0)),
                "shaft_speed_rpm": (CASE[5:], waveform(offset=5.0)),
            }
        ),
        TDMS,
    )
    assert np.array_equal(made.channels["time_s"], TIME)
    assert np.array_equal(made.channels["case_pressure_bar"], np.where(TIME < 60, np.nan, CASE), equal_nan=True)
    assert np.array_equal(made.channels["shaft_speed_rpm"], np.where(TIME < 5, np.nan, CASE), equal_nan=True)
    assert np.array_equal(made.channels["fluid_temperature_degc"][::10], CASE[::10])
    assert datetime.fromisoformat(made.metadata["started_at"]) == START


def test_tdms_clocks_that_were_never_set_align_and_say_no_instant() -> None:
    boot = datetime(1970, 1, 1, tzinfo=UTC)
    late = waveform(boot.replace(minute=1))
    made = record(
        tdms({"discharge_pressure_bar": (CASE, waveform(boot)), "case_pressure_bar": (CASE[60:], late)}), TDMS
    )
    assert np.array_equal(made.channels["case_pressure_bar"], np.where(TIME < 60, np.nan, CASE), equal_nan=True)
    assert "started_at" not in made.metadata


def test_tdms_a_start_beside_none_cannot_be_aligned() -> None:
    made = record(
        tdms({"discharge_pressure_bar": (CASE, waveform()), "case_pressure_bar": (CASE, waveform(None, 0.5))}), TDMS
    )
    assert [fault.where for fault in made.faults] == ["channels.case_pressure_bar"]
    assert "rig" in made.faults[0].problem


def test_tdms_a_column_of_instants_is_the_group_s_clock() -> None:
    instants = np.datetime64("2026-05-02T07:11:00", "us") + (TIME * 2e6).astype("timedelta64[us]")
    words = ["a"] * N
    made = record(tdms({"Timestamp": (instants, {}), "case_pressure_bar": (CASE, {}), "note": (words, {})}), TDMS)
    assert np.array_equal(made.channels["time_s"], TIME * 2)
    assert datetime.fromisoformat(made.metadata["started_at"]) == START
    assert set(made.not_kept) == {"Timestamp", "note"}


def test_tdms_scales_of_the_file_are_applied_and_a_cut_segment_keeps_what_is_whole() -> None:
    scale = {
        "NI_Number_Of_Scales": 1,
        "NI_Scale[0]_Scale_Type": "Linear",
        "NI_Scale[0]_Linear_Slope": 0.01,
        "NI_Scale[0]_Linear_Y_Intercept": -0.5,
        "NI_Scale[0]_Linear_Input_Source": 0xFFFFFFFF,
    }
    raw = np.arange(N, dtype=np.int16)
    whole = tdms({"discharge_pressure_bar": (CASE, waveform()), "case_pressure_bar": (raw, {**waveform(), **scale})})
    assert np.allclose(record(whole, TDMS).channels["case_pressure_bar"], raw * 0.01 - 0.5)
    cut = record(whole + whole[:-300], TDMS)
    assert np.allclose(cut.channels["case_pressure_bar"][:N], raw * 0.01 - 0.5)
    assert any("cut short" in flag for flag in cut.flags)


def test_tdms_a_file_cut_before_a_required_channel_says_so() -> None:
    whole = tdms({"case_pressure_bar": (CASE, waveform()), "shaft_speed_rpm": (CASE, waveform())})
    made = record(whole[: -8 * N], TDMS)
    assert any("cut short" in fault.problem for fault in made.faults)


def test_tdms_segments_without_number_are_refused() -> None:
    lead_in = b"TDSm" + struct.pack("<IIQQI", 0x2 | 0x4 | 0x8, 4713, 4, 4, 0)
    with pytest.raises(TooLarge, match="defragment"):
        read(lead_in * 150_000, TDMS)


# HDF5


def hdf5(write: Any) -> bytes:
    out = io.BytesIO()
    with h5py.File(out, "w") as file:
        write(file)
    return out.getvalue()


def test_hdf5_dimension_scales_and_packed_numbers_as_netcdf_writes_them() -> None:
    def write(file: Any) -> None:
        for name, step, since in (("fast", 1.0, "2026-05-02T07:11:00Z"), ("slow", 10.0, "2026-05-02 07:10:50")):
            file[f"{name}_axis"] = np.arange(0.0, N, step)
            file[f"{name}_axis"].attrs["units"] = f"seconds since {since}"
            file[f"{name}_axis"].make_scale()
        packed = np.round(CASE * 1000.0).astype(np.int16)
        packed[7] = -32768
        file["case_pressure_bar"] = packed
        file["case_pressure_bar"].attrs.update({"scale_factor": 0.001, "_FillValue": np.int16(-32768), "units": "bar"})
        file["case_pressure_bar"].dims[0].attach_scale(file["fast_axis"])
        file["fluid_temperature_degc"] = CASE[::10]
        file["fluid_temperature_degc"].dims[0].attach_scale(file["slow_axis"])

    made = record(hdf5(write), HDF5)
    assert np.array_equal(made.channels["time_s"][:3], [0.0, 10.0, 11.0])
    assert made.metadata["started_at"] == "2026-05-02T07:10:50+00:00"
    case = made.channels["case_pressure_bar"][1:]
    assert np.isnan(case[7])
    assert np.allclose(np.delete(case, 7), np.delete(np.round(CASE * 1000) / 1000, 7))


@pytest.mark.parametrize("called", [("axis", "time"), ("t", "")])
def test_hdf5_a_dimension_scale_called_time_needs_no_unit(called: tuple[str, str]) -> None:
    def write(file: Any) -> None:
        file[called[0]] = TIME / 2
        file[called[0]].make_scale(called[1])
        file["case_pressure_bar"] = CASE
        file["case_pressure_bar"].dims[0].attach_scale(file[called[0]])

    assert np.array_equal(record(hdf5(write), HDF5).channels["time_s"], TIME / 2)


def test_hdf5_groups_at_any_depth_scalars_enumerations_matrices_and_tables() -> None:
    def write(file: Any) -> None:
        deep = file.create_group("a/b/c/d")
        deep["time_s"], deep["case_pressure_bar"] = TIME, CASE
        deep["matrix"], deep["pump_serial"] = np.zeros((N, 3)), "P-1"
        deep["flight_hours"] = 12.5
        kind = h5py.enum_dtype({"OFF": 0, "ON": 1}, basetype="i1")
        deep.create_dataset("phase", data=np.arange(N) % 2, dtype=kind)
        deep["sensors/reservoir_pressure_bar"] = CASE * 2  # on the clock of the group around it
        rows = np.rec.fromarrays([TIME, CASE * 3], names="time_s,discharge_pressure_bar")
        file["table"] = rows

    found = read(hdf5(write), HDF5)
    made = on_one_base(found)
    for name, factor in (("case_pressure_bar", 1), ("reservoir_pressure_bar", 2), ("discharge_pressure_bar", 3)):
        assert np.array_equal(made.channels[name], CASE * factor), name
    assert (made.metadata["pump_serial"], made.metadata["flight_hours"]) == ("P-1", 12.5)
    assert made.not_kept == {"matrix": "a matrix of 200 x 3", "phase": "text"}
    assert any(table.texts.get("phase", [])[:2] == ["OFF", "ON"] for table in found.tables)


def test_hdf5_circles_end_and_no_link_leads_outside(tmp_path: Any) -> None:
    outside = tmp_path / "outside.h5"
    with h5py.File(outside, "w") as file:
        file["g/case_pressure_bar"] = CASE

    def write(file: Any) -> None:
        file["time_s"] = TIME
        file["g/again"] = file["/"]
        file["away"] = h5py.ExternalLink(str(outside), "/g")
        file["case_pressure_bar"] = h5py.SoftLink("/away/case_pressure_bar")
        file["discharge_pressure_bar"] = h5py.SoftLink("/g/raw")
        file["g/raw"] = CASE

    made = record(hdf5(write), HDF5)
    assert np.array_equal(made.channels["discharge_pressure_bar"], CASE)
    assert "case_pressure_bar" not in made.channels
    assert [fault.where for fault in made.faults] == ["channels.case_pressure_bar"]


def test_hdf5_a_damaged_heap_of_texts_is_refused_before_the_library_hangs_on_it() -> None:
    def write(file: Any) -> None:
        file["time_s"], file["note"] = TIME, ["ground"] * N

    content = bytearray(hdf5(write))
    assert read(bytes(content), HDF5).tables[0].texts["note"] == ["ground"] * N
    last = content.rindex(b"ground", 0, content.index(b"GCOL") + 4096) + 8
    content[last : last + 16] = bytes(16)
    with pytest.raises(Undecodable, match="damaged"):
        read(bytes(content), HDF5)


def test_hdf5_groups_without_times_are_never_laid_on_each_other() -> None:
    def write(file: Any) -> None:
        file["clock/time_s"] = TIME
        for name in ("discharge_pressure_bar", "case_pressure_bar"):
            file[f"{name}/{name}"] = CASE

    with pytest.raises(Invalid) as refused:
        decode(hdf5(write), HDF5, "", {}, LIMITS)
    found = {fault.where: fault.problem for fault in refused.value.errors}
    assert "'case_pressure_bar'" in found["channels.case_pressure_bar"]
    assert "no times" in found["channels.case_pressure_bar"]


@pytest.mark.parametrize("epoch", ["1970-01-01", "2026-05-02 07:00:00"])
def test_hdf5_a_time_s_since_an_instant_says_when_it_started(epoch: str) -> None:
    since = (START.replace(tzinfo=None) - datetime.fromisoformat(epoch)).total_seconds()

    def write(file: Any) -> None:
        file["time_s"], file["case_pressure_bar"] = TIME + since, CASE
        file["time_s"].attrs["units"] = f"seconds since {epoch}"

    made = record(hdf5(write), HDF5)
    begun = datetime.fromisoformat(made.metadata["started_at"]).timestamp()
    assert np.array_equal(begun + made.channels["time_s"], START.timestamp() + TIME)


# MATLAB


def matlab(**variables: Any) -> bytes:
    from scipy.io import savemat

    out = io.BytesIO()
    savemat(out, variables, do_compression=True)
    return out.getvalue()


def test_matlab_arrays_of_structs_are_channels_by_their_names() -> None:
    signals = np.zeros(2, dtype=[("name", object), ("data", object), ("units", object)])
    signals[0] = ("case_pressure_bar", CASE, "bar")
    signals[1] = ("discharge_pressure_bar", CASE * 2, "bar")
    made = record(matlab(rec={"time_s": TIME, "signals": signals, "pump_serial": 4711.0}), MATLAB)
    assert np.array_equal(made.channels["case_pressure_bar"], CASE)
    assert np.array_equal(made.channels["discharge_pressure_bar"], CASE * 2)
    assert made.metadata["pump_serial"] == 4711.0


def test_matlab_7_3_keeps_an_array_of_structs_as_references_field_by_field() -> None:
    def write(file: Any) -> None:
        held = {"name": ["case_pressure_bar", "discharge_pressure_bar"], "data": [CASE, CASE * 2], "time": [TIME, TIME]}
        signals = file.create_group("record/signals")
        for field, entries in held.items():
            places = []
            for i, entry in enumerate(entries):
                is_text = isinstance(entry, str)
                values = np.array([ord(c) for c in entry], np.uint16) if is_text else entry
                place = file.create_dataset(f"#refs#/{field}{i}", data=values.reshape(-1, 1))
                place.attrs["MATLAB_class"] = np.bytes_("char" if is_text else "double")
                places.append(place.ref)
            signals.create_dataset(field, data=np.array(places, dtype=h5py.ref_dtype).reshape(-1, 1))

    made = record(hdf5(write), HDF5)
    assert np.array_equal(made.channels["case_pressure_bar"], CASE)
    assert np.array_equal(made.channels["discharge_pressure_bar"], CASE * 2)
    assert np.array_equal(made.channels["time_s"], TIME)


def test_matlab_timeseries_as_structs_and_day_numbers_where_the_file_says_so() -> None:
    days = 739_374.0 + (7 * 3600 + 11 * 60 + TIME) / 86_400.0  # 2 May 2024, 07:11
    series = {"Data": CASE, "Time": days, "TimeInfo": {"Units": "datenum"}, "DataInfo": {"Units": "bar"}}
    made = record(matlab(case_pressure_bar=series), MATLAB)
    assert np.allclose(made.channels["time_s"], TIME, atol=1e-4)
    assert made.metadata["started_at"].startswith("2024-05-02T07:1")


def test_matlab_objects_are_named_with_what_to_do() -> None:
    """An opaque element as MATLAB writes timetables: array flags of class 17, then names of the variable and its class."""

    def element(kind: int, data: bytes) -> bytes:
        return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)

    flags = element(6, struct.pack("<II", 17, 0))
    inside = element(6, struct.pack("<II", 13, 0)) + element(5, struct.pack("<ii", 1, 1)) + element(1, b"")
    numbers = inside + element(6, struct.pack("<I", 1))
    opaque = flags + element(1, b"flight") + element(1, b"MCOS") + element(1, b"timetable") + element(14, numbers)
    plain = matlab(time_s=TIME, case_pressure_bar=CASE)
    made = record(plain + element(14, opaque), MATLAB)
    assert np.array_equal(made.channels["case_pressure_bar"], CASE)
    assert any("timetable2table" in what for what in made.not_kept.values())


# Parquet


def parquet(table: Any) -> bytes:
    out = io.BytesIO()
    pq.write_table(table, out)
    return out.getvalue()


def test_parquet_nested_structs_and_columns_of_every_type() -> None:
    instants = np.datetime64("2026-05-02T07:11:00", "us") + (TIME * 1e6).astype("timedelta64[us]")
    table = pa.table(
        {
            "pressures": pa.StructArray.from_arrays(
                [pa.array(CASE), pa.StructArray.from_arrays([pa.array(CASE * 2)], ["discharge_pressure_bar"])],
                ["case_pressure_bar", "supply"],
            ),
            "timestamp": pa.array(instants).cast(pa.timestamp("us", "UTC")),
            "made": pa.array(instants),
            "since": pa.array((TIME * 1e3).astype("timedelta64[ms]")),
            "cost": pa.array([Decimal("1.50")] * N),
            "phase": pa.array(["on", None] * (N // 2)).dictionary_encode(),
            "levels": pa.array(np.arange(N) % 3).dictionary_encode(),
            "rows": pa.array([[1.0, 2.0]] * N),
            "on": pa.array(np.arange(N) % 2 == 0),
            "blob": pa.array([b"x"] * N),
            "gaps": pa.array([None, 1] * (N // 2)),
        }
    )
    made = record(parquet(table), PARQUET)
    assert np.array_equal(made.channels["case_pressure_bar"], CASE)
    assert np.array_equal(made.channels["discharge_pressure_bar"], CASE * 2)
    assert np.array_equal(made.channels["time_s"], TIME)
    assert made.metadata["started_at"] == "2026-05-02T07:11:00+00:00"
    assert np.array_equal(made.channels["since"], TIME)
    assert np.array_equal(made.channels["levels"], np.arange(N) % 3)
    assert made.channels["cost"][0] == 1.5
    assert np.isnan(made.channels["gaps"][0])
    assert set(made.not_kept) == {"timestamp", "made", "phase", "rows", "blob"}


def test_parquet_instants_and_durations_called_time_s_are_time() -> None:
    instants = pa.array(np.datetime64("2026-05-02T07:11:00", "us") + (TIME * 1e6).astype("timedelta64[us]"))
    made = record(
        parquet(pa.table({"time_s": instants.cast(pa.timestamp("us", "UTC")), "case_pressure_bar": CASE})), PARQUET
    )
    assert np.array_equal(made.channels["time_s"], TIME)
    assert datetime.fromisoformat(made.metadata["started_at"]) == START
    durations = pa.array((TIME * 1e3).astype("timedelta64[ms]"))
    made = record(parquet(pa.table({"time_s": durations, "case_pressure_bar": CASE})), PARQUET)
    assert np.array_equal(made.channels["time_s"], TIME)


@pytest.mark.parametrize("name", ["time", "wann", None])
def test_parquet_a_frame_of_pandas_is_read_by_its_index(name: str | None) -> None:
    index = pd.date_range("2026-05-02T07:11:00Z", periods=N, freq="500ms", name=name)
    out = io.BytesIO()
    pd.DataFrame({"case_pressure_bar": CASE}, index=index).to_parquet(out)
    made = record(out.getvalue(), PARQUET)
    assert np.array_equal(made.channels["time_s"], TIME / 2)
    assert datetime.fromisoformat(made.metadata["started_at"]) == START


# No format is quadratic


@pytest.mark.parametrize("kind", ["parquet", "hdf5", "tdms", "mdf4"])
def test_twice_the_columns_take_twice_the_time(kind: str) -> None:
    """Ten rows: what is measured is what a column costs."""

    def seconds(n: int) -> float:
        columns = {f"c{i}": np.arange(10.0) for i in range(n)}
        if kind == "parquet":
            content, content_type = parquet(pa.table(columns)), PARQUET
        elif kind == "hdf5":
            content, content_type = (
                hdf5(lambda file: [file.create_dataset(k, data=v) for k, v in columns.items()]),
                HDF5,
            )
        elif kind == "tdms":
            content, content_type = tdms({k: (v, waveform()) for k, v in columns.items()}), TDMS
        else:
            from asammdf import Signal

            content, content_type = mdf4([Signal(v, np.arange(10.0), name=k) for k, v in columns.items()]), MDF4
        record(content, content_type)
        begun = time.process_time()
        record(content, content_type)
        return time.process_time() - begun

    assert seconds(800) < 1.0 + 8.0 * seconds(200)


def test_a_file_of_too_many_objects_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.ingest.hdf5_format._MOST_OBJECTS", 50)
    with pytest.raises(TooLarge, match="50 objects"):
        read(hdf5(lambda file: [file.create_group(f"g{i}") for i in range(100)]), HDF5)
