"""Stored alarms: they follow the pump's history, and operators work with them over the API."""

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient
from sqlalchemy import delete, select

from service.alarms.ledger import catch_up
from service.demo.fleet import DemoRecord
from service.storage.tables import Alarm, AlarmAction, AuditEntry
from tests.service.guarded import guarded_client, key
from tests.service.histories import write_history
from tests.service.records import document

ALARMS = "/api/v1/alarms"


@pytest.fixture
def guarded(database_url: str, tmp_path: Path) -> Iterator[TestClient]:
    with guarded_client(database_url, tmp_path) as running:
        yield running


def write(client: TestClient, letters: str, **names: str) -> None:
    with client.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
        write_history(session, letters, **names)


def in_days(n: float) -> str:
    return (datetime.now(UTC) + timedelta(days=n)).isoformat()


class TestLifeOverTheApi:
    @pytest.fixture
    def ann(self, guarded: TestClient) -> dict[str, str]:
        return key(guarded, "analyst", "north", owner="ann")

    @pytest.fixture
    def alarm(self, guarded: TestClient, ann: dict[str, str]) -> str:
        write(guarded, "hhi")
        (item,) = guarded.get(ALARMS, headers=ann).json()["items"]
        return str(item["id"])

    def post(self, client: TestClient, who: dict[str, str], alarm: str, what: str, body: Any = None) -> Any:
        return client.post(f"{ALARMS}/{alarm}/{what}", json=body, headers=who)

    def test_what_an_alarm_says(self, guarded: TestClient, ann: dict[str, str], alarm: str) -> None:
        found = guarded.get(f"{ALARMS}/{alarm}", headers=ann).json()
        assert found["state"] == "active_unacknowledged"
        assert found["condition"] == "active"
        assert (found["pump_serial"], found["operator"]) == ("P-1", "north")
        assert (found["verdict_state"], found["priority"], found["side"]) == ("indeterminate", "medium", "unknown")
        assert found["onset_at"] == found["raised_at"] == "2026-05-03T08:00:00Z"
        assert [e["event"] for e in found["history"]] == ["raised"]

    def test_from_raised_to_normal(self, guarded: TestClient, ann: dict[str, str], alarm: str) -> None:
        answer = self.post(guarded, ann, alarm, "acknowledge", {"reason": "seen"})
        assert answer.status_code == 200
        assert answer.json()["state"] == "active_acknowledged"
        assert answer.json()["history"][-1]["by"] == "ann"
        assert self.post(guarded, ann, alarm, "acknowledge").status_code == 409
        write(guarded, "hhihh")
        assert guarded.get(f"{ALARMS}/{alarm}", headers=ann).json()["state"] == "cleared_acknowledged"
        assert guarded.get(ALARMS, params={"state": "open"}, headers=ann).json()["items"] == []

    def test_cleared_before_anybody_looked(self, guarded: TestClient, ann: dict[str, str], alarm: str) -> None:
        write(guarded, "hhihh")
        assert guarded.get(f"{ALARMS}/{alarm}", headers=ann).json()["state"] == "cleared_unacknowledged"
        assert self.post(guarded, ann, alarm, "shelve", {"reason": "x", "until": in_days(1)}).status_code == 409
        assert self.post(guarded, ann, alarm, "acknowledge").json()["state"] == "cleared_acknowledged"

    def test_an_escalation_opens_it_again(self, guarded: TestClient, ann: dict[str, str], alarm: str) -> None:
        self.post(guarded, ann, alarm, "acknowledge")
        write(guarded, "hhip")
        found = guarded.get(f"{ALARMS}/{alarm}", headers=ann).json()
        assert (found["state"], found["priority"]) == ("active_unacknowledged", "high")
        assert self.post(guarded, ann, alarm, "close", {"reason": "pump replaced"}).json()["state"] == "closed"
        for what, body in (("acknowledge", None), ("unshelve", None), ("close", {"reason": "again"})):
            assert self.post(guarded, ann, alarm, what, body).status_code == 409

    def test_a_shelf_has_a_reason_and_an_end(self, guarded: TestClient, ann: dict[str, str], alarm: str) -> None:
        bad = self.post(guarded, ann, alarm, "shelve", {"reason": " ", "until": "2020-01-01T00:00:00Z"})
        assert bad.status_code == 422
        assert {e["where"] for e in bad.json()["errors"]} == {"body.reason", "body.until"}
        far = self.post(guarded, ann, alarm, "shelve", {"reason": "x", "until": in_days(8)})
        assert "alarm_shelving_maximum_h" in far.json()["errors"][0]["problem"]
        naive = self.post(guarded, ann, alarm, "shelve", {"reason": "x", "until": "2126-01-01T00:00:00"})
        assert "time zone" in naive.json()["errors"][0]["problem"]
        good = self.post(guarded, ann, alarm, "shelve", {"reason": "spare on Friday", "until": in_days(6)})
        assert good.status_code == 200
        assert good.json()["shelved"] is True
        assert len(guarded.get(ALARMS, params={"state": "shelved"}, headers=ann).json()["items"]) == 1
        assert self.post(guarded, ann, alarm, "unshelve").json()["shelved"] is False
        assert self.post(guarded, ann, alarm, "unshelve").status_code == 409

    def test_the_longest_shelf_is_a_threshold(self, guarded: TestClient, ann: dict[str, str], alarm: str) -> None:
        engineer = key(guarded, "engineer", "north")
        body = {"values": {"alarm_shelving_maximum_h": 2}, "reason": "house rule"}
        put = guarded.put("/api/v1/thresholds/operator/north", json=body, headers={**engineer, "If-Match": "*"})
        assert put.status_code == 200
        assert self.post(guarded, ann, alarm, "shelve", {"reason": "x", "until": in_days(1)}).status_code == 422

    @pytest.mark.parametrize("what", ["acknowledge", "shelve", "unshelve", "close"])
    def test_who_may(self, guarded: TestClient, ann: dict[str, str], alarm: str, what: str) -> None:
        body = {"shelve": {"reason": "x", "until": in_days(1)}, "close": {"reason": "x"}}.get(what)
        assert self.post(guarded, {}, alarm, what, body).status_code == 401
        assert self.post(guarded, key(guarded, "viewer", "north"), alarm, what, body).status_code == 403
        assert self.post(guarded, key(guarded, "admin", "south"), alarm, what, body).status_code == 404
        assert self.post(guarded, ann, "nothing", what, body).status_code == 404
        extra = self.post(guarded, ann, alarm, what, {**(body or {}), "mood": 1})
        assert extra.status_code == 422
        assert "body.mood" in {e["where"] for e in extra.json()["errors"]}
        assert guarded.get(f"{ALARMS}/{alarm}", headers=ann).json()["state"] == "active_unacknowledged"

    def test_every_action_is_in_the_audit_log(self, guarded: TestClient, ann: dict[str, str], alarm: str) -> None:
        self.post(guarded, ann, alarm, "acknowledge", {"reason": "seen"})
        self.post(guarded, ann, alarm, "close", {"reason": "done"})
        with guarded.app.state.context.database.reading() as session:  # type: ignore[attr-defined]
            entries = session.scalars(select(AuditEntry).order_by(AuditEntry.id)).all()
        assert [(e.actor, e.action, e.subject, e.operator) for e in entries] == [
            ("ann", "alarm.acknowledge", f"alarm/{alarm}", "north"),
            ("ann", "alarm.close", f"alarm/{alarm}", "north"),
        ]

    def test_lists_are_filtered_and_paged(self, guarded: TestClient, ann: dict[str, str]) -> None:
        for i in range(5):
            write(guarded, "hi" + "i" * i, serial=f"P-{i}")
        write(guarded, "hi", serial="P-0", operator="south")
        seen: list[str] = []
        cursor = None
        while True:
            params = {"limit": 2, **({"cursor": cursor} if cursor else {})}
            page = guarded.get(ALARMS, params=params, headers=ann).json()
            seen += [item["id"] for item in page["items"]]
            cursor = page["next"]
            if cursor is None:
                break
        assert len(seen) == len(set(seen)) == 5
        assert len(guarded.get(ALARMS, params={"pump": "P-3"}, headers=ann).json()["items"]) == 1
        everybody = key(guarded, "viewer")
        assert len(guarded.get(ALARMS, headers=everybody).json()["items"]) == 6
        assert len(guarded.get(ALARMS, params={"operator": "south"}, headers=everybody).json()["items"]) == 1
        assert guarded.get(ALARMS, params={"state": "angry"}, headers=ann).status_code == 422
        first = guarded.get(ALARMS, params={"limit": 1}, headers=ann).json()["next"]
        stale = guarded.get(ALARMS, params={"limit": 1, "cursor": first, "pump": "P-1"}, headers=ann)
        assert stale.status_code == 422


class TestHistoryThatChanges:
    @pytest.fixture
    def ann(self, guarded: TestClient) -> dict[str, str]:
        return key(guarded, "analyst", "north", owner="ann")

    def alarms(self, client: TestClient, who: dict[str, str], **params: str) -> list[dict[str, Any]]:
        items: list[dict[str, Any]] = client.get(ALARMS, params=params, headers=who).json()["items"]
        return items[::-1]

    def test_a_moved_onset_keeps_the_alarm_and_what_was_done(self, guarded: TestClient, ann: dict[str, str]) -> None:
        write(guarded, "h.ii")
        (before,) = self.alarms(guarded, ann)
        guarded.post(f"{ALARMS}/{before['id']}/acknowledge", headers=ann)
        for letters, onset in (("hiii", "2026-05-02"), ("hhhi", "2026-05-04")):
            write(guarded, letters)
            (after,) = self.alarms(guarded, ann)
            assert after["id"] == before["id"]
            assert after["onset_at"].startswith(onset)
            assert after["acknowledged"] is True

    def test_an_alarm_without_support_is_withdrawn_and_may_come_back(
        self, guarded: TestClient, ann: dict[str, str]
    ) -> None:
        write(guarded, "hhi")
        (before,) = self.alarms(guarded, ann)
        guarded.post(f"{ALARMS}/{before['id']}/acknowledge", headers=ann)
        write(guarded, "hhh")
        (gone,) = self.alarms(guarded, ann)
        assert (gone["id"], gone["state"]) == (before["id"], "withdrawn")
        assert "no longer support" in gone["cause"]
        assert [e["event"] for e in gone["history"]] == ["raised", "acknowledged", "withdrawn"]
        assert guarded.post(f"{ALARMS}/{gone['id']}/acknowledge", headers=ann).status_code == 409
        write(guarded, "hhi")
        (back,) = self.alarms(guarded, ann)
        assert (back["id"], back["state"], back["cause"]) == (before["id"], "active_acknowledged", None)

    def test_split_and_merged(self, guarded: TestClient, ann: dict[str, str]) -> None:
        write(guarded, "iiiiii")
        (one,) = self.alarms(guarded, ann)
        guarded.post(f"{ALARMS}/{one['id']}/acknowledge", headers=ann)
        write(guarded, "ihhiii")
        first, second = self.alarms(guarded, ann)
        assert first["id"] == one["id"]
        assert (first["acknowledged"], second["acknowledged"]) == (True, False)
        guarded.post(f"{ALARMS}/{second['id']}/close", json={"reason": "known"}, headers=ann)
        write(guarded, "iiiiii")
        (merged,) = self.alarms(guarded, ann, state="closed")
        (gone,) = self.alarms(guarded, ann, state="withdrawn")
        assert (merged["id"], gone["id"]) == (first["id"], second["id"])
        assert first["id"] in gone["cause"]
        assert [e["event"] for e in merged["history"]] == ["raised", "acknowledged", "closed"]

    def test_actions_are_never_lost(self, guarded: TestClient, ann: dict[str, str]) -> None:
        write(guarded, "hhi")
        (alarm,) = self.alarms(guarded, ann)
        guarded.post(f"{ALARMS}/{alarm['id']}/close", json={"reason": "x"}, headers=ann)
        write(guarded, "hhh")
        with guarded.app.state.context.database.reading() as session:  # type: ignore[attr-defined]
            assert [a.kind for a in session.scalars(select(AlarmAction))] == ["close"]


def test_histories_older_than_alarms_catch_up(database_url: str, tmp_path: Path) -> None:
    with guarded_client(database_url, tmp_path) as client:
        write(client, "hhi")
        write(client, "hhh", serial="P-2")
        context = client.app.state.context  # type: ignore[attr-defined]
        with context.database.writing() as session:
            session.execute(delete(Alarm))
        assert catch_up(context.database) == 1
        assert catch_up(context.database) == 0
        items = client.get(ALARMS, headers=key(client, "viewer")).json()["items"]
    assert [a["pump_serial"] for a in items] == ["P-1"]


@pytest.mark.postgres_in_study
def test_a_worn_pump_raises_one_alarm_whatever_the_order(client: TestClient, worn_records: list[DemoRecord]) -> None:
    for record in [*worn_records[1::2], *worn_records[::2]]:
        client.post("/api/v1/records", content=record.content, headers={"content-type": "text/csv"})
    living = [a for a in client.get(ALARMS).json()["items"] if a["state"] != "withdrawn"]
    changes = client.get(f"/api/v1/pumps/{worn_records[0].pump.serial}/verdicts").json()["items"]
    first = next(c["at"] for c in changes if c["verdict"]["state"] not in ("healthy", "insufficient_data"))
    assert [a["onset_at"] for a in living] == [first]
    assert living[0]["verdict_state"] == changes[-1]["verdict"]["state"]
    client.post(f"{ALARMS}/{client.get(ALARMS).json()['items'][0]['id']}/acknowledge", json={"reason": "crew <told>"})
    page = client.get(f"/pumps/{worn_records[0].pump.serial}")
    assert page.status_code == 200
    assert "active, acknowledged" in page.text
    assert "acknowledged by local: crew &lt;told&gt;" in page.text


def test_a_blocked_drain_alarms_on_its_first_flight_and_ends_with_it(client: TestClient) -> None:
    """Uploads alone: the case doubles on one flight, the discharge pressure with it; no cause can be named so soon."""
    rng = np.random.default_rng(11)
    running = np.arange(160) >= 40
    late = {"values": {"alarm_on_delay_flights": 5}, "reason": "patience"}
    client.put("/api/v1/thresholds/fleet/default", json=late, headers={"If-Match": "*"})

    def fly(n: int, over_reservoir: float, discharge: float = 174.0) -> dict[str, Any]:
        case = np.where(running, 0.5 + over_reservoir, 0.5) + rng.normal(0.0, 0.003, 160)
        high = np.where(running, discharge, 5.0) + rng.normal(0.0, 0.1, 160)
        flown = document(case_pressure_bar=list(case), discharge_pressure_bar=list(high))
        flown |= {"flight_id": f"F{n}", "started_at": f"2026-05-{n:02d}T07:11:00Z"}
        answer = client.post("/api/v1/records", json=flown)
        assert answer.status_code == 201, answer.text
        found: dict[str, Any] = answer.json()["verdict"]
        return found

    for n in range(1, 13):
        assert fly(n, 0.4)["case_pressure"]["beyond"] is False
    assert client.get(ALARMS).json()["items"] == []
    rule = fly(13, 1.1, 174.7)["case_pressure"]
    assert rule["beyond"] is True
    assert rule["over_reservoir_bar"] == pytest.approx(1.1, abs=0.05)
    (alarm,) = client.get(ALARMS).json()["items"]
    assert (alarm["priority"], alarm["case_pressure_beyond"], alarm["beyond_limit"]) == ("critical", True, False)
    assert alarm["onset_at"] == alarm["raised_at"] == "2026-05-13T07:11:00Z"
    assert alarm["side"] != "pump"
    assert client.get("/api/v1/pumps/P-1").json()["case_pressure_beyond"] is True
    assert [p["serial"] for p in client.get("/api/v1/fleet/summary").json()["attention"]] == ["P-1"]
    assert "case pressure beyond its rule, whatever the cause" in client.get("/pumps/P-1").text
    for n in (14, 15):
        fly(n, 0.4)
    assert client.get("/api/v1/pumps/P-1").json()["case_pressure_beyond"] is False
    (alarm,) = client.get(ALARMS).json()["items"]
    # what is left is the verdict's own word on what came and went
    assert alarm["condition"] == "cleared" or (alarm["priority"] != "critical" and not alarm["case_pressure_beyond"])
