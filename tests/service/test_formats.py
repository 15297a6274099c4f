"""Binary formats carry the same record as CSV; a damaged file or a missing reader is said clearly."""

import builtins
import dataclasses
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from service.demo.fleet import DemoRecord
from service.errors import Invalid, TooLarge, Undecodable, UnknownType
from service.ingest.decode import DecodedRecord, Limits, decode
from twin.recording import Recording

LIMITS = Limits(50_000_000, 100_000)
PARQUET, HDF5 = "application/vnd.apache.parquet", "application/x-hdf5"
MDF4, TDMS, MATLAB = "application/x-mdf4", "application/x-tdms", "application/x-matlab-data"
EXTRAS = {PARQUET: "parquet", HDF5: "hdf5", MDF4: "mdf4", TDMS: "tdms", MATLAB: "matlab"}


@pytest.fixture(scope="module")
def plain(healthy_records: list[DemoRecord]) -> DecodedRecord:
    return decode(healthy_records[0].content, "text/csv", "", {}, LIMITS)


def metadata(record: DecodedRecord) -> dict[str, str]:
    names = ("pump_serial", "aircraft", "position", "flight_id")
    values = {name: getattr(record.metadata, name) for name in names}
    return {
        **values,
        "started_at": record.metadata.started_at.isoformat(),
        "flight_hours": str(record.metadata.flight_hours),
    }


def as_parquet(record: DecodedRecord) -> bytes:
    table = pa.table(dict(record.recording.channels)).replace_schema_metadata(metadata(record))
    out = io.BytesIO()
    pq.write_table(table, out)
    return out.getvalue()


def as_hdf5(record: DecodedRecord, group: str = "") -> bytes:
    out = io.BytesIO()
    with h5py.File(out, "w") as file:
        place = file.create_group(group) if group else file
        for name, samples in record.recording.channels.items():
            place.create_dataset(name, data=samples)
        place.attrs.update(metadata(record))
    return out.getvalue()


def as_mdf4(record: DecodedRecord) -> bytes:
    from asammdf import MDF, Signal

    time = record.recording.time_s
    with MDF(version="4.10") as file:
        file.append(
            [
                Signal(samples=samples, timestamps=time, name=name)
                for name, samples in record.recording.channels.items()
                if name != "time_s"
            ],
            common_timebase=True,
        )
        file.header._common_properties.update(metadata(record))
        out = io.BytesIO()
        file.save(out)
    return out.getvalue()


def as_tdms(record: DecodedRecord) -> bytes:
    from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter

    out = io.BytesIO()
    with TdmsWriter(out) as writer:
        channels = [ChannelObject("flight", name, samples) for name, samples in record.recording.channels.items()]
        writer.write_segment([RootObject({}), GroupObject("flight", metadata(record)), *channels])
    return out.getvalue()


def as_matlab(record: DecodedRecord, *, in_a_struct: bool = False) -> bytes:
    from scipy.io import savemat

    out = io.BytesIO()
    values = {**record.recording.channels, **metadata(record)}
    savemat(out, {"record": values} if in_a_struct else values, do_compression=True)
    return out.getvalue()


WRITERS: dict[str, tuple[str, Callable[[DecodedRecord], bytes]]] = {
    "parquet": (PARQUET, as_parquet),
    "hdf5": (HDF5, as_hdf5),
    "hdf5 in a group": (HDF5, lambda record: as_hdf5(record, "flight")),
    "mdf4": (MDF4, as_mdf4),
    "tdms": (TDMS, as_tdms),
    "matlab": (MATLAB, as_matlab),
    "matlab struct": (MATLAB, lambda record: as_matlab(record, in_a_struct=True)),
}


@pytest.fixture(scope="module")
def long(plain: DecodedRecord) -> DecodedRecord:
    """60,000 samples at 10 Hz: a flight of 100 minutes, with missing samples."""
    rng = np.random.default_rng(3)
    n = 60_000
    running = np.arange(n) > 600
    channels = {
        "time_s": np.arange(n) / 10.0,
        "discharge_pressure_bar": np.where(running, 175.0, 1.0) + rng.normal(0, 0.1, n),
        "case_pressure_bar": np.where(running, 0.9, 0.5) + rng.normal(0, 0.003, n),
        "shaft_speed_rpm": np.where(running, 4600.0, 0.0),
        "fluid_temperature_degc": 50.0 + rng.normal(0, 0.05, n),
        "foreign_torque_nm": rng.normal(0, 1, n),
    }
    channels["case_pressure_bar"][::1000] = np.nan
    return DecodedRecord(plain.metadata, Recording(channels))


@pytest.mark.parametrize("named", [True, False], ids=["by content type", "by first bytes"])
@pytest.mark.parametrize("kind", WRITERS)
def test_binary_formats_carry_a_long_record_exactly(long: DecodedRecord, kind: str, named: bool) -> None:
    content_type, written = WRITERS[kind]
    decoded = decode(written(long), content_type if named else "application/octet-stream", "", {}, LIMITS)
    assert decoded.metadata == dataclasses.replace(long.metadata, foreign=decoded.metadata.foreign)
    for name, samples in long.recording.channels.items():
        assert np.array_equal(decoded.recording[name], samples, equal_nan=True), name


@pytest.mark.parametrize("kind", WRITERS)
def test_damaged_files_are_undecodable(plain: DecodedRecord, kind: str) -> None:
    content_type, written = WRITERS[kind]
    content = written(plain)
    for broken in (content[: len(content) // 2], content[:12], b"nothing of the kind"):
        with pytest.raises((Undecodable, Invalid)):
            decode(broken, content_type, "", {}, LIMITS)


@pytest.mark.parametrize("kind", WRITERS)
def test_too_many_rows_are_refused_before_they_are_read(plain: DecodedRecord, kind: str) -> None:
    content_type, written = WRITERS[kind]
    with pytest.raises(TooLarge):
        decode(written(plain), content_type, "", {}, Limits(50_000_000, 100))
    with pytest.raises(TooLarge):
        decode(written(plain), content_type, "", {}, Limits(1000, 100_000))


def test_a_matlab_bomb_is_refused_before_it_is_decoded() -> None:
    from scipy.io import savemat

    out = io.BytesIO()
    savemat(out, {"time_s": np.zeros(5_000_000)}, do_compression=True)
    assert len(out.getvalue()) < 100_000
    with pytest.raises(TooLarge):
        decode(out.getvalue(), MATLAB, "", {}, Limits(1_000_000, 10_000_000))


def test_hdf5_may_not_point_outside_of_itself(tmp_path: Path) -> None:
    outside = tmp_path / "outside.h5"
    with h5py.File(outside, "w") as file:
        file["secret"] = [1.0, 2.0]
    linked, external = io.BytesIO(), io.BytesIO()
    with h5py.File(linked, "w") as file:
        file["time_s"] = h5py.ExternalLink(str(outside), "/secret")
    with h5py.File(external, "w") as file:
        file.create_dataset("time_s", shape=(2,), dtype="f8", external=[(str(outside), 0, 16)])
    for content in (linked.getvalue(), external.getvalue()):
        with pytest.raises((Undecodable, Invalid)) as refused:
            decode(content, HDF5, "", {}, LIMITS)
        assert "channels.time_s" in {fault.where for fault in refused.value.errors}


def test_matlab_7_3_is_told_what_to_do() -> None:
    with pytest.raises(Undecodable, match="-v7"):
        decode(b"MATLAB 7.3 MAT-file, Platform: GLNXA64" + bytes(600), MATLAB, "", {}, LIMITS)


@pytest.mark.parametrize("content_type", EXTRAS)
def test_a_missing_reader_is_named(content_type: str, monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__
    starts = {PARQUET: b"PAR1", HDF5: b"\x89HDF", MDF4: b"MDF     4.10", TDMS: b"TDSm", MATLAB: b"MATLAB 5.0 MAT-file"}

    def without(name: str, *args: Any, **kwargs: Any) -> Any:
        if name.partition(".")[0] in ("pyarrow", "h5py", "asammdf", "nptdms") or name == "scipy.io":
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(UnknownType, match=rf"casedrain\[{EXTRAS[content_type]}\]"):
        decode(starts[content_type] + bytes(200), content_type, "", {}, LIMITS)
