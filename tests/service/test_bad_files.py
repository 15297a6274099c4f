"""Whatever the bytes are, the answer is a problem: damaged, random, in other encodings, with wrong times."""

import json
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchmarks.fuzz_readers import fuzzed
from service.demo.fleet import DemoRecord
from service.errors import Fault, Invalid, Problem, TooLarge, Undecodable, UnknownType
from service.ingest.decode import DecodedRecord, Limits, checked, decode
from service.ingest.file_formats import CONTENT_TYPES
from service.ingest.parser_pool import ParserLimits, ParserPool
from tests.service.records import METADATA, body, document
from tests.service.test_formats import WRITERS

LIMITS = Limits(5_000_000, 100_000)
HEADER = "".join(f"# {k}: {v}\n" for k, v in METADATA.items())
KNOWN_PROBLEMS = (Undecodable, Invalid, TooLarge, UnknownType)
STARTS = (b"PAR1", b"\x89HDF\r\n\x1a\n", b"MDF     4.10    ", b"TDSm", b"MATLAB 5.0 MAT-file", b"{", b"\x1f\x8b", b"")


def faults(content: bytes, content_type: str = "text/csv") -> tuple[int, dict[str, str]]:
    with pytest.raises(Problem) as refused:
        decode(content, content_type, "", {}, LIMITS)
    return int(refused.value.status), {fault.where: fault.problem for fault in refused.value.errors}


def csv_of(text: str, encoding: str = "utf-8") -> bytes:
    return (HEADER + text).encode(encoding)


@settings(max_examples=150, deadline=None)
@given(start=st.sampled_from(STARTS), rest=st.binary(max_size=400), content_type=st.sampled_from(CONTENT_TYPES))
def test_random_bytes_are_always_a_problem(start: bytes, rest: bytes, content_type: str) -> None:
    with pytest.raises(Problem) as refused:
        decode(start + rest, content_type, "", {}, LIMITS)
    assert refused.value.status < 500
    assert all(isinstance(fault, Fault) for fault in refused.value.errors)


@pytest.fixture(scope="module")
def plain(healthy_records: list[DemoRecord]) -> DecodedRecord:
    return decode(healthy_records[0].content, "text/csv", "", {}, Limits(50_000_000, 100_000))


@pytest.fixture(scope="module")
def pool(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ParserPool]:
    made = ParserPool(tmp_path_factory.mktemp("spool"), ParserLimits(seconds=3.0))
    yield made
    made.close()


@pytest.mark.parametrize("kind", WRITERS)
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    damage=st.lists(st.tuples(st.floats(0, 0.999), st.integers(1, 255)), min_size=1, max_size=8),
    kept=st.floats(0.001, 1.0),
)
def test_damaged_binaries_never_crash_a_reader(
    plain: DecodedRecord, pool: ParserPool, tmp_path: Path, kind: str, damage: list[tuple[float, int]], kept: float
) -> None:
    """Through the pool: a C library may hang or crash on damaged bytes, which must cost that file alone."""
    content_type, written = WRITERS[kind]
    content = bytearray(_once(kind, lambda: written(plain)))
    for place, bits in damage:
        content[int(place * len(content))] ^= bits
    cut = bytes(content[: max(1, int(kept * len(content)))])
    path = tmp_path / "damaged"
    path.write_bytes(cut)
    with suppress(*KNOWN_PROBLEMS):
        checked(pool.parsed(path, content_type, "", Limits(50_000_000, 100_000)), {})


_made: dict[str, bytes] = {}


def _once(kind: str, made: Any) -> bytes:
    if kind not in _made:
        _made[kind] = made()
    return _made[kind]


def test_lines_in_another_encoding_are_named() -> None:
    content = csv_of("time_s,fluid_temperature_degc\n") + "# 50 °C\n".encode("latin-1") + b"0,1\n"
    status, found = faults(content)
    assert status == 400
    (where, problem), *_ = found.items()
    assert where.startswith("byte ")
    assert "line 7" in problem
    assert "0xb0" in problem


def test_utf_16_is_told_what_to_do() -> None:
    status, found = faults("time_s,x\n1,2\n".encode("utf-16"))
    assert status == 400
    assert "UTF-16" in found["byte 0"]


def test_semicolons_are_told_what_to_do() -> None:
    status, found = faults(csv_of("Zeit;Druck\n0;0,9\n1;0,9\n"))
    assert status == 400
    assert found == {"line 6": "is separated by semicolons, not by commas"}


def test_decimal_commas_are_recognised() -> None:
    status, found = faults(csv_of('time_s,case_pressure_bar\n0,"0,9"\n1,"0,9"\n'))
    assert status == 422
    assert "write decimals with a point" in found["line 7, case_pressure_bar"]
    status, found = faults(csv_of("time_s,case_pressure_bar\n0,0,0,9\n"))
    assert status == 422
    assert "decimals written with a comma" in found["line 7"]


def test_duplicate_columns_are_named_in_csv_and_json() -> None:
    assert "appears twice" in faults(csv_of("time_s,case_pressure_bar,case_pressure_bar\n0,1,2\n"))[1]["line 6"]
    twice = body().replace(b'"time_s"', b'"case_pressure_bar": [1.0], "time_s"', 1)
    status, found = faults(twice, "application/json")
    assert status == 422
    assert found["channels.case_pressure_bar"] == "appears twice"


def test_a_clock_that_jumps_by_days_is_refused_and_an_hour_s_gap_is_not() -> None:
    """Two hundred samples over nine years took minutes and all the memory there is: every second of the gap cost room."""
    jumped = np.concatenate((np.arange(80.0), np.arange(80.0) + 3.0e8))
    status, found = faults(body(document(time_s=list(jumped))), "application/json")
    assert status == 422
    assert found == {
        "channels.time_s": "spans 8.333e+04 h, a record at most 48 h; its largest gap is 8.333e+04 h after sample 79"
    }
    paused = np.concatenate((np.arange(80.0), np.arange(80.0) + 3600.0))
    assert len(decode(body(document(time_s=list(paused))), "application/json", "", {}, LIMITS).recording) == 160


def test_sampling_that_jumps_is_refused_and_gaps_are_not() -> None:
    n = 160
    jumping = np.concatenate((np.arange(80) * 1.0, 80.0 + np.arange(80) * 0.01))
    status, found = faults(body(document(time_s=list(jumping))), "application/json")
    assert status == 422
    assert any("sampling jumps from 1 Hz to 100 Hz" in problem for problem in found.values())
    gaps = np.arange(n) + 500.0 * (np.arange(n) > 50) + 90.0 * (np.arange(n) > 120)
    assert len(decode(body(document(time_s=list(gaps))), "application/json", "", {}, LIMITS).recording) == n


def test_the_future_and_a_missing_zone_are_refused() -> None:
    late = (datetime.now(UTC) + timedelta(days=3)).isoformat()
    for value, words in ((late, "lies in the future"), ("2026-05-02T07:11:00", "no time zone")):
        changed = json.dumps({**document(), "started_at": value}).encode()
        status, found = faults(changed, "application/json")
        assert status == 422
        assert words in found["started_at"]


def test_every_fault_of_a_file_comes_at_once() -> None:
    text = "time_s,case_pressure_bar,case_pressure_bar,shaft_speed_rpm\n0,1,1,\n0,x,1,\n-1,1,1,\n"
    status, found = faults(csv_of(text).replace(b"# aircraft: F-1\n", b""))
    assert status == 422
    assert {
        "aircraft",
        "line 5",
        "line 7, case_pressure_bar",
        "channels.shaft_speed_rpm",
        "channels.discharge_pressure_bar",
        "channels.fluid_temperature_degc",
    } <= set(found)


def test_readers_bear_whatever_was_made_of_good_files() -> None:
    """A stretch of what ``benchmarks.fuzz_readers`` reads a hundred thousand of, in a process that may be lost."""
    found = fuzzed(150, first=6_000_000)
    assert found["remarkable"] == []
    assert sum(found["counts"].values()) == 150
    assert {name.partition(" ")[2] for name in found["counts"]} == {"read", "refused"}
