"""What is older than its operator keeps it goes: jobs with their documents, audit entries with their salts; not under a hold."""

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from fastapi.testclient import TestClient
from sqlalchemy import func, select

from service.access.audit_proof import verify_database
from service.registry.operators import expire
from service.registry.retention import expire_all, expire_audit, expire_jobs
from service.storage.tables import AuditEntry, Job, JobItem
from tests.service.finished_job import finished
from tests.service.guarded import guarded_client, key
from tests.service.records import body, document

API = "/api/v1"


def files(context: Any) -> int:
    return sum(path.is_file() for path in (context.settings.data_dir / "raw").rglob("*"))


def count(context: Any, table: Any, *where: Any) -> int:
    with context.database.reading() as session:
        return int(session.scalar(select(func.count()).select_from(table).where(*where)) or 0)


def filled(client: TestClient, operator: str) -> dict[str, str]:
    asker = key(client, "admin", operator)
    lines = "\n".join(json.dumps({**document(), "flight_id": f"F{i}", "pump_serial": f"P-{i}"}) for i in range(2))
    kind = {**asker, "content-type": "application/x-ndjson"}
    job = client.post(f"{API}/records/bulk", content=f"{lines}\n{operator}", headers=kind).json()
    client.headers.update(asker)
    finished(client, job["id"])
    for name in asker:
        del client.headers[name]
    return asker


def test_jobs_and_entries_go_with_their_age_and_the_chain_verifies(database_url: str, tmp_path: Path) -> None:
    with guarded_client(database_url, tmp_path) as client:
        context, admin = client.app.state.context, key(client, "admin")  # type: ignore[attr-defined]
        north = filled(client, "north")
        filled(client, "south")
        wanted = {"job_days": 30, "audit_days": 60}
        changed = client.patch(f"{API}/operators/north", json=wanted, headers=north)
        assert {name: changed.json()[name] for name in wanted} == wanted
        now, before = datetime.now(UTC), files(context)
        assert before == 4  # two records that both sent alike, and an archive of each
        assert expire_jobs(context.database, context.raw_store, now + timedelta(days=29)) == 0
        assert expire_jobs(context.database, context.raw_store, now + timedelta(days=31)) == 1
        assert (count(context, Job), count(context, JobItem), files(context)) == (1, 3, before - 1)
        assert len(client.get(f"{API}/records", headers=north).json()["items"]) == 2
        n_of_north = count(context, AuditEntry, AuditEntry.operator == "north")
        assert n_of_north
        assert expire_audit(context.database, now + timedelta(days=59)) == 0
        assert expire_audit(context.database, now + timedelta(days=61)) == n_of_north
        assert expire_audit(context.database, now + timedelta(days=61)) == 0
        found = verify_database(context.database, None, [])
        assert (found.faults, found.erased) == ([], n_of_north)
        assert client.get(f"{API}/audit", headers=north).json()["items"] == []
        said = client.get(f"{API}/audit?action=audit.expire", headers=admin).json()["items"]
        assert [(e["actor"], e["subject"]) for e in said] == [("retention", "operator/north")]


def test_nothing_goes_under_a_legal_hold(database_url: str, tmp_path: Path) -> None:
    with guarded_client(database_url, tmp_path) as client:
        context, everybody = client.app.state.context, key(client, "admin")  # type: ignore[attr-defined]
        north = filled(client, "north")
        url, years = f"{API}/operators/north", datetime.now(UTC) + timedelta(days=3650)
        days = {"retention_days": 1, "job_days": 1, "audit_days": 30}
        held = client.patch(url, json={**days, "legal_hold": True}, headers=north)
        assert held.json()["legal_hold"] is True
        before = files(context), count(context, AuditEntry), count(context, Job)
        expire_all(context.database, context.raw_store, years)
        assert (files(context), count(context, AuditEntry), count(context, Job)) == before
        refused = client.delete(f"{url}?confirm=north&reason=x", headers=everybody)
        assert refused.status_code == 409
        assert "legal hold" in refused.json()["detail"]
        assert client.patch(url, json={"legal_hold": False}, headers=north).status_code == 403
        assert client.patch(url, json={"job_days": 7}, headers=north).json()["legal_hold"] is True
        for wrong in ({}, {"legal_hold": None}, {"audit_days": 1}, {"job_days": 0}):
            assert client.patch(url, json=wrong, headers=everybody).status_code == 422, wrong
        assert client.patch(url, json={"legal_hold": False}, headers=everybody).json()["retention_days"] == 1
        assert expire(context.database, context.raw_store, years) == 3
        expire_all(context.database, context.raw_store, years)
        assert count(context, Job) == 0
        assert client.delete(f"{url}?confirm=north&reason=x", headers=everybody).status_code == 200


def test_bytes_that_somebody_else_needs_stay(database_url: str, tmp_path: Path) -> None:
    with guarded_client(database_url, tmp_path) as client:
        context = client.app.state.context  # type: ignore[attr-defined]
        asker = {**filled(client, "north"), "content-type": "application/json"}
        content = body({**document(), "flight_id": "F9"})
        assert client.post(f"{API}/records", content=content, headers=asker).status_code == 201
        client.patch(f"{API}/operators/north", json={"job_days": 1}, headers=asker)
        expire_jobs(context.database, context.raw_store, datetime.now(UTC) + timedelta(days=2))
        for record in client.get(f"{API}/records", headers=asker).json()["items"]:
            assert client.get(f"{API}/records/{record['record_id']}/raw", headers=asker).status_code == 200
