"""Operators as tenants: nobody sees or moves another's, roles hold, an operator leaves whole and with proof."""

import io
import json
import zipfile
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import func, select

from service.access.security import EVERYBODY, new_key
from service.registry.deletion import delete_operator, finish_deletions, receipt_hash
from service.registry.operators import expire
from service.registry.ownership import owned_tables, rows_of
from service.settings import Settings
from service.storage.tables import Base, Deletion
from tests.service.finished_job import finished
from tests.service.lent_application import lent
from tests.service.records import body, document

JSON = {"content-type": "application/json"}
API = "/api/v1"
DAY = "2026-05-01T00:00:00Z"
Headers = dict[str, str]


@pytest.fixture
def guarded(database_url: str, tmp_path: Any) -> Iterator[TestClient]:
    settings = Settings(database_url=database_url, data_dir=tmp_path / "data", auth="on")
    with lent(settings) as running:
        yield running


def key(client: TestClient, role: str, operator: str | None = None) -> Headers:
    database = client.app.state.context.database  # type: ignore[attr-defined]
    with database.writing() as session:
        _, made = new_key(session, f"test {role}", role, operator, None)
    return {"Authorization": f"Bearer {made}"}


def filled(client: TestClient, operator: str, content: bytes | None = None) -> dict[str, str]:
    """An operator with one of everything: the ids that it was given."""
    headers = key(client, "engineer", operator)
    sent = client.post(f"{API}/records", content=content or body(), headers={**headers, **JSON})
    assert sent.status_code == 201, sent.text
    ids = {"record": sent.json()["record_id"]}
    place = {"aircraft": "F-1", "position": "LH", "from": DAY}
    for what, new in (
        ("installations", place),
        ("maintenance", {"at": DAY, "action": "fluid_changed"}),
        ("findings", {"at": DAY, "found": "no_fault_found"}),
    ):
        made = client.post(f"{API}/pumps/P-1/{what}", json=new, headers=headers)
        assert made.status_code == 201, made.text
        ids[what] = made.json()["id"]
    client.patch(f"{API}/aircraft/F-1", json={"fluid": f"secret of {operator}"}, headers=headers)
    return ids


class TestTenancy:
    def test_no_call_reaches_into_another_operator(self, guarded: TestClient) -> None:
        ids = filled(guarded, "north")
        theirs = key(guarded, "admin", "south")
        entry = {what: f"/pumps/P-1/{what}/{ids[what]}" for what in ("installations", "maintenance", "findings")}
        calls: list[tuple[str, str, dict[str, Any]]] = [
            *(("GET", f"/pumps/P-1/{what}", {}) for what in entry),
            ("POST", "/pumps/P-1/installations", {"json": {"aircraft": "F", "position": "LH", "from": DAY}}),
            ("POST", "/pumps/P-1/maintenance", {"json": {"at": DAY, "action": "fluid_changed"}}),
            ("POST", "/pumps/P-1/findings", {"json": {"at": DAY, "found": "no_fault_found"}}),
            *(("PATCH", path, {"json": {}}) for path in entry.values()),
            *(("DELETE", path, {}) for path in entry.values()),
            ("GET", "/pumps/P-1/verdict?known_at=2026-11-01T00:00:00Z", {}),
            ("GET", "/pumps/P-1/verdicts/revisions", {}),
            ("PATCH", "/pumps/P-1", {"json": {}}),
            ("GET", "/aircraft/F-1", {}),
            ("PATCH", "/aircraft/F-1", {"json": {}}),
            ("GET", "/aircraft/F-1/positions/LH/trend?metric=case_residual_bar", {}),
            ("DELETE", f"/records/{ids['record']}?reason=x", {}),
            ("PATCH", "/operators/north", {"json": {"retention_days": 1}}),
            ("GET", "/operators/north/export", {}),
            ("DELETE", "/operators/north?confirm=north&reason=x", {}),
        ]
        for method, path, more in calls:
            # what takes no operator refuses the parameter by name, whoever asks
            takes_one = not path.startswith(("/records/", "/operators/"))
            for named in ("", ("&" if "?" in path else "?") + "operator=north") if takes_one else ("",):
                answer = guarded.request(method, API + path + named, headers=theirs, **more)
                assert answer.status_code == 404, (method, path + named, answer.text)
                assert "secret" not in answer.text
        for method, path, more in (
            ("POST", "/pumps", {"json": {"serial": "P-2", "operator": "north"}}),
            ("POST", "/aircraft", {"json": {"aircraft": "F-2", "operator": "north"}}),
            ("GET", "/pump-types/h225/reference-curve?operator=north", {}),
        ):
            assert guarded.request(method, API + path, headers=theirs, **more).status_code == 403, path
        stolen = "operator,serial,pump_type\nnorth,P-7,h225\n"
        assert guarded.post(f"{API}/registry/pumps.csv", content=stolen, headers=theirs).status_code == 422
        for path in ("/aircraft", "/operators/deletions"):
            assert guarded.get(API + path, headers=theirs).json()["items"] == []
        for kind in ("pumps", "aircraft", "installations"):
            assert len(guarded.get(f"{API}/registry/{kind}.csv", headers=theirs).text.splitlines()) == 1
        assert [o["operator"] for o in guarded.get(f"{API}/operators", headers=theirs).json()["items"]] == ["south"]
        summary = guarded.get(f"{API}/fleet/summary", headers=theirs).json()
        assert summary["findings"]["count"] == 0
        assert summary["silent"] == []

    def test_the_same_place_of_two_operators_is_two_places(self, guarded: TestClient) -> None:
        filled(guarded, "north")
        filled(guarded, "south")

    def test_a_measured_curve_is_its_operators_own(self, guarded: TestClient) -> None:
        url = f"{API}/pump-types/h225/reference-curve"
        point = {"discharge_pressure_bar": 174.0, "case_minus_reservoir_bar": 0.35, "fluid_temperature_degc": 50.0}
        points = {"points": [{**point, "speed_rpm": speed} for speed in (4500.0, 4600.0)]}
        north, south = key(guarded, "engineer", "north"), key(guarded, "engineer", "south")
        assert guarded.put(url, json=points, headers=north).status_code == 200
        assert guarded.get(url, headers=north).json()["source"] == "measured"
        assert guarded.get(url, headers=south).json()["source"] == "twin"
        assert guarded.put(url, json=points, headers=key(guarded, "engineer")).status_code == 200
        assert guarded.get(url, headers=south).json()["operator"] is None

    @pytest.mark.parametrize(
        ("role", "finding", "registry", "operators"),
        [("viewer", 403, 403, 403), ("analyst", 201, 403, 403), ("engineer", 201, 201, 403), ("admin", 201, 201, 200)],
    )
    @pytest.mark.postgres_in_study
    def test_roles(self, guarded: TestClient, role: str, finding: int, registry: int, operators: int) -> None:
        filled(guarded, "north")
        headers = key(guarded, role, "north")
        new = {"at": DAY, "found": "no_fault_found"}
        assert guarded.post(f"{API}/pumps/P-1/findings", json=new, headers=headers).status_code == finding
        event = {"at": DAY, "action": "fluid_changed"}
        for path, json_body in (
            ("/pumps/P-1/maintenance", event),
            ("/pumps", {"serial": "P-2"}),
            ("/aircraft", {"aircraft": "F-2"}),
        ):
            assert guarded.post(API + path, json=json_body, headers=headers).status_code == registry, path
        assert guarded.get(f"{API}/operators", headers=headers).status_code == operators
        assert guarded.get(f"{API}/pumps/P-1/installations", headers=headers).status_code == 200


class TestLeaving:
    def test_the_export_holds_everything_and_no_secret(self, guarded: TestClient) -> None:
        ids = filled(guarded, "north")
        filled(guarded, "south", body(document(case_pressure_bar=[0.7] * 160)))
        answer = guarded.get(f"{API}/operators/north/export", headers=key(guarded, "admin", "north"))
        assert answer.status_code == 200
        assert answer.headers["content-type"] == "application/zip"
        archive = zipfile.ZipFile(io.BytesIO(answer.content))
        assert archive.testzip() is None
        rows = {
            name: [json.loads(line) for line in archive.read(name).decode().splitlines()]
            for name in archive.namelist()
            if name.endswith(".jsonl")
        }
        assert [r["id"] for r in rows["tables/records.jsonl"]] == [ids["record"]]
        assert [r["id"] for r in rows["tables/installations.jsonl"]] == [ids["installations"]]
        assert len(rows["tables/assessments.jsonl"]) == 1
        assert archive.read(f"raw/{rows['tables/records.jsonl'][0]['content_hash']}") == body()
        assert rows["tables/api_keys.jsonl"]
        assert "key_hash" not in rows["tables/api_keys.jsonl"][0]
        assert "secret of south" not in str(rows)

    def test_the_deletion_takes_all_of_one_and_nothing_of_others(self, guarded: TestClient) -> None:
        own_bytes = body(document(case_pressure_bar=[0.7] * 160))
        filled(guarded, "north", own_bytes)
        headers = key(guarded, "analyst", "north")
        shared = guarded.post(f"{API}/records?flight_id=F2", content=body(), headers={**headers, **JSON})
        assert shared.status_code == 201
        filled(guarded, "south")
        context = guarded.app.state.context  # type: ignore[attr-defined]
        everybody = key(guarded, "admin")
        url = f"{API}/operators/north"

        def counts(operator: str) -> dict[str, int]:
            with context.database.reading() as session:
                return {
                    name: session.scalar(select(func.count()).select_from(t).where(rows_of(t, operator)))
                    for name, t in owned_tables().items()
                }

        before, others = counts("north"), counts("south")
        assert guarded.delete(url, params={"confirm": "nroth", "reason": "x"}, headers=everybody).status_code == 422
        assert guarded.delete(url, params={"confirm": "north"}, headers=everybody).status_code == 422
        assert counts("north") == before
        answer = guarded.delete(url, params={"confirm": "north", "reason": "contract ended"}, headers=everybody)
        assert answer.status_code == 200, answer.text
        receipt = answer.json()["receipt"]
        assert receipt["rows"] == before
        assert receipt["sha256"] == receipt_hash(receipt)
        assert receipt["reason"] == "contract ended"
        assert set(counts("north").values()) == {0}
        assert counts("south") == others
        # the bytes that south sent too are south's now; those of north alone are gone
        assert len(receipt["raw_files_removed"]) == 1
        assert receipt["raw_files_of_others"] == 1
        raw = [p.name for p in (context.settings.data_dir / "raw").rglob("*") if p.is_file()]
        assert receipt["raw_files_removed"][0] not in raw
        assert len(raw) == 1
        assert guarded.get(f"{API}/pumps", headers=headers).status_code == 401
        south = guarded.get(f"{API}/records", headers=key(guarded, "viewer", "south")).json()["items"][0]
        kept = guarded.get(f"{API}/records/{south['record_id']}/raw", headers=key(guarded, "viewer", "south"))
        assert kept.content == body()
        assert [d["receipt"] for d in guarded.get(f"{API}/operators/deletions", headers=everybody).json()["items"]] == [
            receipt
        ]
        assert guarded.delete(url, params={"confirm": "north", "reason": "x"}, headers=everybody).status_code == 404

    def test_the_deletion_takes_archives_of_bulk_imports(self, guarded: TestClient) -> None:
        guarded.headers.update(key(guarded, "admin", "north"))
        lines = body() + b"\n"
        headers = {"content-type": "application/x-ndjson"}
        job = guarded.post(f"{API}/records/bulk", content=lines, headers=headers).json()
        assert finished(guarded, job["id"])["result"]["counts"] == {"analysed": 1}
        answer = guarded.delete(f"{API}/operators/north", params={"confirm": "north", "reason": "x"})
        assert len(answer.json()["receipt"]["raw_files_removed"]) == 2
        folder = guarded.app.state.context.settings.data_dir / "raw"  # type: ignore[attr-defined]
        assert [p for p in folder.rglob("*") if p.is_file()] == []

    def test_a_deletion_cut_short_is_ended_at_the_next_start(
        self, guarded: TestClient, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        filled(guarded, "north")
        context = guarded.app.state.context  # type: ignore[attr-defined]

        def crash(*_: Any) -> None:
            raise RuntimeError("power cut")

        with monkeypatch.context() as patch:
            patch.setattr("service.registry.deletion._finish", crash)
            with pytest.raises(RuntimeError, match="power cut"):
                delete_operator(context.database, context.raw_store, "north", EVERYBODY, "x")
        finish_deletions(context.database, context.raw_store)
        with context.database.reading() as session:
            (row,) = session.scalars(select(Deletion))
        assert row.finished_at is not None
        assert len(row.receipt["raw_files_removed"]) == 1
        assert [p for p in (context.settings.data_dir / "raw").rglob("*") if p.is_file()] == []

    def test_every_table_that_names_an_operator_is_owned(self) -> None:
        chain = {"audit_heads", "audit_links", "backups"}
        free = {"deletions", "failed_sign_ins", "alembic_version", "installation_values", "pending_sign_ins"} | chain
        unowned = {t.name for t in Base.metadata.sorted_tables} - set(owned_tables()) - free
        assert unowned == set()


def test_retention_removes_raw_bytes_and_keeps_verdicts(guarded: TestClient) -> None:
    ids = filled(guarded, "north", body(document(case_pressure_bar=[0.7] * 160)))
    filled(guarded, "south")
    admin, context = key(guarded, "admin"), guarded.app.state.context  # type: ignore[attr-defined]
    assert guarded.patch(f"{API}/operators/north", json={"retention_days": 0}, headers=admin).status_code == 422
    assert (
        guarded.patch(f"{API}/operators/north", json={"retention_days": 30, "x": 1}, headers=admin).status_code == 422
    )
    assert guarded.patch(f"{API}/operators/west", json={"retention_days": 30}, headers=admin).status_code == 404
    changed = guarded.patch(f"{API}/operators/north", json={"retention_days": 30}, headers=admin)
    kept = {"retention_days": 30, "job_days": None, "audit_days": None, "legal_hold": False}
    assert changed.json() == {"operator": "north", "pumps": 1, "records": 1, **kept}
    verdict = guarded.get(f"{API}/pumps/P-1/verdict?operator=north", headers=admin).json()
    now = datetime.now(UTC)
    assert expire(context.database, context.raw_store, now + timedelta(days=29)) == 0
    assert expire(context.database, context.raw_store, now + timedelta(days=31)) == 1
    assert expire(context.database, context.raw_store, now + timedelta(days=31)) == 0
    assert guarded.get(f"{API}/records/{ids['record']}/raw", headers=admin).status_code == 503
    assert guarded.get(f"{API}/pumps/P-1/verdict?operator=north", headers=admin).json() == verdict
    # what would need the bytes again says that they are gone, and goes on
    patched = guarded.patch(f"{API}/aircraft/F-1?operator=north", json={"circuit": "separate_drain"}, headers=admin)
    assert patched.status_code == 200, patched.text
    flags = guarded.get(f"{API}/pumps/P-1/verdict?operator=north", headers=admin).json()["quality"]["flags"]
    assert any("no longer kept" in flag for flag in flags)
