"""Binary formats carry the same record as CSV; a damaged file or a missing reader is said clearly."""

import builtins
import io
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from service.demo.fleet import DemoRecord
from service.errors import TooLarge, Undecodable, UnknownType
from service.ingest.decode import DecodedRecord, Limits, decode

LIMITS = Limits(50_000_000, 100_000)
PARQUET, HDF5 = "application/vnd.apache.parquet", "application/x-hdf5"


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


@pytest.mark.parametrize("named", [True, False], ids=["by content type", "by first bytes"])
@pytest.mark.parametrize("kind", ["parquet", "hdf5", "hdf5 in a group"])
def test_binary_formats_say_what_csv_says(plain: DecodedRecord, kind: str, named: bool) -> None:
    content = as_parquet(plain) if kind == "parquet" else as_hdf5(plain, "flight" if "group" in kind else "")
    content_type = (PARQUET if kind == "parquet" else HDF5) if named else "application/octet-stream"
    decoded = decode(content, content_type, "", {}, LIMITS)
    assert decoded.metadata == plain.metadata
    for name, samples in plain.recording.channels.items():
        assert np.array_equal(decoded.recording[name], samples, equal_nan=True)


@pytest.mark.parametrize("content_type", [PARQUET, HDF5])
def test_damaged_files_are_undecodable(plain: DecodedRecord, content_type: str) -> None:
    content = as_parquet(plain) if content_type == PARQUET else as_hdf5(plain)
    for broken in (content[: len(content) // 2], content[:12], b"nothing of the kind"):
        with pytest.raises(Undecodable):
            decode(broken, content_type, "", {}, LIMITS)


@pytest.mark.parametrize("content_type", [PARQUET, HDF5])
def test_too_many_rows_are_refused_before_they_are_read(plain: DecodedRecord, content_type: str) -> None:
    content = as_parquet(plain) if content_type == PARQUET else as_hdf5(plain)
    with pytest.raises(TooLarge):
        decode(content, content_type, "", {}, Limits(50_000_000, 100))


@pytest.mark.parametrize(("content_type", "extra"), [(PARQUET, "parquet"), (HDF5, "hdf5")])
def test_a_missing_reader_is_named(content_type: str, extra: str, monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *args: Any, **kwargs: Any) -> Any:
        if name.partition(".")[0] in ("pyarrow", "h5py"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(UnknownType, match=rf"casedrain\[{extra}\]"):
        decode(b"PAR1....", content_type, "", {}, LIMITS)
