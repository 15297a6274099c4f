"""Files of every binary format with groups as an operator's recorder lays them out: rates, starts, units, columns apart."""

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

START = datetime(2026, 5, 2, 7, 11, tzinfo=UTC)
PARQUET, HDF5 = "application/vnd.apache.parquet", "application/x-hdf5"
MDF4, TDMS, MATLAB = "application/x-mdf4", "application/x-tdms", "application/x-matlab-data"


@dataclass(frozen=True)
class Group:
    """One group: channels of one length, evenly spaced from ``start_s`` after the record's start."""

    name: str
    channels: Mapping[str, Any]
    period_s: float = 1.0
    start_s: float = 0.0
    units: Mapping[str, str] = field(default_factory=dict)

    @property
    def times(self) -> Any:
        n = len(next(iter(self.channels.values())))
        return self.start_s + np.arange(n) * self.period_s


def as_mdf4(groups: Sequence[Group]) -> bytes:
    from asammdf import MDF, Signal

    with MDF(version="4.10") as file:
        file.header.start_time = START
        for group in groups:
            signals = [
                Signal(np.asarray(v), group.times, name=n, unit=group.units.get(n, ""), encoding=_encoding(v))
                for n, v in group.channels.items()
            ]
            file.append(signals, acq_name=group.name, common_timebase=True)
        out = io.BytesIO()
        file.save(out)
    return out.getvalue()


def _encoding(values: Any) -> str | None:
    return "utf-8" if np.asarray(values).dtype.kind == "S" else None


def as_tdms(groups: Sequence[Group]) -> bytes:
    from nptdms import ChannelObject, TdmsWriter

    out = io.BytesIO()
    with TdmsWriter(out) as writer:
        writer.write_segment(
            [
                ChannelObject(
                    group.name,
                    name,
                    [v.decode() for v in values] if _encoding(values) else np.asarray(values),
                    {
                        "wf_start_time": np.datetime64((START + timedelta(seconds=group.start_s)).replace(tzinfo=None)),
                        "wf_increment": group.period_s,
                        "wf_start_offset": 0.0,
                        **({"unit_string": group.units[name]} if name in group.units else {}),
                    },
                )
                for group in groups
                for name, values in group.channels.items()
            ]
        )
    return out.getvalue()


def as_hdf5(groups: Sequence[Group]) -> bytes:
    """Times as netCDF writes them, each group from its own instant."""
    out = io.BytesIO()
    with h5py.File(out, "w") as file:
        for group in groups:
            place = file.create_group(f"flight/{group.name}")
            started = START + timedelta(seconds=group.start_s)
            place["time"] = group.times - group.start_s
            place["time"].attrs["units"] = f"seconds since {started:%Y-%m-%d %H:%M:%S}"
            for name, values in group.channels.items():
                place[name] = values
                if name in group.units:
                    place[name].attrs["units"] = group.units[name]
    return out.getvalue()


def as_hdf5_with_time_s(groups: Sequence[Group]) -> bytes:
    out = io.BytesIO()
    with h5py.File(out, "w") as file:
        file.attrs["started_at"] = START.isoformat()
        for group in groups:
            file[f"{group.name}/time_s"] = group.times.reshape(1, -1)
            for name, values in group.channels.items():
                file[f"{group.name}/{name}"] = np.asarray(values).reshape(-1, 1)
                file[f"{group.name}/{name}"].attrs["unit"] = group.units.get(name, "")
    return out.getvalue()


def as_matlab(groups: Sequence[Group]) -> bytes:
    """A struct of structs, each channel with its data, time and units."""
    from scipy.io import savemat

    out = io.BytesIO()
    record: dict[str, Any] = {"started_at": START.isoformat()}
    for group in groups:
        record[group.name] = {
            name: {"data": _cells(values), "time": group.times, "units": group.units.get(name, "")}
            for name, values in group.channels.items()
        }
    savemat(out, {"rec": record})
    return out.getvalue()


def _cells(values: Any) -> Any:
    return np.array([v.decode() for v in values], dtype=object) if _encoding(values) else np.asarray(values)


def as_matlab_7_3(groups: Sequence[Group]) -> bytes:
    """HDF5 behind 512 bytes, vectors as rows, text as uint16."""
    out = io.BytesIO()
    with h5py.File(out, "w", userblock_size=512) as file:
        _text(file, "started_at", START.isoformat())
        for group in groups:
            place = file.create_group(group.name)
            place.attrs["MATLAB_class"] = np.bytes_("struct")
            for name, values in {"time_s": group.times, **group.channels}.items():
                if _encoding(values):
                    cells = place.create_dataset(name, (1, len(values)), h5py.ref_dtype)
                    cells.attrs["MATLAB_class"] = np.bytes_("cell")
                    for i, word in enumerate(values):
                        _text(file, f"#refs#/{name}{i}", word.decode())
                        cells[0, i] = file[f"#refs#/{name}{i}"].ref
                    continue
                place[name] = np.asarray(values).reshape(1, -1)
                place[name].attrs["MATLAB_class"] = np.bytes_("double")
                place[name].attrs["unit"] = group.units.get(name, "")
    header = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, HDF5 schema 1.00 .".ljust(124) + b"\x00\x02IM"
    return header + out.getvalue()[128:]


def _text(place: Any, name: str, text: str) -> None:
    place[name] = np.array([ord(c) for c in text], dtype=np.uint16).reshape(-1, 1)
    place[name].attrs["MATLAB_class"] = np.bytes_("char")


def as_parquet(groups: Sequence[Group]) -> bytes:
    """One row that holds a list of structs for each group, with instants as time."""
    columns = {}
    for group in groups:
        times = np.datetime64(START.replace(tzinfo=None), "us") + (group.times * 1e6).astype("timedelta64[us]")
        fields = [pa.array(times).cast(pa.timestamp("us", "UTC")), *(_arrow(v) for v in group.channels.values())]
        described = [
            pa.field(n, f.type, metadata={"unit": group.units.get(n, "")})
            for n, f in zip(["timestamp", *group.channels], fields, strict=True)
        ]
        structs = pa.StructArray.from_arrays(fields, fields=described)
        columns[group.name] = pa.ListArray.from_arrays([0, len(times)], structs)
    out = io.BytesIO()
    pq.write_table(pa.table(columns), out)
    return out.getvalue()


def _arrow(values: Any) -> Any:
    return pa.array([v.decode() for v in values] if _encoding(values) else np.asarray(values))


LAYOUTS: dict[str, tuple[str, Callable[[Sequence[Group]], bytes]]] = {
    "mdf4": (MDF4, as_mdf4),
    "tdms": (TDMS, as_tdms),
    "hdf5 with instants": (HDF5, as_hdf5),
    "hdf5 with time_s": (HDF5, as_hdf5_with_time_s),
    "matlab": (MATLAB, as_matlab),
    "matlab 7.3": (MATLAB, as_matlab_7_3),
    "parquet": (PARQUET, as_parquet),
}
