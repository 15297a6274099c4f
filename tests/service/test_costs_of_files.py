"""What a file costs grows with its bytes and nothing else: neither its columns, keys, members nor blank lines squared."""

import gzip
import json
import struct
import time
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from service.errors import Invalid, Problem, TooLarge, Undecodable
from service.ingest import archive_index as archives
from service.ingest.archive import opened_archive
from service.ingest.parse import parsed
from service.ingest.raw import Limits

LIMITS = Limits(200_000_000, 5_000_000)
MOST_S = 2.0
"""On an idle core; a test's own machine may be three times slower."""


@contextmanager
def quick() -> Iterator[None]:
    start = time.process_time()
    yield
    assert time.process_time() - start < MOST_S


MANY = {
    "a million columns": ("text/csv", lambda: b"time_s" + b",c" * 1_000_000 + b"\n0" + b",1" * 1_000_000 + b"\n"),
    "columns of one name": ("text/csv", lambda: b"c," * 9_000 + b"c\n" + b"1," * 9_000 + b"1\n"),
    "a million lines of metadata": ("text/csv", lambda: b"".join(b"# k%d: v\n" % i for i in range(300_000)) + b"a,b\n"),
    "a million blank lines": ("text/csv", lambda: b"\n" * 10_000_000 + b"time_s,x\n0,1\n"),
    "lines of a blank": ("text/csv", lambda: b" \n" * 5_000_000 + b"time_s,x\n0,1\n"),
    "a million remarks": ("text/csv", lambda: b"#\n" * 1_000_000 + b"time_s,x\n0,1\n"),
    "a blank line of a million": ("text/csv", lambda: b" " * 10_000_000 + b"\ntime_s,x\n0,1\n"),
    "a million quotes": ("text/csv", lambda: b'time_s,"x\n' + b'"\n' * 1_000_000),
    "a header that never closes": ("text/csv", lambda: b'time_s,"' + b"x\n" * 1_000_000),
    "rows of a wrong width": ("text/csv", lambda: b"time_s,x\n" + b"1\n" * 1_000_000),
    "JSON with a million keys": (
        "application/json",
        lambda: b'{"channels": {' + b",".join(b'"%d": []' % i for i in range(200_000)) + b"}}",
    ),
    "JSON with a key a million times": (
        "application/json",
        lambda: b'{"channels": {' + b",".join([b'"a": []'] * 300_000) + b"}}",
    ),
    "JSON with every key twice": (
        "application/json",
        lambda: b"{" + b",".join(b'"%d": 1' % (i % 100_000) for i in range(200_000)) + b"}",
    ),
    "JSON a million deep": ("application/json", lambda: b'{"channels":' + b"[" * 1_000_000),
    "JSON with long integers": ("application/json", lambda: b'{"channels": {"time_s": [' + b"9" * 4_000_000 + b"]}}"),
    "empty gzip members": ("application/gzip", lambda: gzip.compress(b"") * 100_000),
    "zeros behind a gzip member": ("application/gzip", lambda: gzip.compress(b"time_s,x\n0,1\n") + bytes(50_000_000)),
    "gzip of zeros": ("application/gzip", lambda: gzip.compress(bytes(250_000_000), 1)),
}


@pytest.mark.parametrize("kind", MANY)
def test_many_of_anything_cost_no_more_than_their_bytes(kind: str) -> None:
    content_type, made = MANY[kind]
    content = made()
    with quick(), suppress(Problem):
        parsed(content, content_type, "", LIMITS)


def test_a_directory_of_too_many_members_is_refused_before_it_is_read(tmp_path: Path) -> None:
    entry = struct.pack("<4s6H3I5H2I", b"PK\x01\x02", 20, 20, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0) + b"a"
    content = b"PK\x03\x04" + entry * 1_000_000
    end = struct.pack("<4s4H2IH", b"PK\x05\x06", 0, 0, 65535, 65535, len(content) - 4, 4, 0)
    path = tmp_path / "many.zip"
    path.write_bytes(content + end)
    with quick(), pytest.raises(TooLarge, match="members"):
        opened_archive(path, "zip", 1_000_000)


def test_members_that_share_their_bytes_are_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "overlapping.zip"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("own.csv", "time_s\n0\n")
        file.writestr("a.csv", "time_s\n0\n" * 100)
        twin = zipfile.ZipInfo("b.csv")
        file.writestr(twin, "time_s\n0\n" * 100)
        twin.header_offset = file.getinfo("a.csv").header_offset
    archive = opened_archive(path, "zip", 1_000_000)
    assert archive.member(0).name == "own.csv"
    for position in (1, 2):
        with pytest.raises(Invalid, match="shares its bytes"):
            archive.member(position)
    archive.close()


def test_lines_are_found_whatever_stands_between_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "lines.ndjson"
    texts = [b'{"a": 1}', b'  {"b": "\xc3\xa9"}  ', b'{"c": [1,\t2]}', b'{"d"']
    path.write_bytes(b"\n\r\n" + texts[0] + b"\r\n\n  \n" + texts[1] + b"\n" + texts[2] + b"\n" + b"\n" * 40 + texts[3])
    for chunk in (1, 2, 3, 7, 1 << 20):
        monkeypatch.setattr(archives, "_CHUNK", chunk)
        archive = opened_archive(path, "ndjson", 1_000)
        assert [b"".join(archive.parts(i)) for i in range(len(archive))] == [text.strip() for text in texts]
        assert [archive.name(i) for i in range(4)] == ["line 3", "line 6", "line 7", "line 48"]
        archive.close()


def test_blank_lines_and_lines_without_number_cost_their_reading(tmp_path: Path) -> None:
    path = tmp_path / "lines.ndjson"
    path.write_bytes(b"\n" * 50_000_000 + b"{}\n")
    with quick():
        archive = opened_archive(path, "ndjson", 1_000)
    assert archive.name(0) == "line 50000001"
    archive.close()
    path.write_bytes(b"{}\n" * 2_000_000)
    with quick(), pytest.raises(TooLarge, match="lines"):
        opened_archive(path, "ndjson", 1_000)


def test_json_that_was_cut_says_so() -> None:
    whole = json.dumps({"pump_serial": "P", "channels": {"time_s": [0.0, 1.0]}}).encode()
    for end in (20, 40, len(whole) - 1, len(whole) - 4):
        with pytest.raises(Undecodable, match="before it is whole"):
            parsed(whole[:end], "application/json", "", LIMITS)
    with pytest.raises(Undecodable, match="is not JSON"):
        parsed(whole.replace(b":", b";"), "application/json", "", LIMITS)
