"""What a file says beside its samples is bounded in every format and at every entrance; indexes are made elsewhere."""

import io
import json
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from fastapi.testclient import TestClient

from service.errors import TooLarge
from service.ingest import archive_index
from service.ingest.decode import decode
from service.ingest.parser_pool import ParserLimits, ParserPool
from service.ingest.raw import Limits
from tests.service.records import METADATA, body, document

API = "/api/v1"
LIMITS = Limits(50_000_000, 100_000)
CHANNELS = {name: np.array(samples) for name, samples in document()["channels"].items()}
MANY = {f"k{i}": "x" for i in range(201)}
LONG = {"remark": "x" * 2**16}
JUST = {**{f"k{i}": "x" for i in range(199)}, "remark": "x" * 50_000}


def as_csv(words: dict[str, str]) -> bytes:
    lines = [f"# {k}: {v}" for k, v in words.items()]
    rows = [",".join(map(repr, map(float, row))) for row in zip(*CHANNELS.values(), strict=True)]
    return "\n".join([*lines, ",".join(CHANNELS), *rows]).encode()


def as_json(words: dict[str, str]) -> bytes:
    return json.dumps({**words, "channels": document()["channels"]}).encode()


def as_parquet(words: dict[str, str]) -> bytes:
    out = io.BytesIO()
    pq.write_table(pa.table(CHANNELS).replace_schema_metadata(words), out)
    return out.getvalue()


def as_hdf5(words: dict[str, str]) -> bytes:
    out = io.BytesIO()
    with h5py.File(out, "w") as file:
        for name, samples in CHANNELS.items():
            file.create_dataset(f"flight/{name}", data=samples)
        for name, value in words.items():
            file["flight"].create_dataset(name, data=value)
    return out.getvalue()


def as_tdms(words: dict[str, str]) -> bytes:
    from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter

    out = io.BytesIO()
    with TdmsWriter(out) as writer:
        channels = [ChannelObject("flight", name, samples) for name, samples in CHANNELS.items()]
        writer.write_segment([RootObject({}), GroupObject("flight", words), *channels])
    return out.getvalue()


def as_matlab(words: dict[str, str]) -> bytes:
    from scipy.io import savemat

    out = io.BytesIO()
    savemat(out, {**CHANNELS, **words})
    return out.getvalue()


def as_mdf4(words: dict[str, str]) -> bytes:
    from asammdf import MDF, Signal

    time = CHANNELS["time_s"]
    with MDF(version="4.10") as file:
        signals = [Signal(samples=v, timestamps=time, name=k) for k, v in CHANNELS.items() if k != "time_s"]
        file.append(signals, common_timebase=True)
        file.header._common_properties.update(words)
        out = io.BytesIO()
        file.save(out)
    return out.getvalue()


FORMATS: dict[str, Callable[[dict[str, str]], bytes]] = {
    "text/csv": as_csv,
    "application/json": as_json,
    "application/vnd.apache.parquet": as_parquet,
    "application/x-hdf5": as_hdf5,
    "application/x-tdms": as_tdms,
    "application/x-matlab-data": as_matlab,
    "application/x-mdf4": as_mdf4,
}


@pytest.mark.parametrize("kind", FORMATS)
def test_foreign_metadata_are_bounded_in_every_format(kind: str) -> None:
    write = FORMATS[kind]
    with pytest.raises(TooLarge, match="foreign metadata, more than 200"):
        decode(write({**METADATA, **MANY}), kind, "", {}, LIMITS)
    with pytest.raises(TooLarge, match="more than 65536") as refused:
        decode(write({**METADATA, **LONG}), kind, "", {}, LIMITS)
    assert refused.value.errors[0].where == "metadata.remark"
    own = {k: v for k, v in JUST.items() if kind != "application/x-mdf4" or k != "k0"}  # it says its start itself
    kept = decode(write({**METADATA, **own}), kind, "", {}, LIMITS).recording.attributes
    assert kept["remark"] == "x" * 50_000
    assert kept["k198"] == "x"


def test_names_of_columns_are_bounded_and_what_was_not_kept_is_counted() -> None:
    long = {**document()["channels"], **{"x" * 2_000 + str(i): ["a"] for i in range(600)}}
    with pytest.raises(TooLarge, match="names of the columns"):
        decode(json.dumps({**METADATA, "channels": long}).encode(), "application/json", "", {}, LIMITS)
    odd = {**document()["channels"], **{f"{i} {'y' * 300}": "a" for i in range(1000)}}
    kept = decode(json.dumps({**METADATA, "channels": odd}).encode(), "application/json", "", {}, LIMITS)
    words = str(kept.recording.attributes["not_kept"])
    assert words.endswith("and 800 more")
    assert len(words) < 60_000


def test_every_entrance_refuses_and_keeps_nothing(client: TestClient) -> None:
    bad, kind = as_json({**METADATA, **MANY}), {"content-type": "application/json"}
    for path in ("records", "mappings/preview", "mappings/suggest"):
        answer = client.post(f"{API}/{path}", content=bad, headers=kind)
        assert answer.status_code == 413, path
        assert "201 foreign metadata" in answer.json()["detail"]
    stored = client.post(f"{API}/records?wait=false", content=bad, headers=kind).json()["record_id"]
    assert client.get(f"{API}/records/{stored}").json()["problem"]["status"] == 413
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as file:
        file.writestr("bad.json", bad)
        file.writestr("good.json", body())
    job = client.post(f"{API}/records/bulk", content=out.getvalue(), headers={"content-type": "application/zip"}).json()
    items: list[dict[str, Any]] = []
    while len(items) < 2:
        items = client.get(f"{API}/jobs/{job['id']}").json()["items"]
    assert [item["status"] for item in items] == ["refused", "analysed"]
    assert items[0]["problem"]["status"] == 413


def test_a_record_that_was_taken_before_the_limit_is_read_on(client: TestClient) -> None:
    archive = client.app.state.context.archive  # type: ignore[attr-defined]
    now, kind = archive.limits, {"content-type": "application/json"}
    object.__setattr__(archive, "limits", now.without_words())  # as an older release had it
    answer = client.post(f"{API}/records", content=as_json({**METADATA, **MANY}), headers=kind)
    object.__setattr__(archive, "limits", now)
    assert answer.status_code == 201
    found = client.get(f"{API}/records/{answer.json()['record_id']}/channels?points=50")
    assert found.status_code == 200


def test_indexes_are_made_in_the_parser_process_and_stop_at_the_limit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: Any) -> None:
        raise AssertionError("the service indexed it itself")

    monkeypatch.setattr("service.ingest.archive.write_index", never)
    pool = ParserPool(tmp_path / "spool", ParserLimits(memory_bytes=256 * 2**20), n_workers=1)
    many = tmp_path / "many.ndjson"
    many.write_bytes(b"{}\n" * 300_000)
    with pytest.raises(TooLarge, match="more than 100000 lines"):
        pool.opened(many, "ndjson", 1_000)
    assert list((tmp_path / "spool").iterdir()) == []
    names = tmp_path / "names.zip"
    size = archive_index.MOST_DIRECTORY_BYTES + 1
    names.write_bytes(b"PK\x03\x04" + struct.pack("<4s4H2IH", b"PK\x05\x06", 0, 0, 9, 9, size, 4, 0))
    with pytest.raises(TooLarge, match=f"larger than {size - 1} bytes"):
        pool.opened(names, "zip", 1_000)
    good = tmp_path / "good.zip"
    with zipfile.ZipFile(good, "w", zipfile.ZIP_BZIP2) as file:
        file.writestr("a.json", body())
        file.writestr("b.csv", as_csv(METADATA))
    with_archive = pool.opened(good, "zip", 1_000_000)
    assert [with_archive.member(i).content_type for i in range(2)] == ["application/json", "text/csv"]
    assert b"".join(with_archive.parts(0)) == body()
    with_archive.close()
    assert list((tmp_path / "spool").iterdir()) == []
    pool.close()
