"""Requests that are wrong in ways that no form of theirs catches: cursors, instants, archives made to deceive."""

import base64
import io
import json
import stat
import warnings
import zipfile
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from service.errors import Problem
from service.ingest.archive import Archive, opened_archive
from tests.service.records import body, document

API = "/api/v1"
JSON = {"content-type": "application/json"}
LISTS = ("records", "pumps", "aircraft", "audit", "fleet/ranking")
YEAR_1 = "0001-01-01T00:00:00+14:00"
"""Before the calendar begins, in UTC."""


def upload(client: TestClient, **metadata: Any) -> None:
    content = json.dumps({**document(), **metadata}).encode()
    answer = client.post(f"{API}/records", content=content, headers=JSON)
    assert answer.status_code == 201, answer.text


def places(answer: Any) -> list[str]:
    assert answer.status_code == 422, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    return [fault["where"] for fault in answer.json()["errors"]]


def changed(cursor: str, place: Any) -> str:
    """A cursor of ours with another place in it."""
    signature, _ = json.loads(base64.urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4)))
    return base64.urlsafe_b64encode(json.dumps([signature, place]).encode()).decode().rstrip("=")


def test_cursors_are_whole_and_of_their_query(client: TestClient) -> None:
    for i in (1, 2):
        upload(client, pump_serial=f"P-{i}", aircraft=f"F-{i}")
        client.post(f"{API}/aircraft", json={"aircraft": f"G-{i}"})
    found = {}
    for name in LISTS:
        page = client.get(f"{API}/{name}", params={"limit": 1}).json()
        found[name] = page["next"]
        assert found[name], name
        # one that no row is left behind of is still ours
        assert client.get(f"{API}/{name}", params={"limit": 1, "cursor": found[name]}).status_code == 200
    for name, cursor in found.items():
        others = [c for n, c in found.items() if n != name]
        bad = [changed(cursor, place) for place in (None, [], {}, ["x", "y"], [None, None], 10**30, [[1], [2]])]
        for wrong in (*others, *bad, cursor[:-3], "???", "é", "W10"):
            answer = client.get(f"{API}/{name}", params={"limit": 1, "cursor": wrong})
            assert places(answer) == ["cursor"], (name, wrong)


@pytest.mark.parametrize("path", ["records", "audit", "fleet/trend?metric=case_residual_bar", "exports/trends.csv"])
def test_instants_lie_in_the_calendar_and_in_a_zone(client: TestClient, path: str) -> None:
    joint = "&" if "?" in path else "?"
    wrong = client.get(f"{API}/{path}{joint}from={YEAR_1.replace('+', '%2B')}&to=2026-05-02T07:11:00")
    assert places(wrong) == ["query.from", "query.to"]


def test_words_that_do_not_exist_are_refused_by_name(client: TestClient) -> None:
    assert places(client.get(f"{API}/records", params={"status": "mood"})) == ["query.status"]
    ours = {"kind": "reprocess", "parameters": {"up_to_pump": 10**30}}
    assert places(client.post(f"{API}/jobs", json=ours)) == ["parameters.up_to_pump"]


def test_a_foreign_note_that_is_no_text_hurts_nobody(client: TestClient) -> None:
    upload(client, note="half \ud800", nul="a\0b", list=["\udfff"])
    (record,) = client.get(f"{API}/records").json()["items"]
    assert client.get(f"{API}/records/{record['record_id']}").status_code == 200
    assert client.get(f"{API}/records/{record['record_id']}/raw").status_code == 200


def zipped(*members: tuple[str | zipfile.ZipInfo, bytes]) -> bytearray:
    out = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as file:
        warnings.simplefilter("ignore")  # twice the same name, on purpose
        for name, content in members:
            file.writestr(name, content)
    return bytearray(out.getvalue())


def patched(offset: int, value: bytes) -> bytes:
    """An archive of one record with some bytes of its central directory replaced."""
    content = zipped(("a.json", body()))
    start = content.find(b"PK\x01\x02") + offset
    content[start : start + len(value)] = value
    return bytes(content)


def test_what_a_file_manager_leaves_in_an_archive_is_no_record(tmp_path: Path) -> None:
    path = tmp_path / "packed.zip"
    path.write_bytes(
        zipped(("__MACOSX/._a.json", b"x"), ("b/.DS_Store", b"x"), ("Thumbs.db", b"x"), ("a.json", body()))
    )
    archive = opened_archive(path, "zip", 2_000_000)
    assert [archive.name(i) for i in range(len(archive))] == ["a.json"]
    archive.close()


def link() -> zipfile.ZipInfo:
    info = zipfile.ZipInfo("link.json")
    info.external_attr = (stat.S_IFLNK | 0o777) << 16
    return info


def damaged() -> bytes:
    content = zipped(("a.json", body()))
    content[60] ^= 0xFF
    return bytes(content)


def read(archive: Archive) -> bytes:
    archive.member(0)
    return b"".join(archive.parts(0))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (bytes(zipped(("a.json", body()), ("a.json", b"{}"))), "more than once"),
        (bytes(zipped((link(), b"/etc/passwd"))), "is a link"),
        (bytes(zipped(("..\\x.json", body()))), "path"),
        (bytes(zipped(("a/../../b.json", body()))), "path"),
        (bytes(zipped(("a\nb.json", body()))), "control characters"),
        (patched(8, b"\x01"), "encrypted"),
        (patched(10, b"\x63"), "damaged"),
        (patched(24, (5).to_bytes(4, "little")), "damaged"),
        (damaged(), "damaged"),
    ],
    ids=["twice", "link", "backslash", "dots", "newline", "encrypted", "odd method", "lies on its size", "damaged"],
)
def test_members_made_to_deceive_are_refused(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "upload"
    path.write_bytes(content)
    archive = opened_archive(path, "zip", 2_000_000)
    with pytest.raises(Problem, match=words) as refused:
        read(archive)
    assert refused.value.status < 500
    archive.close()


UNSTORABLE: list[tuple[str, dict[str, Any], str]] = [
    ("keys", {"owner": "office\x00", "role": "viewer"}, "body.owner"),
    ("users", {"name": "j\ud800", "password": "a long enough sentence", "role": "viewer"}, "body.name"),
    ("mappings", {"name": "x", "channels": [{"source": "P\x00", "channel": "speed_rpm"}]}, "body.channels.0.source"),
    ("pumps", {"serial": "P\x00", "pump_type": "h225"}, "body.serial"),
    ("jobs", {"kind": "report", "parameters": {"pump": "P\x00"}}, "body.parameters"),
    ("thresholds/preview", {"scope": "pump", "id": "\x00", "values": {}}, "body.id"),
]


def test_text_that_no_database_can_hold_is_refused_by_name(client: TestClient) -> None:
    for path, content, where in UNSTORABLE:
        # written as escapes: JSON may, and SQLite would take them
        answer = client.post(f"{API}/{path}", content=json.dumps(content).encode(), headers=JSON)
        assert where in places(answer), path


def test_a_truth_value_is_no_number(client: TestClient) -> None:
    """Readers of JSON take false for 0 where a number belongs: at the top, in lists, by name, in bodies within bodies."""
    condition = {"speed_rpm": 4600.0, "fluid_temperature_degc": 50.0}
    for path, content, where in (
        ("twin/operating-point", {"conditions": [{**condition, "discharge_flow_lpm": False}]}, "discharge_flow_lpm"),
        ("twin/operating-point", {"conditions": [{**condition, "health": {"droop_scale": True}}]}, "droop_scale"),
        ("twin/isolability", {"temperature_range_degc": [0.0, False]}, "temperature_range_degc"),
        ("thresholds/preview", {"scope": "fleet", "id": "default", "values": {"case_flow_limit_lpm": True}}, "values"),
    ):
        answer = client.post(f"{API}/{path}", json=content)
        assert answer.status_code == 422, answer.text
        assert any(where in place for place in places(answer)), answer.text
