"""Records that come late into a long history, and several at once: answered soon, and nobody sees what is not made yet."""

import json
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select

from detectors.words.observation import Observation
from service.monitoring import counting
from service.monitoring.folded import MOST_AT_ONCE, Folded
from service.monitoring.refold import apart, attempted, refold
from service.monitoring.renewal import Renewal
from service.storage.database import Database
from service.storage.tables import Pump, StoredAssessment
from tests.detectors.fleet import FAULTS, history
from tests.service.records import document
from tests.service.stored_records import store

JSON = {"content-type": "application/json"}
OPERATOR, SERIAL = "default", "P-1"
N = MOST_AT_ONCE + 12


@pytest.fixture(scope="module")
def flights() -> Sequence[Observation]:
    return history(5, N, FAULTS["worn"]).observations


def body(at: Any, flight_id: str, here: Observation | None = None) -> bytes:
    place = {} if here is None else {"aircraft": here.aircraft, "position": here.position}
    return json.dumps({**document(), **place, "flight_id": flight_id, "started_at": at.isoformat()}).encode()


def stored(client: TestClient, *, from_scratch: bool = False) -> list[Any]:
    context = client.app.state.context  # type: ignore[attr-defined]
    row = StoredAssessment
    columns = (row.record_id, row.state, row.trend, row.verdict, row.chain)
    with context.database.writing() as session:
        pump = session.scalars(select(Pump)).one()
        if from_scratch:
            refold(session, pump, context.archive, from_scratch=True)
            session.flush()
        return list(session.execute(select(*columns).order_by(row.at, row.record_id)))


def test_what_follows_a_late_record_is_made_before_it_is_read(
    client: TestClient, flights: Sequence[Observation], monkeypatch: pytest.MonkeyPatch
) -> None:
    context = client.app.state.context  # type: ignore[attr-defined]
    store(context, flights, SERIAL, OPERATOR)
    monkeypatch.setattr("service.monitoring.settling.QUIET_S", 3600.0)  # nobody but readers
    answers = []
    for i in (4, 2):
        at = flights[i].at + timedelta(minutes=90)
        answer = client.post("/api/v1/records", content=body(at, f"late-{i}", flights[i]), headers=JSON)
        assert answer.status_code == 201, answer.text
        answers.append(answer.json())
    assert answers[1]["verdict"]["quality"]["records_used"] == 4
    settling = context.acceptance.settling
    assert settling.is_due
    with context.database.reading() as session:
        assert session.scalars(select(Pump.made_with)).one() is None  # what another start would go on from
    settling.settle("another operator")
    assert settling.is_due
    assert Renewal(context.database, context.archive).due() == [*settling.in_hand()]  # what another process would take
    assert Renewal(context.database, context.archive, settling.in_hand).due() == []
    verdict = client.get(f"/api/v1/pumps/{SERIAL}/verdict").json()
    assert not settling.is_due
    assert verdict["quality"]["records_used"] >= N
    found = stored(client)
    assert len(found) == N + 2
    assert found == stored(client, from_scratch=True)


def test_many_who_read_and_the_background_make_it_once_together(
    client: TestClient, flights: Sequence[Observation], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each of them folding the same history for itself made all of them wait as many times as long."""
    context = client.app.state.context  # type: ignore[attr-defined]
    store(context, flights, SERIAL, OPERATOR)
    settling = context.acceptance.settling
    made: list[str] = []

    def counted(name: str, really: Callable[..., Any]) -> Callable[..., Any]:
        def call(*args: Any, **options: Any) -> Any:
            made.append(name)
            time.sleep(0.3)  # longer than the background waits
            return really(*args, **options)

        return call

    monkeypatch.setattr("service.monitoring.settling.apart", counted("reader", apart))
    monkeypatch.setattr("service.monitoring.settling.attempted", counted("background", attempted))
    content = body(flights[2].at + timedelta(minutes=90), "late", flights[2])
    assert client.post("/api/v1/records", content=content, headers=JSON).status_code == 201
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda _: settling.settle(), range(4)))
    assert len(made) == 1
    assert not settling.is_due
    assert stored(client) == stored(client, from_scratch=True)


def test_a_fold_is_made_again_where_the_pump_has_changed_meanwhile(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Maintenance, thresholds and another record come between a fold and its storing, once each."""
    start = "2026-05-02T07:11:00+00:00"
    first = json.loads(body_of(0))
    assert client.post("/api/v1/records", content=json.dumps(first), headers=JSON).status_code == 201
    between = [
        lambda: client.post(f"/api/v1/pumps/{SERIAL}/maintenance", json={"at": start, "action": "setting_adjusted"}),
        lambda: client.put(
            "/api/v1/thresholds/fleet/default",
            json={"values": {"baseline_records": 3}, "reason": "a trial"},
            headers={"If-Match": "*"},
        ),
        lambda: client.post("/api/v1/records", content=body_of(1), headers=JSON),
    ]
    original, made = counting.folded, []

    def folded_slowly(*given: Any, **more: Any) -> Folded:
        found = original(*given, **more)
        made.append(found)
        if between:
            assert between.pop(0)().status_code in (200, 201)
        return found

    monkeypatch.setattr(counting, "folded", folded_slowly)
    monkeypatch.setattr(counting, "queue_of", _no_queue)
    for n in (2, 3, 4):
        answer = client.post("/api/v1/records", content=body_of(n), headers=JSON)
        assert answer.status_code == 201, answer.text
        assert answer.json()["verdict"]["threshold_version"] == 1
    assert len(made) == 4 + 3  # of the first one the last under the lock, and one of the record that came between
    found = stored(client)
    assert len(found) == 5
    assert found == stored(client, from_scratch=True)


def test_many_at_once_end_as_one_by_one(client: TestClient) -> None:
    with ThreadPoolExecutor(6) as threads:
        answers = list(
            threads.map(lambda n: client.post("/api/v1/records", content=body_of(n), headers=JSON), range(6))
        )
    assert [a.status_code for a in answers] == [201] * 6, [a.text for a in answers]
    found = stored(client)
    assert len(found) == 6
    assert found == stored(client, from_scratch=True)


def test_nobody_waits_for_a_writer_that_another_has_left(tmp_path: Any) -> None:
    """Writers take turns, also behind one that fails."""
    database = Database(f"sqlite:///{tmp_path / 'x.sqlite'}")
    with pytest.raises(RuntimeError, match="on purpose"), database.writing():
        raise RuntimeError("on purpose")
    done = threading.Event()

    def write() -> None:
        with database.writing():
            done.set()

    threading.Thread(target=write).start()
    assert done.wait(5.0)
    database.close()


def body_of(n: int) -> bytes:
    changed = document()
    changed["channels"]["case_pressure_bar"] = [p + 1e-4 * n for p in changed["channels"]["case_pressure_bar"]]
    return json.dumps({**changed, "flight_id": f"F{n}", "started_at": f"2026-05-{n + 1:02d}T07:11:00Z"}).encode()


class _no_queue:  # noqa: N801 - stands for a function
    def __init__(self, *_given: str) -> None: ...
    def __enter__(self) -> None: ...
    def __exit__(self, *_given: object) -> None: ...
