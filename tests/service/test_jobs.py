"""Jobs: bulk import with a result per item, reprocessing, cancelling, and work that survives kill -9."""

import io
import json
import os
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import func, select

from service.demo.fleet import DemoRecord
from service.settings import Settings
from service.storage.raw_store import content_hash
from service.storage.tables import ANALYSED, JobItem, Record
from service.web.app import create_app
from tests.service.finished_job import finished
from tests.service.records import body, document

API = "/api/v1"
ZIP, NDJSON = {"content-type": "application/zip"}, {"content-type": "application/x-ndjson"}


def archive(members: dict[str, bytes]) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as file:
        for name, content in members.items():
            file.writestr(name, content)
    return out.getvalue()


def flight(i: int) -> bytes:
    return json.dumps({**document(), "flight_id": f"F{i}"}).encode()


def test_bad_members_are_refused_by_name_while_the_good_ones_count(client: TestClient) -> None:
    members = {
        "day/a.json": flight(1),
        "day/b.json": flight(2),
        "../../etc/passwd.json": flight(3),
        "/absolute.json": flight(4),
        "c:\\x.json": flight(5),
        "inner.zip": archive({"a.json": flight(6)}),
        "disguised.json": archive({"a.json": flight(7)}),
        "notes.docx": b"hello",
        "bomb.csv": b"0" * 3_000_000,
        "broken.json": b"{",
        "wrong.json": body(document(case_pressure_bar=None)),
    }
    answer = client.post(f"{API}/records/bulk", content=archive(members), headers=ZIP)
    assert answer.status_code == 202, answer.text
    assert answer.headers["location"] == f"{API}/jobs/{answer.json()['id']}"
    job = finished(client, answer.json()["id"])
    assert job["status"] == "succeeded"
    assert job["progress"] == {"done": len(members), "total": len(members)}
    assert job["result"]["counts"] == {"analysed": 2, "refused": 9}
    found = {item["name"]: item for item in job["items"]}
    assert [n for n, item in found.items() if item["status"] == "analysed"] == ["day/a.json", "day/b.json"]
    assert found["bomb.csv"]["problem"]["status"] == 413
    assert found["broken.json"]["problem"]["status"] == 400
    assert found["wrong.json"]["problem"]["errors"][0]["where"] == "channels.case_pressure_bar"
    assert "archive" in found["disguised.json"]["problem"]["detail"]
    assert "path" in found["../../etc/passwd.json"]["problem"]["detail"]
    again = client.post(f"{API}/records/bulk", content=archive(members), headers=ZIP)
    repeated = finished(client, again.json()["id"])
    assert repeated["result"]["counts"] == {"known": 2, "refused": 9}
    assert client.get(f"{API}/pumps/P-1").json()["records"] == 2


def test_ndjson_names_its_lines(client: TestClient) -> None:
    content = b"\n".join((flight(1).replace(b"\n", b""), b"", b'{"a": ', flight(2).replace(b"\n", b"")))
    job = finished(client, client.post(f"{API}/records/bulk", content=content, headers=NDJSON).json()["id"])
    assert [(i["name"], i["status"]) for i in job["items"]] == [
        ("line 1", "analysed"),
        ("line 3", "refused"),
        ("line 4", "analysed"),
    ]
    page = client.get(f"{API}/jobs/{job['id']}/items", params={"limit": 2}).json()
    rest = client.get(f"{API}/jobs/{job['id']}/items", params={"limit": 2, "cursor": page["next"]}).json()
    assert [i["name"] for i in page["items"] + rest["items"]] == ["line 1", "line 3", "line 4"]
    assert rest["next"] is None


@pytest.mark.parametrize(
    ("content", "headers", "status"),
    [
        (b"", ZIP, 400),
        (b"PK\x03\x04nothing", ZIP, 400),
        (b"no zip", ZIP, 400),
        (archive({}), ZIP, 400),
        (b"\n\n", NDJSON, 400),
        (b"x", {"content-type": "text/csv"}, 415),
    ],
)
def test_what_is_no_archive_starts_no_job(
    client: TestClient, content: bytes, headers: dict[str, str], status: int
) -> None:
    assert client.post(f"{API}/records/bulk", content=content, headers=headers).status_code == status
    assert client.get(f"{API}/jobs").json()["items"] == []


def test_reprocess_changes_nothing_when_nothing_changed(client: TestClient, worn_records: list[DemoRecord]) -> None:
    for record in worn_records[:6]:
        client.post(f"{API}/records", content=record.content, headers={"content-type": "text/csv"})
    serial = client.get(f"{API}/pumps").json()["items"][0]["serial"]
    before = client.get(f"{API}/pumps/{serial}/verdict").json()
    for dry_run in (True, False):
        wanted = {"kind": "reprocess", "parameters": {"pump": serial, "dry_run": dry_run}}
        answer = client.post(f"{API}/jobs", json=wanted)
        assert answer.status_code == 202, answer.text
        job = finished(client, answer.json()["id"])
        assert job["status"] == "succeeded", job
        assert [(i["name"], i["status"], i["records"]) for i in job["items"]] == [(serial, "unchanged", 6)]
    assert client.get(f"{API}/pumps/{serial}/verdict").json() == before


def test_a_dry_run_shows_what_would_change_and_changes_nothing(
    client: TestClient, worn_records: list[DemoRecord]
) -> None:
    from service.storage.tables import StoredAssessment

    for record in worn_records[:4]:
        client.post(f"{API}/records", content=record.content, headers={"content-type": "text/csv"})
    database = client.app.state.context.database  # type: ignore[attr-defined]
    with database.writing() as session:
        for row in session.scalars(select(StoredAssessment)):
            row.verdict = {**row.verdict, "state": "healthy_by_an_older_twin"}
            row.state = row.verdict["state"]
    for dry_run, left in ((True, 4), (False, 0)):
        wanted = {"kind": "reprocess", "parameters": {"dry_run": dry_run, "only": "verdicts"}}
        job = finished(client, client.post(f"{API}/jobs", json=wanted).json()["id"])
        (item,) = job["items"]
        assert item["status"] == "changed"
        assert {c["before"] for c in item["changes"]} == {"healthy_by_an_older_twin"}
        assert item["changed"] == 4
        with database.reading() as session:
            old = select(StoredAssessment).where(StoredAssessment.state == "healthy_by_an_older_twin")
            assert len(session.scalars(old).all()) == left


def test_a_pump_without_its_raw_bytes_stops_none_of_the_others(
    client: TestClient, worn_records: list[DemoRecord]
) -> None:
    lost = worn_records[0].content
    assert client.post(f"{API}/records", content=lost, headers={"content-type": "text/csv"}).status_code == 201
    assert client.post(f"{API}/records", content=body(), headers={"content-type": "application/json"}).is_success
    assert client.app.state.context.raw_store.remove(content_hash(lost))  # type: ignore[attr-defined]
    verdict = client.get(f"{API}/pumps/{worn_records[0].pump.serial}/verdict").json()
    job = finished(client, client.post(f"{API}/jobs", json={"kind": "reprocess"}).json()["id"])
    assert job["status"] == "succeeded"
    assert {item["pump"]: item["status"] for item in job["items"]} == {
        worn_records[0].pump.serial: "failed",
        document()["pump_serial"]: "unchanged",
    }
    assert "up_to_pump" not in job["parameters"]
    assert client.get(f"{API}/pumps/{worn_records[0].pump.serial}/verdict").json() == verdict


def test_bad_requests_for_jobs_are_refused_by_name(client: TestClient) -> None:
    assert client.post(f"{API}/jobs", json={"kind": "dance"}).status_code == 422
    assert client.post(f"{API}/jobs", json={"kind": "bulk-import"}).status_code == 422
    answer = client.post(f"{API}/jobs", json={"kind": "reprocess", "parameters": {"colour": 1}})
    assert answer.json()["errors"][0]["where"] == "parameters.colour"
    assert client.post(f"{API}/jobs", json={"kind": "reprocess", "parameters": {"pump": "none"}}).status_code == 404
    for method, path in (("get", "none"), ("get", "none/items"), ("post", "none/cancel")):
        assert getattr(client, method)(f"{API}/jobs/{path}").status_code == 404
    assert client.get(f"{API}/jobs").json() == {"items": [], "next": None}


def test_a_job_is_cancelled_between_items_and_only_once(client: TestClient) -> None:
    members = {f"{i}.json": flight(i) for i in range(60)}
    job_id = client.post(f"{API}/records/bulk", content=archive(members), headers=ZIP).json()["id"]
    assert client.post(f"{API}/jobs/{job_id}/cancel").status_code == 200
    job = finished(client, job_id)
    assert job["status"] == "cancelled"
    assert job["progress"]["done"] < 60
    assert client.post(f"{API}/jobs/{job_id}/cancel").status_code == 409


def test_jobs_of_other_operators_are_unseen(settings: Settings) -> None:
    from service.access.security import new_key

    guarded = settings.model_copy(update={"auth": "on"})
    with TestClient(create_app(guarded), base_url="http://localhost") as client:
        keys = {}
        with client.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
            for operator in ("north", "south"):
                keys[operator] = {"authorization": f"Bearer {new_key(session, operator, 'analyst', operator, None)[1]}"}
        content = archive({"a.json": flight(1)})
        job = client.post(f"{API}/records/bulk", content=content, headers={**ZIP, **keys["north"]}).json()
        assert job["operator"] == "north"
        assert client.get(f"{API}/jobs", headers=keys["north"]).json()["items"][0]["id"] == job["id"]
        assert client.get(f"{API}/jobs", headers=keys["south"]).json()["items"] == []
        for method, path in (("get", ""), ("get", "/items"), ("post", "/cancel")):
            foreign = getattr(client, method)(f"{API}/jobs/{job['id']}{path}", headers=keys["south"])
            assert foreign.status_code == 404


def test_orphaned_jobs_are_taken_up(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> None:
    """One that was stored and never queued, and one whose worker was taken away for good."""
    from datetime import UTC, datetime, timedelta

    from service.jobs import engine, store
    from service.running import opened

    monkeypatch.setattr(engine, "_WATCH_INTERVAL_S", 0.2)
    context = opened(settings)
    long_ago = datetime.now(UTC) - timedelta(hours=1)
    with context.spool.of(archive({"a.json": flight(1)})) as file, context.database.writing() as session:
        context.raw_store.put_file(file.path, file.digest)
        values = {"content_hash": file.digest, "format": "zip"}
        ids = []
        for status in ("queued", "running"):
            job = store.new_job(session, "bulk-import", "default", "somebody", values)
            job.status, job.created_at, job.heartbeat_at = status, long_ago, long_ago
            ids.append(job.id)
    context.close()
    with TestClient(create_app(settings), base_url="http://localhost") as client:
        assert [finished(client, job_id)["status"] for job_id in ids] == ["succeeded", "succeeded"]
        assert client.get(f"{API}/pumps/P-1").json()["records"] == 1


def test_thresholds_of_a_large_fleet_are_refolded_by_a_job(
    client: TestClient, worn_records: list[DemoRecord], monkeypatch: pytest.MonkeyPatch
) -> None:
    from service.jobs import refolding

    monkeypatch.setattr(refolding, "MOST_PUMPS_AT_ONCE", 0)
    for record in worn_records[:3]:
        client.post(f"{API}/records", content=record.content, headers={"content-type": "text/csv"})
    change = {"values": {"case_flow_limit_lpm": 1.3}, "reason": "try"}
    answer = client.put(f"{API}/thresholds/fleet/default", json=change, headers={"if-match": "*"})
    assert answer.status_code == 200
    (job,) = client.get(f"{API}/jobs", params={"kind": "refold"}).json()["items"]
    assert finished(client, job["id"])["status"] == "succeeded"
    serial = client.get(f"{API}/pumps").json()["items"][0]["serial"]
    assert client.get(f"{API}/pumps/{serial}/verdict").json()["threshold_version"] == 1


WORKER = """
import sys, time
from datetime import timedelta
from pathlib import Path
import structlog
from service.running import opened
from service.jobs import engine, requests, store
from service.settings import Settings
structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(50))
engine._WATCH_INTERVAL_S, store.ORPHANED_AFTER = 0.5, timedelta(seconds=6)  # instead of 20 s and a minute
context = opened(Settings(database_url=sys.argv[1], data_dir=Path(sys.argv[2]), worker_name=sys.argv[3]))
engine.start(context)
print("started", flush=True)
time.sleep(600)
"""


@pytest.fixture
def workers(settings: Settings) -> Iterator[list[subprocess.Popen[str]]]:
    started: list[subprocess.Popen[str]] = []
    yield started
    for process in started:
        process.kill()
        process.wait()


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as held:
        yield held


def launch_worker(
    settings: Settings, workers: list[subprocess.Popen[str]], name: str = "worker"
) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-c", WORKER, settings.effective_database_url, str(settings.data_dir), name],
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).resolve().parents[2],
    )
    workers.append(process)
    return process


def wait_for(process: subprocess.Popen[str]) -> None:
    assert process.stdout is not None
    with process.stdout as out:
        assert out.readline().strip() == "started"


def start_worker(settings: Settings, workers: list[subprocess.Popen[str]]) -> subprocess.Popen[str]:
    process = launch_worker(settings, workers)
    wait_for(process)
    return process


@pytest.mark.study
@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)  # on Postgres: the test of several workers
def test_kill_9_in_the_middle_costs_nothing(settings: Settings, workers: list[subprocess.Popen[str]]) -> None:
    """A worker is killed while it imports; the next one finishes the job with every item exactly once."""
    from service.access.security import EVERYBODY
    from service.jobs.requests import ask_for
    from service.running import opened
    from service.storage.tables import Job

    n = 60
    context = opened(settings)
    with context.spool.of(archive({f"{i}.json": flight(i) for i in range(n)})) as file:
        context.raw_store.put_file(file.path, file.digest)
        values = {"content_hash": file.digest, "format": "zip"}
    first = start_worker(settings, workers)
    job_id = ask_for(context, EVERYBODY, "bulk-import", "default", values).id

    def progress() -> tuple[str, int]:
        with context.database.reading() as session:
            job = session.get_one(Job, job_id)
            return job.status, job.done

    _enqueue(settings, job_id)
    for _ in range(1200):
        if progress()[1] >= 3:
            break
        time.sleep(0.05)
    os.kill(first.pid, signal.SIGKILL)
    first.wait()
    status, done = progress()
    assert status == "running"
    assert 3 <= done < n
    start_worker(settings, workers)
    for _ in range(1200):
        if progress()[0] != "running":
            break
        time.sleep(0.1)
    assert progress() == ("succeeded", n)
    with context.database.reading() as session:
        assert session.scalar(select(func.count()).select_from(JobItem).where(JobItem.job_id == job_id)) == n
        assert session.scalar(select(func.count()).select_from(Record).where(Record.status == ANALYSED)) == n
    context.close()


@pytest.mark.study
@pytest.mark.parametrize("database_url", ["postgres"], indirect=True)
def test_several_workers_share_the_jobs_and_finish_those_of_one_that_is_killed(
    settings: Settings, workers: list[subprocess.Popen[str]], stack: ExitStack
) -> None:
    """Two workers on one database, one of them killed in the middle of a job, which never comes back."""
    from service.access.security import EVERYBODY
    from service.jobs.requests import ask_for
    from service.running import opened
    from service.storage.tables import Job

    n_jobs, n_flights = 4, 10
    first, second = (launch_worker(settings, workers, name) for name in ("first", "second"))
    context = stack.enter_context(closing(opened(settings)))
    ids = []
    for j in range(n_jobs):
        members = {
            f"{i}.json": json.dumps({**json.loads(flight(i)), "pump_serial": f"P-{j}"}).encode()
            for i in range(n_flights)
        }
        with context.spool.of(archive(members)) as file:
            context.raw_store.put_file(file.path, file.digest)
            ids.append(
                ask_for(context, EVERYBODY, "bulk-import", "default", {"content_hash": file.digest, "format": "zip"}).id
            )
    for process in (first, second):
        wait_for(process)
    for job_id in ids:
        _enqueue(settings, job_id)

    def progress() -> dict[str, tuple[str, int]]:
        with context.database.reading() as session:
            return {job_id: (job.status, job.done) for job_id in ids for job in [session.get_one(Job, job_id)]}

    for _ in range(2400):
        if sum(status == "running" and done > 0 for status, done in progress().values()) == 2:
            break  # each of them has one in hand
        time.sleep(0.02)
    assert sum(status == "running" for status, _ in progress().values()) == 2
    os.kill(first.pid, signal.SIGKILL)
    first.wait()
    for _ in range(1200):
        if all(status not in ("running", "queued") for status, _ in progress().values()):
            break
        time.sleep(0.1)
    assert progress() == dict.fromkeys(ids, ("succeeded", n_flights))
    with context.database.reading() as session:
        statuses = list(session.scalars(select(JobItem.status).where(JobItem.job_id.in_(ids))))
        assert session.scalar(select(func.count()).select_from(Record).where(Record.status == ANALYSED)) == len(
            statuses
        )
    assert len(statuses) == n_jobs * n_flights
    # the item in hand when the worker died may have been stored without its note
    assert statuses.count("analysed") >= len(statuses) - 1
    assert set(statuses) <= {"analysed", "known"}


def _enqueue(settings: Settings, job_id: str) -> None:
    """Hand the job over as a process without a worker does: through the queue in the database."""
    from dbos import DBOSClient

    from service.jobs.engine import QUEUE, system_url

    client = DBOSClient(system_database_url=system_url(settings.effective_database_url))
    client.enqueue({"queue_name": QUEUE, "workflow_name": "casedrain-job", "workflow_id": job_id}, job_id)
    client.destroy()
