"""The fleet page: order of the ranking, search and filters; what it reads at once is what it would read one by one."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import Engine, event, select

from service.access.security import EVERYBODY
from service.reading import queries
from service.reading.trend import points_of
from service.storage.tables import Pump, StoredAssessment
from service.thresholds.layers import Scope, put, thresholds_of, thresholds_of_many
from service.thresholds.pins import hold
from tests.service.guarded import guarded_client, key
from tests.service.histories import START, write_history
from tests.service.test_page_forms import come_in

API = "/api/v1"
LETTERS = {"P-1": "hhi", "P-2": "hhppp", "P-3": "hhsss", "P-4": "hhPhhhhh", "P-5": "hhhh"}
FLOW = "case_flow_at_reference_lpm"


@pytest.fixture
def guarded(database_url: str, tmp_path: Path) -> Iterator[TestClient]:
    with guarded_client(database_url, tmp_path) as running:
        with running.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
            for serial, letters in LETTERS.items():
                write_history(session, letters, serial=serial)
            write_history(session, "hhppp", serial="P-2", operator="south")
            for i, row in enumerate(session.scalars(select(StoredAssessment).order_by(StoredAssessment.record_id))):
                mean = None if i % 4 == 1 else 1.0 + 0.01 * i
                row.trend = {} if i % 5 == 2 else {FLOW: {"mean": mean, "low": 0.9, "high": 1.5}}  # type: ignore[typeddict-item]
        yield running


def serials(page: str) -> list[str]:
    return re.findall(r'<th scope="row" class="nowrap"><a href="[^"]*">([^<]+)</a>', page)


def test_it_is_in_the_order_of_the_ranking_and_is_narrowed_like_the_list(guarded: TestClient) -> None:
    come_in(guarded, "vic", "viewer", "north")
    headers = key(guarded, "viewer", "north")
    ranking = [p["serial"] for p in guarded.get(f"{API}/fleet/ranking", headers=headers).json()["items"]]
    assert serials(guarded.get("/").text) == ranking
    for query in ("state=pump_degradation", "side=none", "priority=high", "silent=true", "aircraft=F-1", "type=none"):
        wanted = {p["serial"] for p in guarded.get(f"{API}/pumps?{query}", headers=headers).json()["items"]}
        assert set(serials(guarded.get(f"/?{query}").text)) == wanted, query
    assert serials(guarded.get("/?search=p-3").text) == ["P-3"]
    assert set(serials(guarded.get("/?search=f-1+north").text)) == set(LETTERS)
    assert "No pump fits" in guarded.get("/?search=nobody").text
    assert "south" not in guarded.get("/").text
    assert guarded.get("/?state=broken").status_code == 422


def test_what_is_read_at_once_is_what_is_read_one_by_one(guarded: TestClient) -> None:
    context = guarded.app.state.context  # type: ignore[attr-defined]
    with context.database.writing() as session:
        pumps = list(session.scalars(select(Pump).order_by(Pump.id)))
        put(session, Scope("fleet", "default"), {"alarm_records": 4.0}, "a", EVERYBODY, "*")
        hold(session, pumps[2], 1, "somebody")
        put(session, Scope("pump", "P-2", "south"), {"case_flow_limit_lpm": 2.0}, "b", EVERYBODY, "*")
        put(session, Scope("operator", "north"), {"alarm_records": 6.0, "side_records": 7.0}, "c", EVERYBODY, "*")
        hold(session, pumps[3], 1, "somebody")
        hold(session, pumps[0], 1, "somebody")
        hold(session, pumps[0], None, "somebody")
    with context.database.reading() as session:
        pumps = list(session.scalars(select(Pump).order_by(Pump.id)))
        found = thresholds_of_many(session, pumps)
        for pump in pumps:
            assert found[pump.id] == thresholds_of(session, pump.operator, pump.serial, pump.pump_type), pump.serial
        for n in (1, 3, 60):
            flows = queries.newest_flows(session, [pump.id for pump in pumps], n)
            for pump in pumps:
                newest = queries.newest_assessments(session, pump.id, n)
                assert flows.get(pump.id, []) == points_of(newest, FLOW, None, None), (pump.serial, n)


def test_the_number_of_statements_does_not_grow_with_the_fleet(guarded: TestClient) -> None:
    headers = key(guarded, "viewer")
    context = guarded.app.state.context  # type: ignore[attr-defined]

    def statements(path: str) -> int:
        seen: list[str] = []

        def note(_connection: object, _cursor: object, statement: str, *_: object) -> None:
            seen.append(statement)

        engine: Engine = context.database.engine
        event.listen(engine, "before_cursor_execute", note)
        try:
            assert guarded.get(path, headers=headers).status_code == 200
        finally:
            event.remove(engine, "before_cursor_execute", note)
        return len([s for s in seen if s.lstrip().upper().startswith(("SELECT", "WITH"))])

    paths = ("/", f"{API}/fleet/ranking", f"{API}/fleet/summary", f"{API}/pumps?silent=false&priority=none")
    with context.database.writing() as session:
        session.add(Pump(operator="north", serial="R", pump_type="h225", confirmed=True, created_at=START))
    statements("/")  # notes that the key was used
    before = {path: statements(path) for path in paths}
    with context.database.writing() as session:
        for i in range(12):
            write_history(session, "hhpp", serial=f"Q-{i}")
            session.add(Pump(operator="north", serial=f"R-{i}", pump_type="h225", confirmed=True, created_at=START))
    assert {path: statements(path) for path in paths} == before
    # looking up the key is among them
    assert all(n <= (18 if path == "/" else 14) for path, n in before.items()), before
