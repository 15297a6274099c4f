"""Places and sizes in a damaged or forged file that lead out of it: none of the memory behind is taken for samples."""

import io
import struct
import zlib
from collections.abc import Iterator
from datetime import UTC, datetime

import numpy as np
import pytest

from service.errors import Problem
from service.ingest.decode import DecodedRecord, Limits, decode
from service.ingest.mdf4_format import parsed as mdf4_parsed
from tests.service.records import METADATA, body, document
from tests.service.test_formats import HDF5, MATLAB, MDF4, WRITERS
from tests.service.test_unsorted_mdf4 import START, File, channel, groups, unsorted

LIMITS = Limits(10_000_000, 1_000_000)
_BYTE_OFFSET = 4
"""Of a channel's data: after its type, its clock's, that of its samples, and the first bit."""
_OUTSIDE = "outside the records of its group: the file is damaged"


@pytest.fixture(scope="module")
def record() -> DecodedRecord:
    return decode(body(), "application/json", "", {}, LIMITS)


def data_of_channels(content: bytes) -> Iterator[tuple[str, int]]:
    """Name of every channel of a file, and where its data begins."""
    place = content.find(b"##CN")
    while place >= 0:
        links = struct.unpack_from("<Q", content, place + 16)[0]
        name = struct.unpack_from("<Q", content, place + 24 + 16)[0]
        length = struct.unpack_from("<Q", content, name + 8)[0]
        yield content[name + 24 : name + length].rstrip(b"\0").decode(), place + 24 + 8 * links
        place = content.find(b"##CN", place + 4)


def moved(content: bytes, name: str, offset: int) -> bytes:
    found = bytearray(content)
    for called, place in data_of_channels(content):
        if called == name:
            struct.pack_into("<I", found, place + _BYTE_OFFSET, offset)
    assert found != content
    return bytes(found)


@pytest.mark.parametrize("layout", ["sorted", "unsorted"])
@pytest.mark.parametrize("offset", [41, 48, 1 << 12, 1 << 31])
def test_a_channel_beyond_its_records_is_refused_by_name(record: DecodedRecord, layout: str, offset: int) -> None:
    content = WRITERS["mdf4"][1](record) if layout == "sorted" else unsorted(groups())
    with pytest.raises(Problem) as refused:
        decode(moved(content, "case_pressure_bar", offset), MDF4, "", METADATA, LIMITS)
    said = {fault.where: fault.problem for fault in refused.value.errors}
    assert said["channels.case_pressure_bar"] == f"is {_OUTSIDE}"


@pytest.mark.parametrize(("layout", "clock"), [("sorted", "time"), ("unsorted", "time_s")])
def test_the_clock_of_a_group_is_held_to_its_records_too(record: DecodedRecord, layout: str, clock: str) -> None:
    """Told of once, whatever it is called; the unsorted file has two groups with a clock each."""
    content = WRITERS["mdf4"][1](record) if layout == "sorted" else unsorted(groups())
    n_groups = 1 if layout == "sorted" else len(groups())
    with pytest.raises(Problem) as refused:
        decode(moved(content, clock, 4000), MDF4, "", METADATA, LIMITS)
    assert [f.where for f in refused.value.errors if f.problem == f"is {_OUTSIDE}"] == [f"channels.{clock}"] * n_groups


def test_a_stranger_s_channel_beyond_its_records_costs_nobody() -> None:
    made = [{**groups()[0], "stranger": np.ones(len(groups()[0]["time_s"]))}, groups()[1]]
    found = mdf4_parsed(moved(unsorted(made), "stranger", 4000), LIMITS)
    assert found.not_kept == {"stranger": _OUTSIDE}
    kept = {name: samples for table in found.tables for name, samples in table.channels.items()}
    assert np.array_equal(kept["case_pressure_bar"], made[0]["case_pressure_bar"])


@pytest.mark.parametrize("second", [0, 1 << 62, (1 << 64) - 8], ids=["backwards", "beyond any file", "before it"])
def test_texts_that_lead_nowhere_cost_nobody(second: int) -> None:
    """A sample of any length is a place among others' bytes."""
    file = File()
    start = int(START.timestamp() * 1e9)
    header = file.block(b"##HD", [0] * 6, struct.pack("<QhhBBBBdd", start, 0, 0, 0, 0, 0, 0, 0.0, 0.0))
    file.link(header, 1, file.block(b"##FH", [0, 0], struct.pack("<QhhB3x", start, 0, 0, 0)))
    words = file.block(b"##SD", [], b"".join(struct.pack("<I", 4) + word for word in (b"idle", b"load", b"stop")))
    text = channel(file, 0, "mode", 1, 1, 0, 7, 0, data=words)
    clock = channel(file, text, "time_s", 0, 2, 1, 4, 0)
    group = file.block(b"##CG", [0, clock, 0, 0, 0, 0], struct.pack("<QQHHIII", 0, 3, 0, 0, 0, 16, 0))
    places = (0, 8, 16) if second == 0 else (0, second, 16)
    places = (8, 0, 16) if second == 0 else places
    data = file.block(b"##DT", [], b"".join(struct.pack("<dQ", float(i), place) for i, place in enumerate(places)))
    file.link(header, 0, file.block(b"##DG", [0, group, data, 0], struct.pack("<B7x", 0)))
    found = mdf4_parsed(bytes(file.content), LIMITS)
    assert found.not_kept == {"mode": "made of samples that are not there: the file is damaged"}
    assert datetime.fromtimestamp(start / 1e9, UTC) == START


def hdf5_with_rows() -> bytes:
    """A record whose attributes and table hold rows of a length of their own each, beside what belongs to it."""
    import h5py

    out, channels = io.BytesIO(), document()["channels"]
    rows = h5py.vlen_dtype(np.dtype(np.float64))
    with h5py.File(out, "w") as file:
        for name, samples in channels.items():
            file[name] = np.array(samples)
        for name, value in METADATA.items():
            file.attrs[name] = value
        file.attrs.create("history", np.array([np.ones(3), np.ones(2)], dtype=object), dtype=rows)
        table = np.zeros(2, np.dtype([("gust", "f8"), ("profile", rows)]))
        table["profile"][0], table["profile"][1] = np.ones(3), np.ones(2)
        file["weather"] = table
    return out.getvalue()


def test_rows_of_any_length_in_hdf5_are_named_and_cost_nobody() -> None:
    found = decode(hdf5_with_rows(), HDF5, "", {}, LIMITS)
    for name, samples in document()["channels"].items():
        assert np.array_equal(found.recording[name], samples), name


def test_a_damaged_type_of_rows_does_not_end_the_reader() -> None:
    """The library writes over memory that is not its own where it reads rows of an unknown kind."""
    content, wrong = hdf5_with_rows(), 0xD3
    place = content.find(b"\x19\x00\x00\x00\x10\x00\x00\x00")
    assert place >= 0
    while place >= 0:
        content = content[: place + 1] + bytes([wrong]) + content[place + 2 :]
        place = content.find(b"\x19\x00\x00\x00\x10\x00\x00\x00")
    found = decode(content, HDF5, "", {}, LIMITS)
    assert np.array_equal(found.recording["case_pressure_bar"], document()["channels"]["case_pressure_bar"])


def test_a_variable_of_matlab_that_has_no_end_is_refused_before_its_reader_ends() -> None:
    """SciPy's reader ends the process where a compressed variable is cut inside, or shorter than it says."""
    whole = struct.pack("<II", 14, 1352) + bytes(1352)
    for inflated, is_cut in ((whole, True), (whole[:-8], False), (whole[:5], False)):
        stream = zlib.compress(inflated)
        stream = stream[:-6] if is_cut else stream
        header = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
        content = header + struct.pack("<II", 15, len(stream)) + stream
        with pytest.raises(Problem) as refused:
            decode(content, MATLAB, "", METADATA, LIMITS)
        assert [f"{fault.where}: {fault.problem}" for fault in refused.value.errors] == [
            "body: the variable at byte 128 is cut short"
        ]


def test_a_chain_of_mdf4_that_leads_to_another_kind_of_block_is_refused(record: DecodedRecord) -> None:
    """The reader's library takes whatever stands there for the next block of the chain, for ever if that leads back."""
    content = WRITERS["mdf4"][1](record)
    history = struct.unpack_from("<Q", content, 64 + 24 + 8)[0]
    changed = bytearray(content)
    struct.pack_into("<Q", changed, 64 + 24, history)
    with pytest.raises(Problem) as refused:
        decode(bytes(changed), MDF4, "", METADATA, LIMITS)
    assert [(f.where, f.problem) for f in refused.value.errors] == [(f"block at {history}", "is no ##DG block")]


@pytest.mark.parametrize("size", [0, 8, 256, 512])
def test_a_heap_of_hdf5_whose_free_space_ends_early_is_refused(size: int) -> None:
    """Behind it the library takes zeros for free space of no size, and steps on by nothing for ever."""
    content = bytearray(hdf5_with_rows())
    place = content.find(b"GCOL")
    end = place + int.from_bytes(content[place + 8 : place + 16], "little")
    at = place + 16
    while at + 16 <= end:
        index, held = struct.unpack_from("<H6xQ", content, at)
        if index == 0:
            break
        at += 16 + (held + 7) // 8 * 8
    assert struct.unpack_from("<Q", content, at + 8)[0] == end - at
    struct.pack_into("<Q", content, at + 8, size)
    with pytest.raises(Problem) as refused:
        decode(bytes(content), HDF5, "", METADATA, LIMITS)
    assert [(f.where, f.problem) for f in refused.value.errors] == [("body", f"heap at byte {place} runs in a circle")]
