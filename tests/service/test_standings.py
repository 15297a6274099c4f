"""What a pump's row keeps of its standing, and this process of its life, is what stored verdicts say: whatever has changed."""

import json
from collections.abc import Callable, Iterator
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select, update

from service.access.security import EVERYBODY
from service.monitoring.precedence import is_ours
from service.reading import pump_history, queries, standing
from service.reading.pump_history import PumpHistory, changes_of, history_of
from service.storage.among import among
from service.storage.tables import Alarm, Pump, StoredAssessment
from tests.detectors.fleet import history
from tests.service.guarded import guarded_client, key
from tests.service.histories import write_history
from tests.service.records import document
from tests.service.stored_records import store
from tests.service.test_statements import statements

API = "/api/v1"
N = 12


@pytest.fixture
def guarded(database_url: str, tmp_path: Path) -> Iterator[TestClient]:
    with guarded_client(database_url, tmp_path) as running:
        store(running.app.state.context, history(1, N).observations, "P-1", "north")  # type: ignore[attr-defined]
        yield running


def upload(client: TestClient, who: dict[str, str], flight: str, at: Any) -> str:
    """Upload a record of P-1 where its others come from; its id."""
    here = history(1, 1).observations[0]
    place = {"aircraft": here.aircraft, "position": here.position, "pump_serial": "P-1"}
    body = json.dumps({**document(), **place, "flight_id": flight, "started_at": at.isoformat()})
    answer = client.post(f"{API}/records", content=body, headers={**who, "content-type": "application/json"})
    assert answer.status_code == 201, answer.text
    return str(answer.json()["record_id"])


def kept_and_worked_out(client: TestClient) -> tuple[dict[int, Any], dict[int, Any]]:
    """Standings as the rows keep them for their revision, and from stored verdicts."""
    with client.app.state.context.database.reading() as session:  # type: ignore[attr-defined]
        rows = list(session.execute(select(Pump.id, Pump.standing).where(Pump.standing_at == Pump.revision)))
        worked_out = standing._worked_out(session, [row[0] for row in rows])
    return {i: kept for i, kept in rows if kept is not None}, {i: s.to_json() for i, s in worked_out.items()}


def as_read_anew(client: TestClient) -> tuple[PumpHistory, PumpHistory]:
    with client.app.state.context.database.reading() as session:  # type: ignore[attr-defined]
        pump = session.scalars(select(Pump).where(Pump.serial == "P-1")).one()
        return history_of(session, pump), pump_history._read(session, pump_history._query(pump.id))


def check(client: TestClient) -> Any:
    """Hold what is kept against what is stored; the standing of P-1."""
    kept, worked_out = kept_and_worked_out(client)
    assert kept == worked_out
    held, anew = as_read_anew(client)
    for name in ("record_id", "aircraft", "position", "state", "chain"):
        assert getattr(held, name) == getattr(anew, name), name
    for name, numbers in {"at": anew.at, "flight_hours": anew.flight_hours}.items():
        assert np.array_equal(getattr(held, name), numbers, equal_nan=True), name
    assert all(np.array_equal(held.numbers[m], v, equal_nan=True) for m, v in anew.numbers.items())
    return next(iter(kept.values()), None)


def test_it_follows_every_change_of_a_history(guarded: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    who = key(guarded, "analyst", "north")
    first = check(guarded)
    assert first["records"] == N
    last = max(o.at for o in history(1, N).observations)
    newest = upload(guarded, who, "after", last + timedelta(days=2))
    continued: list[bool] = []
    monkeypatch.setattr(pump_history, "_continued", _noted(pump_history._continued, continued))
    assert (after := check(guarded))["records"] == N + 1
    assert (after["record_id"], after["last_record_at"][:10]) == (newest, (last + timedelta(days=2)).isoformat()[:10])
    upload(guarded, who, "late", last - timedelta(days=1, hours=3))
    assert check(guarded)["records"] == N + 2
    assert continued == [True, False]
    answer = guarded.delete(f"{API}/records/{newest}", params={"reason": "another pump's"}, headers=who)
    assert answer.status_code == 200, answer.text
    withdrawn = check(guarded)
    assert (withdrawn["records"], withdrawn["record_id"]) == (N + 1, first["record_id"])
    shown = guarded.get(f"{API}/pumps/P-1", headers=who).json()
    assert {name: shown[name] for name in ("records", "state", "since", "confidence", "last_record_at")} == {
        name: withdrawn[name] for name in ("records", "state", "since", "confidence", "last_record_at")
    }


def test_what_nobody_kept_is_worked_out_until_the_housekeeping_keeps_it(guarded: TestClient) -> None:
    context, who = guarded.app.state.context, key(guarded, "viewer", "north")  # type: ignore[attr-defined]
    before = guarded.get(f"{API}/fleet/ranking", headers=who).json()["items"][0]
    with context.database.writing() as session:
        write_history(session, "hhpp", serial="W")
        # as a release that knows no standings has left it: newer verdicts beside an older standing
        session.execute(update(Pump).where(Pump.serial == "P-1").values(revision=Pump.revision + 1))
        state = update(StoredAssessment).where(StoredAssessment.record_id == _newest(session, "P-1"))
        verdict = dict(session.scalars(select(StoredAssessment.verdict).order_by(StoredAssessment.at.desc())).first())
        session.execute(state.values(verdict={**verdict, "advice": "other words"}, chain="another"))
    shown = {p["serial"]: p for p in guarded.get(f"{API}/fleet/ranking", headers=who).json()["items"]}
    assert shown["P-1"]["advice"] == "other words" != before["advice"]
    assert shown["W"]["state"] == "pump_degradation"
    assert standing.keep_standings(context.database, is_ours()) == 2
    assert standing.keep_standings(context.database, is_ours()) == 0
    kept, worked_out = kept_and_worked_out(guarded)
    assert kept == worked_out
    assert {k["advice"] for k in kept.values()} >= {"other words"}
    again = {p["serial"]: p for p in guarded.get(f"{API}/fleet/ranking", headers=who).json()["items"]}
    assert again == shown


def test_a_hand_on_an_alarm_leaves_the_standing(guarded: TestClient) -> None:
    context, who = guarded.app.state.context, key(guarded, "analyst", "north")  # type: ignore[attr-defined]
    with context.database.writing() as session:
        write_history(session, "hhppp", serial="W")
        alarm = session.scalars(select(Alarm.id)).one()
    standing.keep_standings(context.database, is_ours())
    assert guarded.post(f"{API}/alarms/{alarm}/acknowledge", json={}, headers=who).status_code == 200
    kept, worked_out = kept_and_worked_out(guarded)
    assert len(kept) == 2
    assert kept == worked_out


def test_changes_of_the_verdict_are_those_of_the_api(guarded: TestClient) -> None:
    with guarded.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
        pump = write_history(session, "bbhhpphs", serial="W")
        found = changes_of(session, pump)
        expected = [(a.at, a.state, a.verdict["advice"]) for a in queries.verdict_changes(session, pump)][::-1]
    assert [(c.at, c.state, c.advice) for c in found] == expected
    assert len(found) == 5


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_a_fleet_costs_few_statements_of_few_values(guarded: TestClient) -> None:
    """Neither statements nor the values sent with them grow with the fleet or its records."""
    who = key(guarded, "viewer", "north")
    calls = ("/fleet/ranking", "/fleet/summary", "/fleet/trend?metric=case_flow_at_reference_lpm", "/pumps")
    with guarded.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
        for k in range(6):
            write_history(session, "hhp", serial=f"Q-{k}")
        session.execute(update(StoredAssessment).where(StoredAssessment.chain.is_(None)).values(chain="link"))
    standing.keep_standings(guarded.app.state.context.database, is_ours())  # type: ignore[attr-defined]
    for call, most in zip(calls, (8, 5, 4, 6), strict=True):
        guarded.get(API + call, headers=who)
        with statements() as asked:
            assert guarded.get(API + call, headers=who).status_code == 200
        # looking up the key is among them
        assert len(asked) <= most, (call, asked)
        assert not any("assessments" in text and "findings" not in text for text in asked), call
        assert all(text.count("?") <= 8 for text in asked), call
    with statements() as asked, guarded.app.state.context.database.reading() as session:  # type: ignore[attr-defined]
        assert len(queries.listed(session, EVERYBODY)) == 7
    assert len(asked) == 1


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_the_page_of_a_pump_costs_few_statements(guarded: TestClient) -> None:
    who = key(guarded, "viewer", "north")
    for query, most in (("", 14), ("?range=all", 14), ("?compare=both", 15)):
        assert guarded.get(f"/pumps/P-1{query}", headers=who).status_code == 200
        with statements() as asked:
            assert guarded.get(f"/pumps/P-1{query}", headers=who).status_code == 200
        # looking up the key is among them
        assert len(asked) <= most, asked
        # the newest verdict is read, and no history
        assert sum("assessments.trend" in text for text in asked) <= 1, asked


def test_a_number_is_among_many_others(guarded: TestClient) -> None:
    with guarded.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
        (first, *_), *_ = session.execute(select(Pump.id))
        ids = {first, *(write_history(session, "h", serial=f"N-{k}").id for k in range(4))}
    with guarded.app.state.context.database.reading() as session:  # type: ignore[attr-defined]
        for wanted in ([first, first + 2, 70_000, -1], [], list(range(40_000))):
            found = session.scalars(select(Pump.id).where(among(Pump.id, wanted)).order_by(Pump.id))
            assert list(found) == sorted(ids & set(wanted))
            others = session.scalars(select(Pump.id).where(~among(Pump.id, wanted)).order_by(Pump.id))
            assert list(others) == sorted(ids - set(wanted))
        asked = str(select(Pump.id).where(among(Pump.id, [1])).compile(session.get_bind()))
        assert asked.rstrip().endswith(")"), "an index serves it only where it is compared with nothing"


def _noted(ask: Callable[..., Any], found: list[bool]) -> Callable[..., Any]:
    """The same question, with a note whether it had an answer."""

    def asked(*arguments: Any) -> Any:
        answer = ask(*arguments)
        found.append(answer is not None)
        return answer

    return asked


def _newest(session: Any, serial: str) -> str:
    row = StoredAssessment
    query = select(row.record_id).join(Pump, Pump.id == row.pump_id).where(Pump.serial == serial)
    return str(session.scalars(query.order_by(row.at.desc())).first())
