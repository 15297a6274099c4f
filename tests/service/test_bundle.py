"""A pump's bundle replayed: the verdict comes back to the last digit, and what differs is named with who issued it."""

import json
import shutil
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select
from typer.testing import CliRunner

from service.command_line.main import app
from service.keeping.bundle import make_bundle
from service.keeping.manifest import MANIFEST, sealed
from service.keeping.replay import differences, replay
from service.settings import Settings
from service.storage.tables import Pump
from tests.service.lent_application import lent
from tests.service.records import document

API = "/api/v1"
runner = CliRunner()


@pytest.fixture
def client(database_url: str, tmp_path: Path) -> Iterator[TestClient]:
    """Three flights of a pump, one of a pump that sat there before it, one of a foreign operator's namesake."""
    with lent(Settings(database_url=database_url, data_dir=tmp_path / "data")) as running:
        for n, (serial, operator, case_bar) in enumerate(
            [("P-0", "north", 0.9), ("P-1", "north", 0.9), ("P-1", "north", 1.4), ("P-1", "south", 0.8)]
        ):
            content = document(case_pressure_bar=[0.5] * 40 + [case_bar + 1e-4 * (i % 7) for i in range(120)])
            content |= {"pump_serial": serial, "operator": operator, "flight_id": f"F{n}"}
            content |= {"started_at": f"2026-05-0{n + 1}T07:11:00Z"}
            sent = running.post(f"{API}/records", json=content)
            assert sent.status_code == 201, sent.text
        event = {"at": "2026-05-02T12:00:00Z", "action": "filter_changed"}
        assert running.post(f"{API}/pumps/P-1/maintenance?operator=north", json=event).status_code == 201
        for scope, limit in (("fleet/default", 1.41), ("operator/north", 1.42), ("operator/south", 1.43)):
            put = {"values": {"case_flow_limit_lpm": limit}, "reason": "x"}
            done = running.put(f"{API}/thresholds/{scope}", json=put, headers={"If-Match": "*"})
            assert done.status_code == 200, done.text
        yield running


@pytest.mark.study
def test_a_replay_gives_the_verdict_to_the_last_digit(
    client: TestClient, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    by_hand(client, tmp_path)
    by_command(client, tmp_path, monkeypatch)
    by_the_api(client, tmp_path)


def by_hand(client: TestClient, tmp_path: Path) -> None:
    context = client.app.state.context  # type: ignore[attr-defined]
    verdict = client.get(f"{API}/pumps/P-1/verdict?operator=north").json()
    with context.database.reading() as session:
        pump_id = session.scalar(select(Pump.id).where(Pump.operator == "north", Pump.serial == "P-1"))
    place = tmp_path / "bundle"
    manifest = make_bundle(context.database, context.raw_store, pump_id, place)
    assert manifest["raw_files"] == 3, "its own and the predecessor's"
    assert manifest["issued_by"] == verdict["software"]
    for name in manifest["files"]:
        assert b"south" not in (place / name).read_bytes(), name
    done = replay(place)
    assert done.differences == []
    assert done.expected == verdict
    assert done.verdict["threshold_version"] == verdict["threshold_version"]
    assert done.explanation() is None

    other = shutil.copytree(place, tmp_path / "other")
    changed = {**verdict, "confidence": 0.123, "software": {"release": "0.9.0", "commit": "abc", "sources": "x"}}
    content = json.dumps(changed).encode()
    (other / "expected.json").write_bytes(content)
    with pytest.raises(ValueError, match=r"not whole: expected.json is damaged"):
        replay(other)
    body = {**manifest, "issued_by": changed["software"]}
    body["files"] = {**body["files"], "expected.json": {"bytes": len(content), "sha256": sha256(content).hexdigest()}}
    (other / MANIFEST).write_bytes(sealed(body))
    done = replay(other)
    assert [(d["where"], d["expected"]) for d in done.differences] == [("confidence", 0.123)]
    assert "issued by release 0.9.0, commit abc" in (done.explanation() or "")


def by_command(client: TestClient, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    context = client.app.state.context  # type: ignore[attr-defined]
    monkeypatch.setenv("CASEDRAIN_DATA_DIR", str(context.settings.data_dir))
    monkeypatch.setenv("CASEDRAIN_DATABASE_URL", context.settings.database_url)
    place = str(tmp_path / "bundle.zip")
    assert "has no pump P-9" in runner.invoke(app, ["bundle", "P-9", place]).output
    made = runner.invoke(app, ["bundle", "P-1", place, "--operator", "north"])
    assert made.exit_code == 0, made.output
    done = runner.invoke(app, ["replay", place, "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.output)["identical"] is True
    assert runner.invoke(app, ["check", place]).exit_code == 1


def test_differences_name_their_place() -> None:
    found = differences({"a": [1, {"b": 2}], "c": 3}, {"a": [1, {"b": 4}], "d": 5})
    assert [d["where"] for d in found] == ["a[1].b", "c", "d"]


def by_the_api(client: TestClient, tmp_path: Path) -> None:
    """The same bundle, and nothing is left in the spool, whether it could be made or not."""
    assert client.get(f"{API}/pumps/P-9/bundle").status_code == 404
    answer = client.get(f"{API}/pumps/P-1/bundle?operator=south")
    assert answer.status_code == 200
    (tmp_path / "got.zip").write_bytes(answer.content)
    assert replay(tmp_path / "got.zip").is_identical
    assert list((tmp_path / "data" / "spool").iterdir()) == []
    for file in (tmp_path / "data" / "raw").rglob("*"):
        if file.is_file():
            file.unlink()
    assert client.get(f"{API}/pumps/P-1/bundle?operator=south").status_code == 503
    assert list((tmp_path / "data" / "spool").iterdir()) == []
