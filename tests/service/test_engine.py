"""The engine: what the rows say nobody has in hand is taken up, through outages and the loss of workers, each once."""

import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace
from typing import Any
from unittest import mock

import pytest
from dbos import DBOS
from fastapi.testclient import TestClient
from sqlalchemy import event, select, update
from sqlalchemy.exc import OperationalError

from service.context import Context
from service.errors import Problem
from service.jobs import lookout, state, store, upkeep, work
from service.jobs.bulk_import import BulkImport
from service.jobs.presence import presence_of
from service.monitoring.counting import Counting
from service.settings import Settings
from service.storage.tables import Job, Record
from service.web.app import create_app
from tests.service.finished_job import finished
from tests.service.records import body, document
from tests.service.test_failures import AWAY, failing
from tests.service.test_jobs import ZIP, archive, flight

API = "/api/v1"
JSON = {"content-type": "application/json"}


def context_of(client: TestClient) -> Context:
    found: Context = client.app.state.context  # type: ignore[attr-defined]
    return found


def imported(client: TestClient, n: int) -> str:
    content = archive({f"{i:03d}.json": flight(i) for i in range(n)})
    return str(client.post(f"{API}/records/bulk", content=content, headers=ZIP).json()["id"])


def until(holds: Callable[[], bool], within_s: float = 30.0) -> None:
    end = time.monotonic() + within_s
    while not holds():
        assert time.monotonic() < end, "not within the time"
        time.sleep(0.05)


def test_an_outage_in_the_middle_of_a_job_ends_nothing(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    """The database answers nobody for a while: the job waits, and every member counts as if nothing had been."""
    begun = threading.Event()
    item = BulkImport.item

    def noted(*arguments: Any) -> Any:
        begun.set()
        return item(*arguments)

    monkeypatch.setattr(BulkImport, "item", noted)
    job_id = imported(client, 3)
    assert begun.wait(20.0)
    with failing(context_of(client).database, AWAY):
        time.sleep(0.7)
        assert client.get(f"{API}/jobs/{job_id}").status_code == 503
    job = finished(client, job_id)
    assert (job["status"], job["progress"]) == ("succeeded", {"done": 3, "total": 3})
    assert [i["status"] for i in job["items"]][1:] == ["analysed", "analysed"]
    assert client.get(f"{API}/pumps/P-1").json()["records"] == 3


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_a_job_whose_workflow_the_engine_ended_is_taken_up_again(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever dbos says of the workflow, the row says that the job is not done."""
    asked = Counter[str]()
    body_of = work._whole

    def ended(engine: state.Engine, job_id: str, generation: int) -> None:
        asked[job_id] += 1
        if asked[job_id] == 1:
            raise work.engine_errors.DBOSException("the engine has had enough of it")
        body_of(engine, job_id, generation)

    monkeypatch.setattr(work, "_whole", ended)
    job_id = imported(client, 1)
    assert finished(client, job_id)["status"] == "succeeded"
    assert asked == {job_id: 2}
    found = DBOS.list_workflows(workflow_id_prefix=f"{job_id}/", load_output=False)
    assert {w.workflow_id: w.status for w in found}[f"{job_id}/0"] == "ERROR"


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_a_job_that_nothing_helps_ends_with_a_sentence(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ended as often as it was begun, with no item done: it ends its workers."""
    monkeypatch.setattr(work, "MOST_DEATHS", 1)
    monkeypatch.setattr(lookout, "LOOK_S", 0.2)

    def ended(*_: Any) -> None:
        raise work.engine_errors.DBOSException("no")

    monkeypatch.setattr(work, "_whole", ended)
    job = finished(client, imported(client, 1))
    assert job["status"] == "failed"
    assert "workers in turn have ended" in job["problem"]["detail"]


def test_items_are_shared_in_parts_and_counted_once(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    """With another worker beside, an archive comes in parts; a part that was lost goes on where it was."""
    monkeypatch.setattr(work, "CHUNK", 2)
    lost: list[str] = []
    body_of = work._part

    def dropped(engine: state.Engine, job_id: str, its: range) -> None:
        if its.start == 2 and not lost:
            lost.append(job_id)
            raise SystemExit  # as if the process had gone: the engine notes nothing
        body_of(engine, job_id, its)

    monkeypatch.setattr(work, "_part", dropped)
    monkeypatch.setattr(lookout, "_CLAIMED_S", 1.0)
    for kind in ("_InFile", "_InSession"):
        monkeypatch.setattr(f"service.jobs.presence.{kind}.number", lambda _: 2)
    monkeypatch.setattr(BulkImport, "most_parts", 3)
    job = finished(client, job_id := imported(client, 6))
    assert (job["status"], job["result"]["counts"]) == ("succeeded", {"analysed": 6})
    names = {w.workflow_id for w in DBOS.list_workflows(name="casedrain-part", load_output=False)}
    assert lost == [job_id]
    assert names == {f"{job_id}/0/{first}.0" for first in (0, 2, 4)} | {f"{job_id}/0/2.1"}


def test_cancel_ends_an_orphan_at_once(client: TestClient) -> None:
    context = context_of(client)
    with context.database.writing() as session:
        job = store.new_job(session, "reprocess", None, "somebody", {})
        job.status = "running"
    answer = client.post(f"{API}/jobs/{job.id}/cancel")
    assert (answer.status_code, answer.json()["status"]) == (200, "cancelled")


def test_a_refold_that_its_request_did_not_finish_is_finished(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert client.post(f"{API}/records", content=body(), headers=JSON).status_code == 201
    change = {"values": {"case_flow_limit_lpm": 1.3}, "reason": "try"}
    with monkeypatch.context() as patch:
        away = AWAY[context_of(client).database.engine.dialect.name]()
        patch.setattr(work, "_alone", mock.Mock(side_effect=OperationalError("SELECT 1", {}, away)))
        assert client.put(f"{API}/thresholds/fleet/default", json=change, headers={"if-match": "*"}).is_success
    (job,) = client.get(f"{API}/jobs", params={"kind": "refold"}).json()["items"]
    assert job["status"] == "queued"
    assert client.get(f"{API}/pumps/P-1/verdict").json()["threshold_version"] == 0
    with context_of(client).database.writing() as session:
        session.execute(update(Job).values(created_at=datetime.now(UTC) - timedelta(seconds=16)))
    assert client.post(f"{API}/jobs", json={"kind": "report"}).status_code == 202  # wakes whoever is at work
    assert finished(client, job["id"])["status"] == "succeeded"
    assert client.get(f"{API}/pumps/P-1/verdict").json()["threshold_version"] == 1


@pytest.fixture
def started(settings: Settings, monkeypatch: pytest.MonkeyPatch) -> Iterator[TestClient]:
    """An application as it starts, with an engine that does all it can, and rests soon."""
    monkeypatch.setattr(lookout, "LOOK_S", 0.3)
    monkeypatch.setattr(lookout, "LINGER_S", 0.5)
    with TestClient(create_app(settings), base_url="http://localhost", raise_server_exceptions=False) as running:
        yield running


def test_acknowledged_records_are_analysed_and_then_the_engine_rests(
    started: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that nobody waits for at once, one whose request was interrupted when nobody can have it in hand any more."""
    database = context_of(started).database
    with monkeypatch.context() as patch:
        patch.setattr(Counting, "count", mock.Mock(side_effect=RuntimeError("the process ends here")))
        content = body({**document(), "flight_id": "F2", "started_at": "2026-05-03T07:11:00Z"})
        assert started.post(f"{API}/records", content=content, headers=JSON).status_code == 500
    later = started.post(f"{API}/records?wait=false", content=body(), headers=JSON)
    assert later.status_code == 202

    def status(flight_id: str) -> str:
        items = started.get(f"{API}/records").json()["items"]
        return str({i["flight_id"]: i["status"] for i in items}.get(flight_id))

    until(lambda: status("F1") == "analysed")
    assert status("F2") == "stored"  # read, and left to its request
    monkeypatch.setattr(upkeep, "IN_HAND", timedelta(0))
    until(lambda: status("F2") == "analysed")

    engine = state.running
    assert engine is not None
    until(lambda: not engine.awake)
    asked: list[str] = []
    event.listen(database.engine, "before_cursor_execute", lambda *found: asked.append(found[2]))
    time.sleep(1.6)
    questions = [statement for statement in asked if statement != "BEGIN"]
    assert 1 <= len(questions) <= 8
    assert all(statement.startswith("SELECT EXISTS") for statement in questions)


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_a_record_that_fails_for_a_reason_of_ours_is_tried_again_later(client: TestClient) -> None:
    context = context_of(client)
    with mock.patch.object(type(context.acceptance), "process", return_value=None):
        record = client.post(f"{API}/records?wait=false", content=body(), headers=JSON).json()["record_id"]
    engine = state.Engine(context, "", upkeep=True)
    began = datetime.now(UTC)
    with mock.patch.object(type(context.acceptance), "process", side_effect=Problem("no room in the parser")):
        upkeep._process(engine, upkeep.waiting(engine, began))
    assert upkeep.waiting(engine, began) == []
    engine.waiting_until[record] = (0.0, 5.0)
    upkeep._process(engine, upkeep.waiting(engine, began))
    engine.presence.end()
    with context.database.reading() as session:
        assert session.scalars(select(Record.status)).one() == "analysed"


def test_a_worker_is_seen_while_it_lives(client: TestClient) -> None:
    database = context_of(client).database
    one, other = presence_of(database, "one/of a:kind"), presence_of(database, "other")
    for each in (one, other):
        assert each.seen(select(1)) == (1,)
    names = {"one/of a:kind", "other", "gone"}
    assert one.living(names) == {"one/of a:kind", "other"}
    assert one.number() == 2
    other.end()
    assert one.living(names) == {"one/of a:kind"}
    one.end()


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_what_a_lost_worker_had_is_lost_for_good_only_after_the_grace(client: TestClient) -> None:
    """After a restart of the database every lock is missing for a moment: nobody is taken for dead at once."""
    engine = state.Engine(context_of(client), "", upkeep=False)
    engine.presence.grace_s = 0.2
    found: Any = SimpleNamespace(
        workflow_id="records-0/x", name="casedrain-records", status="PENDING", executor_id="gone"
    )
    memory = lookout._Memory(datetime.now(UTC), 0.0, 0.0, "", {})
    with mock.patch.object(DBOS, "cancel_workflow") as cancelled:
        assert lookout._without_lost(engine, memory, [found]) == [found]
        time.sleep(0.25)
        assert lookout._without_lost(engine, memory, [found]) == []
    cancelled.assert_called_once_with("records-0/x")
    engine.presence.end()
