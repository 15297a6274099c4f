"""MDF4 as loggers write it: records of several groups mixed in one data block, told apart by a number before each."""

import struct
from datetime import UTC, datetime

import numpy as np
import pytest

from service.errors import Problem
from service.ingest.decode import Limits, decode
from service.ingest.mdf4_format import parsed
from tests.service.records import METADATA, document

START = datetime(2026, 5, 2, 7, 11, tzinfo=UTC)
LIMITS = Limits(10_000_000, 1_000_000)
_REAL, _MASTER, _TIME = 4, 2, 1


class File:
    """Blocks one after another; a link is the place of a block that was added before."""

    def __init__(self) -> None:
        self.content = bytearray(
            struct.pack("<8s8s8sHH30sHH", b"MDF     ", b"4.10    ", b"loggers ", 0, 410, b"", 0, 0)[:64]
        )

    def block(self, kind: bytes, links: list[int], data: bytes) -> int:
        self.content += bytes(-len(self.content) % 8)
        place = len(self.content)
        length = 24 + 8 * len(links) + len(data)
        self.content += struct.pack("<4s4xQQ", kind, length, len(links)) + struct.pack(f"<{len(links)}q", *links) + data
        return place

    def link(self, block: int, number: int, place: int) -> None:
        struct.pack_into("<q", self.content, block + 24 + 8 * number, place)

    def text(self, words: str) -> int:
        raw = words.encode() + b"\0"
        return self.block(b"##TX", [], raw + bytes(-len(raw) % 8))


def unsorted(groups: list[dict[str, np.ndarray]], cut: int = 0) -> bytes:
    """Groups of channels, ``time_s`` their masters, with the records of all in the order of their times."""
    file = File()
    header = file.block(
        b"##HD", [0] * 6, struct.pack("<QhhBBBBdd", int(START.timestamp() * 1e9), 0, 0, 0, 0, 0, 0, 0.0, 0.0)
    )
    history = file.block(b"##FH", [0, 0], struct.pack("<QhhB3x", int(START.timestamp() * 1e9), 0, 0, 0))
    file.link(header, 1, history)
    records: list[tuple[float, int, bytes]] = []
    following = 0
    for number in range(len(groups), 0, -1):
        channels = groups[number - 1]
        after = 0
        for place, name in reversed(list(enumerate(channels))):
            is_time = name == "time_s"
            data = struct.pack(
                "<BBBBIIIIBxHdddddd", _MASTER if is_time else 0, _TIME if is_time else 0, _REAL, 0, 8 * place, 64, 0, 0, 0, 0,
                *[0.0] * 6,
            )  # fmt: skip
            unit = file.text("s") if is_time else 0
            after = file.block(b"##CN", [after, 0, file.text(name), 0, 0, 0, unit, 0], data)
        n, width = len(channels["time_s"]), 8 * len(channels)
        following = file.block(
            b"##CG", [following, after, 0, 0, 0, 0], struct.pack("<QQHHIII", number, n, 0, 0, 0, width, 0)
        )
        table = np.column_stack(list(channels.values())).astype("<f8")
        records += [(row[0], number, bytes([number]) + row.tobytes()) for row in table]
    samples = b"".join(record for _, _, record in sorted(records, key=lambda r: r[:2]))
    data = file.block(b"##DT", [], samples)
    group = file.block(b"##DG", [0, following, data, 0], struct.pack("<B7x", 1))
    file.link(header, 0, group)
    return bytes(file.content[: len(file.content) - cut])


def groups() -> list[dict[str, np.ndarray]]:
    whole = {name: np.array(samples) for name, samples in document()["channels"].items()}
    slow = {name: whole[name][::4] for name in ("time_s", "fluid_temperature_degc")}
    return [{name: samples for name, samples in whole.items() if name != "fluid_temperature_degc"}, slow]


def test_records_of_several_groups_are_told_apart() -> None:
    made = groups()
    recording = decode(unsorted(made), "application/x-mdf4", "", METADATA, LIMITS).recording
    for name, samples in made[0].items():
        assert np.array_equal(recording[name], samples), name
    known = np.isfinite(recording["fluid_temperature_degc"])
    assert np.array_equal(recording["fluid_temperature_degc"][::4], made[1]["fluid_temperature_degc"])
    assert known[::4].all()


@pytest.mark.parametrize("cut", [5, 600, 4000])
def test_a_cut_one_keeps_what_is_whole_or_says_why_not(cut: int) -> None:
    made = groups()
    try:
        recording = decode(unsorted(made, cut), "application/x-mdf4", "", METADATA, LIMITS).recording
    except Problem as problem:
        if problem.errors:
            return
        raise
    n = len(recording.time_s)
    assert 0 < n < len(made[0]["time_s"])
    assert np.array_equal(recording["case_pressure_bar"], made[0]["case_pressure_bar"][:n])
    assert any("cut" in flag for flag in recording.flags)


def channel(file: File, after: int, name: str, place: int, *kinds: int, data: int = 0, conversion: int = 0) -> int:
    """A channel of 64 bits at its place; ``kinds`` are its own, that of its clock, of its type and its flags."""
    kind, clock, of_what, flags = kinds
    bit = place if flags else 0
    numbers = struct.pack("<BBBBIIIIBxHdddddd", kind, clock, of_what, 0, 8 * place, 64, flags, bit, 0, 0, *[0.0] * 6)
    return file.block(b"##CN", [after, 0, file.text(name), 0, conversion, data, 0, 0], numbers)


def test_words_among_the_records_conversions_and_invalid_samples() -> None:
    """Texts of any length lie in a group of their own that a channel leads to; their chain is no circle."""
    file, whole = File(), {name: np.array(samples) for name, samples in document()["channels"].items()}
    start = int(START.timestamp() * 1e9)
    header = file.block(b"##HD", [0] * 6, struct.pack("<QhhBBBBdd", start, 0, 0, 0, 0, 0, 0, 0.0, 0.0))
    file.link(header, 1, file.block(b"##FH", [0, 0], struct.pack("<QhhB3x", start, 0, 0, 0)))
    spoken = [f"mode {i}".encode() * (1 + i % 3) for i in range(9)]
    own = file.block(
        b"##CG", [0] * 6, struct.pack("<QQHHIII", 3, len(spoken), 1, 0, 0, sum(4 + len(w) for w in spoken), 0)
    )
    text = channel(file, 0, "mode", 1, 1, 0, 7, 0, data=own)
    clock = channel(file, text, "time_s", 0, _MASTER, _TIME, _REAL, 0)
    slow = file.block(b"##CG", [own, clock, 0, 0, 0, 0], struct.pack("<QQHHIII", 2, len(spoken), 0, 0, 0, 16, 0))
    halved = file.block(b"##CC", [0] * 4, struct.pack("<BBHHHdd2d", 1, 0, 0, 0, 2, 0.0, 0.0, -0.25, 0.5))
    after, names = 0, list(whole)
    for place, name in reversed(list(enumerate(names))):
        is_time, is_case = name == "time_s", name == "case_pressure_bar"
        kinds = (_MASTER, _TIME, _REAL, 0) if is_time else (0, 0, _REAL, 2 if is_case else 0)
        after = channel(file, after, name, place, *kinds, conversion=halved if is_case else 0)
    n, case = len(whole["time_s"]), names.index("case_pressure_bar")
    fast = file.block(b"##CG", [slow, after, 0, 0, 0, 0], struct.pack("<QQHHIII", 1, n, 0, 0, 0, 8 * len(names), 1))
    counted = {**whole, "case_pressure_bar": (whole["case_pressure_bar"] + 0.25) / 0.5}
    records, place = [], 0
    for i, row in enumerate(np.column_stack(list(counted.values())).astype("<f8")):
        records.append(struct.pack("<H", 1) + row.tobytes() + bytes([1 << case if 20 <= i < 24 else 0]))
        if i % 10 == 5 and i // 10 < len(spoken):
            word = spoken[i // 10]
            records.append(struct.pack("<HI", 3, len(word)) + word)
            records.append(struct.pack("<HdQ", 2, whole["time_s"][i], place))
            place += 4 + len(word)
    data = file.block(b"##DT", [], b"".join(records))
    file.link(header, 0, file.block(b"##DG", [0, fast, data, 0], struct.pack("<B7x", 2)))
    content = bytes(file.content)
    raw = parsed(content, LIMITS)
    assert [word.decode() for word in spoken] == next(t.texts["mode"] for t in raw.tables if "mode" in t.texts)
    found = decode(content, "application/x-mdf4", "", METADATA, LIMITS).recording["case_pressure_bar"]
    expected = whole["case_pressure_bar"].copy()
    expected[20:24] = np.nan
    assert np.allclose(found, expected, atol=1e-12, equal_nan=True)
