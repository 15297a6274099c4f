"""Entries are stored at once and folded behind the commit: nobody waits for them, and whoever dies in between leaves it to the sweep."""

import json
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import timedelta
from threading import Event
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select

from detectors.words.observation import Observation
from service.context import Context
from service.monitoring import behind, refold
from service.monitoring.folded import Folded, folded
from service.monitoring.precedence import made_with
from service.monitoring.renewal import Renewal, due_pumps
from service.storage.tables import MaintenanceEvent, Pump, StoredAssessment, VerdictRevision
from tests.detectors.fleet import history
from tests.service.records import document
from tests.service.stored_records import locked, store

JSON = {"content-type": "application/json"}
API = "/api/v1"
NOON = "2026-05-02T12:00:00Z"


def sent(client: TestClient, n: int, serial: str = "P-1", **changes: Any) -> dict[str, Any]:
    """The n-th flight of a pump, a day after the one before."""
    changed = document()
    changed["channels"]["case_pressure_bar"] = [p + 1e-4 * n for p in changed["channels"]["case_pressure_bar"]]
    named = {"pump_serial": serial, "aircraft": f"A {serial}", "flight_id": f"F{n}"}
    named["started_at"] = f"2026-05-{n + 1:02d}T07:11:00Z"
    answer = client.post(f"{API}/records", content=json.dumps({**changed, **named, **changes}), headers=JSON)
    assert answer.status_code == 201, answer.text
    found: dict[str, Any] = answer.json()
    return found


def entered(client: TestClient, action: str = "setting_adjusted", serial: str = "P-1") -> None:
    answer = client.post(f"{API}/pumps/{serial}/maintenance", json={"at": NOON, "action": action})
    assert answer.status_code == 201, answer.text


def stored(context: Context, *, from_scratch: bool = False) -> list[Any]:
    """Every stored verdict, as it is or as a fold from the first record on makes it."""
    row = StoredAssessment
    with context.database.writing() as session:
        if from_scratch:
            for pump in session.scalars(select(Pump).order_by(Pump.id)).all():
                refold.refold(session, pump, context.archive, from_scratch=True)
            session.flush()
        return list(session.execute(select(row.record_id, row.state, row.verdict, row.chain).order_by(row.record_id)))


def marks(context: Context) -> dict[str, bool]:
    """Pumps, and whether they are through."""
    with context.database.reading() as session:
        return {p.serial: p.made_with == made_with() for p in session.scalars(select(Pump))}


def test_a_record_that_comes_in_while_an_entry_is_folded(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fold of the entry, then the record with a fold of its own, which knows the entry: the first is made again."""
    context = client.app.state.context  # type: ignore[attr-defined]
    sent(client, 0)
    sent(client, 1)
    made: list[Folded] = []
    between: list[Callable[[], object]] = [lambda: sent(client, 2), lambda: entered(client, "filter_changed")]

    def folded_slowly(*given: Any, **more: Any) -> Folded:
        found = folded(*given, **more)
        made.append(found)
        if between:
            between.pop(0)()
        return found

    monkeypatch.setattr(refold, "folded", folded_slowly)
    monkeypatch.setattr(refold, "queue_of", _NoQueue)
    entered(client)
    assert len(made) == 4  # one that met the record, one that met the other entry, that one's own, and the last
    assert marks(context) == {"P-1": True}
    found = stored(context)
    assert len(found) == 3
    assert found == stored(context, from_scratch=True)


def test_nobody_waits_for_an_entry_that_is_folded(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither another pump's record, nor a reader of this one, nor another entry of this very pump."""
    context = client.app.state.context  # type: ignore[attr-defined]
    sent(client, 0)
    before = client.get(f"{API}/pumps/P-1/verdict").json()
    folding, go_on = threading.Event(), threading.Event()

    def folded_slowly(*given: Any, **more: Any) -> Folded:
        folding.set()
        assert go_on.wait(20.0)
        return folded(*given, **more)

    monkeypatch.setattr(refold, "folded", folded_slowly)
    with ThreadPoolExecutor(2) as threads:
        try:
            first = threads.submit(entered, client)
            assert folding.wait(20.0)
            assert sent(client, 1, "P-2")["status"] == "analysed"
            assert client.get(f"{API}/pumps/P-1/verdict").json() == before
            second = threads.submit(entered, client, "filter_changed")
            while len(client.get(f"{API}/pumps/P-1/maintenance").json()["items"]) < 2:
                pass
            assert not first.done()
            assert not second.done()
        finally:
            go_on.set()
        first.result()
        second.result()
    assert marks(context) == {"P-1": True, "P-2": True}
    assert stored(context) == stored(context, from_scratch=True)


def test_the_sweep_makes_what_a_dead_process_has_stored_and_not_folded(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    context = client.app.state.context  # type: ignore[attr-defined]
    for n in range(2):
        sent(client, n)
    only = sent(client, 5, "P-2")
    before = stored(context)
    with monkeypatch.context() as died:
        died.setattr(behind, "apart", lambda *_given, **_more: None)
        entered(client, "pump_overhauled")
        assert client.delete(f"{API}/records/{only['record_id']}", params={"reason": "a trial"}).status_code == 200
    assert stored(context) == before
    assert marks(context) == {"P-1": False, "P-2": False}
    assert Renewal(context.database, context.archive).run(Event()) == 0
    with context.database.reading() as session:
        assert due_pumps(session, own_release=True) == []
        causes = session.scalars(select(VerdictRevision.cause)).all()
    assert set(causes) <= {"reprocessed"}  # no release has come
    found = stored(context)
    assert len(found) == 2  # the withdrawn record was its pump's only one
    assert found != before
    assert found == stored(context, from_scratch=True)


def test_an_entry_whose_fold_fails_stays_and_is_folded_later(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An error would have it sent again; the sweep comes back by itself."""
    context = client.app.state.context  # type: ignore[attr-defined]
    sent(client, 0)

    def fails(*_given: Any, **_more: Any) -> None:
        raise RuntimeError("on purpose")

    renewal = Renewal(context.database, context.archive)
    with monkeypatch.context() as broken:
        broken.setattr(refold, "folded", fails)
        entered(client)
        renewal.run(Event())
    assert renewal.due() == []  # put off
    monkeypatch.setattr("service.monitoring.renewal.time.monotonic", lambda: 1e12)
    renewal.run(Event())
    assert marks(context) == {"P-1": True}


@pytest.fixture(scope="module")
def exchanged() -> dict[str, tuple[Observation, ...]]:
    """P sits at A and goes to B, Q comes from there."""
    return {
        serial: tuple(
            replace(o, at=o.at + timedelta(hours=9 * (serial == "Q")), aircraft=places[i >= 3])
            for i, o in enumerate(history(seed, 6, None).observations)
        )
        for serial, seed, places in (("P", 3, ("A", "B")), ("Q", 4, ("B", "A")))
    }


def test_the_sweep_tells_the_neighbours_that_a_dead_process_has_not_told(
    client: TestClient, exchanged: dict[str, Sequence[Observation]], monkeypatch: pytest.MonkeyPatch
) -> None:
    context = client.app.state.context  # type: ignore[attr-defined]
    for serial, observations in exchanged.items():
        store(context, observations, serial, "north")
    assert marks(context) == {"P": True, "Q": True}
    assert stored(context) == stored(context, from_scratch=True)
    event = {"id": "m", "action": "filter_changed", "note": "", "author": "x", "at": exchanged["P"][1].at}
    with monkeypatch.context() as died, context.database.writing() as session:
        died.setattr(refold, "_told", lambda *_given, **_more: None)
        pump = locked(session, "P", "north")
        session.add(MaintenanceEvent(pump_id=pump.id, recorded_at=event["at"], **event))
        refold.refold(session, pump, context.archive)
    assert marks(context) == {"P": False, "Q": True}
    left = stored(context)
    Renewal(context.database, context.archive).run(Event())
    assert marks(context) == {"P": True, "Q": True}
    found = stored(context)
    assert {i for i, *_ in found} == {i for i, *_ in left}
    assert found != left
    assert found == stored(context, from_scratch=True)


def test_the_sweep_remarks_on_pumps_that_a_dead_process_has_not_told(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same samples as the record of another pump are a remark on both."""
    context = client.app.state.context  # type: ignore[attr-defined]
    sent(client, 0)
    with monkeypatch.context() as died:
        died.setattr("service.monitoring.counting.refold_others", lambda *_given: None)
        sent(client, 0, "P-2", flight_id="F9", started_at="2026-05-09T07:11:00Z")
    assert marks(context) == {"P-1": False, "P-2": True}
    assert _flags(client) == []
    Renewal(context.database, context.archive).run(Event())
    assert marks(context) == {"P-1": True, "P-2": True}
    assert _flags(client) != []
    assert stored(context) == stored(context, from_scratch=True)


def _flags(client: TestClient) -> list[str]:
    found: list[str] = client.get(f"{API}/pumps/P-1/verdict").json()["quality"]["flags"]
    return found


class _NoQueue:
    def __init__(self, *_given: str) -> None: ...
    def __enter__(self) -> None: ...
    def __exit__(self, *_given: object) -> None: ...
