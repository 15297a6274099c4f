"""Database away, locked or out of connections, a disk that is full: 503 and 507 with the truth, reads go on, nothing half-written."""

import errno
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import psycopg
import pytest
from fastapi.testclient import TestClient
from prometheus_client import REGISTRY
from sqlalchemy import event
from structlog.contextvars import merge_contextvars
from structlog.testing import capture_logs

from service.errors import Problem, StorageFull, Unavailable
from service.ingest import parser_pool, worker
from service.ingest.raw import RawFile, Table
from service.storage import database as database_module
from service.storage import disk, raw_store
from service.storage.database import Database
from service.storage.failures import problem_of
from service.storage.tables import Record, Refusal
from tests.service.guarded import guarded_client, key
from tests.service.matrix import API, ENDING, MATRIX, OPEN, PAGE, seeded, sent
from tests.service.records import body

JSON = {"content-type": "application/json"}
WRITES = ("INSERT", "UPDATE", "DELETE")


@pytest.fixture(autouse=True)
def _resolver(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.notifications.guard._resolved", lambda *_: ["93.184.215.14"])


def _sqlite(code: int) -> sqlite3.OperationalError:
    error = sqlite3.OperationalError("made to fail")
    error.sqlite_errorcode = code
    return error


AWAY = {"sqlite": lambda: _sqlite(sqlite3.SQLITE_BUSY), "postgresql": lambda: psycopg.errors.AdminShutdown("stop")}
FULL = {"sqlite": lambda: _sqlite(sqlite3.SQLITE_FULL), "postgresql": lambda: psycopg.errors.DiskFull("no room")}


@contextmanager
def failing(database: Database, errors: Any, only: tuple[str, ...] = ("",)) -> Iterator[None]:
    """Let statements that begin with one of ``only`` fail as the driver would."""

    def fail(_cursor: Any, statement: str, _parameters: Any, _context: Any) -> None:
        if statement.lstrip().upper().startswith(only):
            raise errors[database.engine.dialect.name]()

    event.listen(database.engine, "do_execute", fail)
    try:
        yield
    finally:
        event.remove(database.engine, "do_execute", fail)


def test_no_route_takes_an_outage_for_a_mistake(database_url: str, tmp_path: Path) -> None:
    away = 0
    with guarded_client(database_url, tmp_path) as client, mock.patch("service.jobs.engine.submit"):
        names, admin = seeded(client, "north", "P-1"), key(client, "admin")
        with failing(client.app.state.context.database, AWAY):  # type: ignore[attr-defined]
            for (method, path), entry in MATRIX.items():
                answer = sent(client, method, entry, names, **admin)
                assert answer.status_code != 500, (method, path, answer.text)
                if entry.role not in (OPEN, PAGE):
                    assert answer.status_code == 503, (method, path, answer.status_code)
                    assert int(answer.headers["retry-after"]) >= 1
                    away += 1
            assert client.get("/healthz").status_code == 200
            assert client.get("/readyz").status_code == 503
        assert client.get(f"{API}/pumps", headers=admin).status_code == 200
    assert away > 75


_DECODED = ("/spectrum", "/channels", "/bundle")
"""Answers out of the original bytes, which need room to be decoded."""


def test_a_full_disk_stops_writes_and_no_read(database_url: str, tmp_path: Path) -> None:
    with guarded_client(database_url, tmp_path) as client, mock.patch("service.jobs.engine.submit"):
        names, admin = seeded(client, "north", "P-1"), key(client, "admin", "north")
        with failing(client.app.state.context.database, FULL, WRITES):  # type: ignore[attr-defined]
            for (method, path), entry in MATRIX.items():
                if method == "GET" and entry.role not in (OPEN, PAGE) and not path.endswith(_DECODED):
                    answer = sent(client, method, entry, names, **admin)
                    assert answer.status_code < 400, (path, answer.text)
            answer = client.post(f"{API}/pumps", json={"serial": "P-2"}, headers=admin)
            assert (answer.status_code, answer.json()["title"]) == (507, "Insufficient storage")
            assert sent(client, *_ending(), names, **admin).status_code == 507
        assert client.get(f"{API}/pumps/P-2", headers=admin).status_code == 404
        assert client.get(f"{API}/pumps/P-1", headers=admin).status_code == 200


def _ending() -> tuple[str, Any]:
    return ENDING[0], MATRIX[ENDING]


def test_an_upload_that_no_disk_takes_is_no_fault_of_the_file(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    context = client.app.state.context  # type: ignore[attr-defined]

    def no_room(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(raw_store.os, "fsync", no_room)
        assert client.post(f"{API}/records", content=body(), headers=JSON).status_code == 507
    with monkeypatch.context() as patch:
        patch.setattr(disk.shutil, "disk_usage", lambda _: disk.shutil._ntuple_diskusage(10**9, 10**9 - 9, 9))
        answer = client.post(f"{API}/records", content=body(), headers=JSON)
        assert answer.status_code == 507
        assert client.get("/readyz").json()["checks"]["disk"].startswith("0 MiB are left")
        assert client.get(f"{API}/records").status_code == 200
    left = [
        p
        for p in context.settings.data_dir.rglob("*")
        if p.is_file() and "sqlite" not in p.name and "audit" not in p.name
    ]
    assert left == []
    with context.database.reading() as session:
        assert (session.query(Record).count(), session.query(Refusal).count()) == (0, 0)
    assert client.post(f"{API}/records", content=body(), headers=JSON).status_code == 201


def test_readiness_ends_before_uploads_are_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    total, reserve = 10**10, 10**8
    for free, ready, taken in (
        (3 * reserve, True, True),
        (int(1.5 * reserve), False, True),
        (reserve // 2, False, False),
    ):
        usage = disk.shutil._ntuple_diskusage(total, total - free, free)
        monkeypatch.setattr(disk.shutil, "disk_usage", lambda _, usage=usage: usage)
        assert (disk.shortage([tmp_path], reserve) is None) == ready
        try:
            disk.check_room(tmp_path, 10, reserve)
        except StorageFull:
            assert not taken
        else:
            assert taken


class TestHandOver:
    """Channels between the parser and us: what is lost there says nothing about the file."""

    def test_a_parser_without_room_says_so(self, tmp_path: Path) -> None:
        path = tmp_path / "upload"
        path.write_bytes(body())
        request = {
            "path": str(path),
            "output": str(tmp_path / "nowhere" / "channels.f64"),
            "content_type": "application/json",
            "content_encoding": "",
            "limits": {"inflated_bytes": 10**8, "rows": 10**6},
            "memory_bytes": 2**40,
            "dialect": None,
            "with_texts": True,
        }
        assert worker._answer(request)["problem"] == "StorageFull"

    def test_a_file_that_was_cut_is_a_mistake_of_ours(self, tmp_path: Path) -> None:
        output = tmp_path / "channels.f64"
        answer = worker._handed_over(RawFile({}, (Table({"time_s": np.arange(9.0)}),)), output)
        assert len(parser_pool._taken_over(answer, output).tables[0].channels["time_s"]) == 9
        output.write_bytes(output.read_bytes()[:-20])
        with pytest.raises(Problem) as refused:
            parser_pool._taken_over(answer, output)
        assert refused.value.status == 500


def test_a_stored_record_outlives_an_outage(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bytes that cannot be had for a while refuse nothing: the record waits and is analysed when they can."""
    context = client.app.state.context  # type: ignore[attr-defined]
    with monkeypatch.context() as patch:
        patch.setattr(type(context.acceptance), "process", lambda *_: None)
        answer = client.post(f"{API}/records?wait=false", content=body(), headers=JSON)
        assert answer.status_code == 202
    record = answer.json()["record_id"]

    def away(*_: Any) -> Any:
        raise Unavailable("the store is away")

    with monkeypatch.context() as patch:
        patch.setattr(type(context.archive), "decoded_again", away)
        with pytest.raises(Unavailable):
            context.acceptance.process(record)
    assert client.get(f"{API}/records/{record}").json()["status"] == "stored"
    context.acceptance.process(record)
    assert client.get(f"{API}/records/{record}").json()["status"] == "analysed"


def test_a_mistake_of_ours_carries_its_id(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any, **__: Any) -> None:
        raise KeyError("a bug")

    monkeypatch.setattr("service.web.routes.pumps.queries.pumps", broken)
    before = _errors()
    with capture_logs(processors=[merge_contextvars]) as logged:
        answer = client.get(f"{API}/pumps")
    assert answer.status_code == 500
    name = answer.headers["x-request-id"]
    assert answer.json()["request_id"] == name
    assert name in answer.json()["detail"]
    assert [entry["event"] for entry in logged if entry["request_id"] == name] == ["unexpected error", "request"]
    assert _errors() == before + 1
    text = client.get("/metrics", headers={"accept": "application/openmetrics-text; version=1.0.0"}).text
    assert f'# {{request_id="{name}"}}' in text


def _errors() -> float:
    found = REGISTRY.get_sample_value("casedrain_errors_total", {"route": "/api/v1/pumps"})
    return found or 0.0


def test_unknown_methods_make_no_labels(client: TestClient) -> None:
    for method in ("BREW", "x" * 30, "TRACE"):
        assert client.request(method, f"{API}/pumps").headers["allow"] == "GET, HEAD, POST"
    text = client.get("/metrics").text
    assert 'method="other"' in text
    assert "BREW" not in text


def test_the_cause_is_looked_at_and_nothing_else() -> None:
    try:
        try:
            raise OSError(errno.ENOSPC, "full")
        except OSError as error:
            raise RuntimeError("a library says") from error
    except RuntimeError as wrapped:
        found = problem_of(wrapped)
    assert isinstance(found, StorageFull)
    assert problem_of(OSError(errno.EACCES, "not yours")) is None
    assert problem_of(KeyError("bug")) is None


def test_migrations_wait_for_one_another(database_url: str) -> None:
    engine = Database(database_url).engine
    entered = threading.Event()

    def other() -> None:
        with database_module._alone(Database(database_url).engine):
            entered.set()

    with database_module._alone(engine):
        thread = threading.Thread(target=other)
        thread.start()
        assert not entered.wait(0.3)
    assert entered.wait(5.0)
    thread.join()
