"""Installations, maintenance, findings, withdrawals: what they change, and what was known before they did."""

import random
import re
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from typing import Any, get_args

import numpy as np
import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select

from detectors.words.observation import ACTIONS, Maintenance
from service.demo.fleet import DemoRecord
from service.history.knowledge import knowledge
from service.registry.maintenance import Action
from service.reports.words import ACTION_WORDS
from service.storage.tables import Pump
from tests.service.records import body, document

JSON = {"content-type": "application/json"}
API = "/api/v1"
PUMP = f"{API}/pumps/P-1"


def day(n: int) -> str:
    return (datetime(2026, 5, 2, 7, 11, tzinfo=UTC) + timedelta(days=n)).isoformat()


def upload(client: TestClient, n: int = 0, content: bytes | None = None, **params: str) -> dict[str, Any]:
    given = {"flight_id": f"F{n}", "started_at": day(n), **params}
    answer = client.post(f"{API}/records", content=content or body(), headers=JSON, params=given)
    assert answer.status_code == 201, answer.text
    found: dict[str, Any] = answer.json()
    return found


def faults_of(answer: Any) -> set[str]:
    return {fault["where"] for fault in answer.json()["errors"]}


class TestInstallations:
    def test_inferred_from_the_records_in_event_order(self, client: TestClient) -> None:
        upload(client, 0)
        upload(client, 5, position="RH")
        upload(client, 3)
        found = client.get(f"{PUMP}/installations").json()["items"]
        assert [(i["position"], i["source"]) for i in found] == [("LH", "records"), ("RH", "records")]
        assert found[0]["to"] == found[1]["from"] == datetime.fromisoformat(day(5)).strftime("%Y-%m-%dT%H:%M:%SZ")
        assert found[1]["to"] is None
        assert client.get(PUMP).json()["installation"]["position"] == "RH"

    def test_an_entry_wins_and_the_contradiction_is_a_flag(self, client: TestClient) -> None:
        upload(client, 1)
        made = client.post(f"{PUMP}/installations", json={"aircraft": "F-2", "position": "RH", "from": day(0)})
        assert made.status_code == 201, made.text
        pump = client.get(PUMP).json()
        assert (pump["aircraft"], pump["position"]) == ("F-2", "RH")
        flags = client.get(f"{PUMP}/verdict").json()["quality"]["flags"]
        assert any("F-1 LH" in flag and "F-2 RH" in flag for flag in flags)
        assert client.get(f"{API}/aircraft/F-2").status_code == 200
        assert [i["source"] for i in client.get(f"{PUMP}/installations").json()["items"]] == ["entry"]
        withdrawn = client.delete(f"{PUMP}/installations/{made.json()['id']}")
        assert withdrawn.status_code == 204
        assert client.get(PUMP).json()["aircraft"] == "F-1"
        assert client.get(f"{PUMP}/verdict").json()["quality"]["flags"] == []

    def test_each_gives_its_position_a_reference_of_its_own(
        self, healthy_client: TestClient, healthy_records: list[DemoRecord]
    ) -> None:
        client = healthy_client
        pump = f"{API}/pumps/{healthy_records[0].pump.serial}"
        seen = client.get(pump).json()
        assert seen["state"] == "healthy"
        place = {"aircraft": seen["aircraft"], "position": seen["position"]}
        late = healthy_records[-2].started_at.isoformat()
        made = client.post(f"{pump}/installations", json={**place, "from": late})
        verdict = client.get(f"{pump}/verdict").json()
        assert verdict["state"] == "healthy"  # what has worn travels with the pump
        new = [b["quantity"] for b in verdict["blind_spots"] if "7 more records" in b["because"]]
        assert new == []  # taken out and put back: it takes over what it knew of the place
        moved = client.patch(f"{pump}/installations/{made.json()['id']}", json={"from": "2020-01-01T00:00:00Z"})
        assert moved.status_code == 200, moved.text
        spots = client.get(f"{pump}/verdict").json()["blind_spots"]
        assert not any("new to the pump" in b["because"] for b in spots)

    def test_overlaps_are_refused_and_name_the_other(self, client: TestClient) -> None:
        upload(client, 0)
        upload(client, 0, pump_serial="P-2", position="RH")
        place = {"aircraft": "F-1", "position": "LH"}
        first = client.post(f"{PUMP}/installations", json={**place, "from": day(0), "to": day(10)}).json()
        for serial, other in (("P-1", {"aircraft": "F-9", "position": "LH"}), ("P-2", place)):
            url = f"{API}/pumps/{serial}/installations"
            clash = client.post(url, json={**other, "from": day(9)})
            assert clash.status_code == 409, clash.text
            assert clash.json()["installations"] == [first["id"]]
            assert "P-1" in clash.text
            assert client.post(url, json={**other, "from": day(10), "to": day(11)}).status_code == 201
        longer = client.patch(f"{PUMP}/installations/{first['id']}", json={"to": day(12)})
        assert longer.status_code == 409
        assert len(longer.json()["installations"]) == 2
        assert client.patch(f"{PUMP}/installations/{first['id']}", json={"to": day(-1)}).status_code == 422

    def test_bad_bodies_name_every_fault(self, client: TestClient) -> None:
        upload(client, 0)
        bad = {"aircraft": " ", "from": "2026-05-02T07:00:00", "to": "soon", "mood": 1}
        answer = client.post(f"{PUMP}/installations", json=bad)
        assert answer.status_code == 422
        assert faults_of(answer) == {"body.aircraft", "body.position", "body.from", "body.to", "body.mood"}
        assert client.post(f"{API}/pumps/P-9/installations", json=bad | {"mood": None}).status_code == 422
        good = {"aircraft": "F-1", "position": "LH", "from": day(0)}
        assert client.post(f"{API}/pumps/P-9/installations", json=good).status_code == 404
        assert client.patch(f"{PUMP}/installations/none", json={}).status_code == 404
        assert client.delete(f"{PUMP}/installations/none").status_code == 404

    def test_records_after_the_removal_are_flagged(self, client: TestClient) -> None:
        upload(client, 0)
        entry = {"aircraft": "F-1", "position": "LH", "from": day(0), "to": day(1)}
        client.post(f"{PUMP}/installations", json=entry)
        assert client.get(PUMP).json()["installation"] is None
        upload(client, 2)
        flags = client.get(f"{PUMP}/verdict").json()["quality"]["flags"]
        assert any("after the registered removal" in flag for flag in flags)
        assert client.get(PUMP).json()["installation"]["source"] == "records"


class TestMaintenance:
    def test_entered_corrected_withdrawn(self, client: TestClient) -> None:
        upload(client, 0)
        made = client.post(f"{PUMP}/maintenance", json={"at": day(1), "action": "filter_changed", "note": "yearly"})
        assert made.status_code == 201, made.text
        url = f"{PUMP}/maintenance/{made.json()['id']}"
        corrected = client.patch(url, json={"action": "fluid_changed"})
        assert corrected.json()["action"] == "fluid_changed"
        assert corrected.json()["note"] == "yearly"
        assert [m["id"] for m in client.get(f"{PUMP}/maintenance").json()["items"]] == [made.json()["id"]]
        assert client.delete(url).status_code == 204
        assert client.get(f"{PUMP}/maintenance").json()["items"] == []
        assert client.delete(url).status_code == 404
        bad = client.post(f"{PUMP}/maintenance", json={"at": "2026-05-02", "action": "prayer", "mood": 1})
        assert faults_of(bad) == {"body.at", "body.action", "body.mood"}

    def test_it_names_the_fluid_and_the_sensor(self, client: TestClient) -> None:
        upload(client, 0)
        url = f"{PUMP}/maintenance"
        fluid, sensor = {"fluid": "MIL-PRF-83282"}, {"channel": "reservoir_pressure_bar"}
        told = [
            {"action": "filter_changed"},
            {"action": "drain_cleaned"},
            {"action": "fluid_changed"},
            {"action": "fluid_changed", **fluid},
            {"action": "setting_adjusted"},
            {"action": "sensor_replaced"},
            {"action": "sensor_replaced", **sensor},
            {"action": "pump_overhauled"},
        ]
        assert {entry["action"] for entry in told} == set(ACTIONS) == set(get_args(Action)) == set(ACTION_WORDS)
        ids = []
        for i, entry in enumerate(told):
            made = client.post(url, json={"at": day(i), **entry})
            assert made.status_code == 201, made.text
            ids.append(made.json()["id"])
        listed = client.get(url).json()["items"]
        assert [(e["action"], e["fluid"], e["channel"]) for e in listed] == [
            (e["action"], e.get("fluid"), e.get("channel")) for e in told
        ]
        # what no longer belongs goes, what is said stays
        corrected = client.patch(f"{url}/{ids[3]}", json={"note": "drum 4"}).json()
        assert (corrected["fluid"], corrected["note"]) == ("MIL-PRF-83282", "drum 4")
        other = client.patch(f"{url}/{ids[3]}", json={"action": "sensor_replaced", **sensor}).json()
        assert (other["fluid"], other["channel"]) == (None, "reservoir_pressure_bar")
        assert client.patch(f"{url}/{ids[6]}", json={"channel": None}).json()["channel"] is None
        stray = client.patch(f"{url}/{ids[0]}", json={**fluid, **sensor})
        assert faults_of(stray) == {"body.fluid", "body.channel"}
        assert client.get(url).json()["items"][0] == listed[0]

    @pytest.mark.parametrize(
        ("action", "details", "faults"),
        [
            ("fluid_changed", {"fluid": "olive oil"}, {"fluid": "known: .*MIL-PRF-83282"}),
            ("sensor_replaced", {"channel": "flight_control_activity"}, {"channel": "fluid_temperature_degc"}),
            ("filter_changed", {"fluid": "MIL-PRF-83282"}, {"fluid": "belongs to fluid_changed"}),
            (
                "pump_overhauled",
                {"fluid": "MIL-PRF-83282", "channel": "case_pressure_bar"},
                {"fluid": "belongs to fluid_changed", "channel": "belongs to sensor_replaced"},
            ),
            (
                "prayer",
                {"fluid": "olive oil", "channel": "mood"},
                {"action": "drain_cleaned", "fluid": "", "channel": ""},
            ),
        ],
    )
    def test_what_cannot_be_is_refused_by_name(
        self, client: TestClient, action: str, details: dict[str, str], faults: dict[str, str]
    ) -> None:
        upload(client, 0)
        answer = client.post(f"{PUMP}/maintenance", json={"at": day(1), "action": action, **details})
        assert answer.status_code == 422
        problems = {fault["where"]: fault["problem"] for fault in answer.json()["errors"]}
        assert problems.keys() == {f"body.{name}" for name in faults}
        for name, words in faults.items():
            assert re.search(words, problems[f"body.{name}"])

    def test_the_judge_is_told_what_was_said_and_when_it_was_known(self, client: TestClient) -> None:
        upload(client, 0)
        context = client.app.state.context  # type: ignore[attr-defined]

        def told(known_at: datetime | None = None) -> tuple[Maintenance, ...]:
            with context.database.reading() as session:
                pump = session.scalars(select(Pump).where(Pump.serial == "P-1")).one()
                return knowledge(session, pump, context.archive, known_at).known.maintenance

        at = datetime.fromisoformat(day(-1))
        entry = {"at": day(-1), "action": "sensor_replaced", "channel": "case_pressure_bar"}
        made = client.post(f"{PUMP}/maintenance", json=entry).json()
        known_at = datetime.now(UTC)
        fluid = {"at": day(-1), "action": "fluid_changed", "fluid": "MIL-PRF-83282"}
        client.post(f"{PUMP}/maintenance", json=fluid)
        client.patch(f"{PUMP}/maintenance/{made['id']}", json={"channel": None})
        assert told(known_at) == (Maintenance(at, "sensor_replaced", None, "case_pressure_bar"),)
        assert told() == (Maintenance(at, "fluid_changed", "MIL-PRF-83282"), Maintenance(at, "sensor_replaced"))

    def test_it_resets_what_it_touches_and_taking_it_back_undoes_that(
        self, healthy_client: TestClient, healthy_records: list[DemoRecord]
    ) -> None:
        client = healthy_client
        pump = f"{API}/pumps/{healthy_records[0].pump.serial}"
        before = client.get(f"{pump}/verdict").json()
        at = (healthy_records[-1].started_at - timedelta(minutes=1)).isoformat()
        made = client.post(f"{pump}/maintenance", json={"at": at, "action": "setting_adjusted"}).json()
        after = client.get(f"{pump}/verdict").json()

        def width(verdict: dict[str, Any]) -> float:
            setting = verdict["estimates"]["pressure_setting_change_bar"]
            return float(setting["high"] - setting["low"])

        assert width(after) > width(before)
        client.delete(f"{pump}/maintenance/{made['id']}")
        assert client.get(f"{pump}/verdict").json() == before


class TestFindings:
    def test_entered_corrected_withdrawn(self, client: TestClient) -> None:
        upload(client, 0)
        new = {
            "at": day(1),
            "found": "pump_degradation",
            "measured_case_flow_lpm": 1.8,
            "removed": True,
            "note": "worn",
        }
        made = client.post(f"{PUMP}/findings", json=new)
        assert made.status_code == 201, made.text
        url = f"{PUMP}/findings/{made.json()['id']}"
        corrected = client.patch(url, json={"found": "no_fault_found", "measured_case_flow_lpm": None}).json()
        assert corrected["found"] == "no_fault_found"
        assert corrected["measured_case_flow_lpm"] is None
        assert corrected["removed"] is True
        assert [f["id"] for f in client.get(f"{PUMP}/findings").json()["items"]] == [made.json()["id"]]
        assert client.delete(url).status_code == 204
        assert client.get(f"{PUMP}/findings").json()["items"] == []
        bad = client.post(f"{PUMP}/findings", json={"found": "healthy", "measured_case_flow_lpm": -1, "mood": 1})
        assert faults_of(bad) == {"body.at", "body.found", "body.measured_case_flow_lpm", "body.mood"}
        assert client.post(f"{API}/pumps/P-9/findings", json=new).status_code == 404

    def test_they_give_the_fleet_its_rates(self, client: TestClient) -> None:
        empty = client.get(f"{API}/fleet/summary").json()["findings"]
        assert empty["count"] == 0
        assert empty["missed"]["share"] is None
        upload(client, 0)
        for found in ("no_fault_found", "drain_restriction"):
            client.post(f"{PUMP}/findings", json={"at": day(1), "found": found})
        rates = client.get(f"{API}/fleet/summary").json()["findings"]
        # one flight is no alarm: the restriction was missed; Wilson's interval of 1 in 1 is 0.2065 to 1
        assert rates["false_alarms"]["of"] == 0
        assert (rates["missed"]["cases"], rates["missed"]["of"]) == (1, 1)
        assert rates["missed"]["low"] == pytest.approx(0.2065, abs=1e-4)
        assert rates["missed"]["high"] == pytest.approx(1.0)
        assert "What the workshop found" in client.get("/").text


def test_rates_by_hand() -> None:
    from service.reading.agreement import JudgedFinding, rates

    judged = [
        *[JudgedFinding("pump_degradation", "pump_degradation")] * 6,
        *[JudgedFinding("pump_degradation", "compensator_fault")] * 1,
        *[JudgedFinding("pump_degradation", "indeterminate")] * 1,
        *[JudgedFinding("pump_degradation", "healthy")] * 2,
        *[JudgedFinding("drain_restriction", "pump_degradation")] * 1,
        *[JudgedFinding("no_fault_found", "pump_degradation")] * 1,
        *[JudgedFinding("no_fault_found", "healthy")] * 3,
        JudgedFinding("sensor_fault", None),
    ]
    found = rates(judged)
    assert found["count"] == 16
    assert (found["false_alarms"]["cases"], found["false_alarms"]["of"]) == (1, 10)
    assert (found["missed"]["cases"], found["missed"]["of"]) == (3, 12)
    assert (found["side_right"]["cases"], found["side_right"]["of"]) == (7, 8)
    # Wilson's interval for 1 in 10, Newcombe 1998: 0.0179 to 0.4042
    assert found["false_alarms"]["low"] == pytest.approx(0.0179, abs=1e-4)
    assert found["false_alarms"]["high"] == pytest.approx(0.4042, abs=1e-4)


class TestWithdrawal:
    def test_the_record_no_longer_counts_and_its_bytes_stay(self, client: TestClient) -> None:
        upload(client, 0)
        before = client.get(f"{PUMP}/verdict").json()
        record_id = upload(client, 1)["record_id"]
        url = f"{API}/records/{record_id}"
        assert client.delete(url).status_code == 422
        assert client.delete(url, params={"reason": " "}).status_code == 422
        gone = client.delete(url, params={"reason": "wrong pump"})
        assert gone.status_code == 200, gone.text
        assert gone.json()["status"] == "withdrawn"
        assert gone.json()["withdrawal"]["reason"] == "wrong pump"
        assert client.get(f"{url}/raw").status_code == 200
        assert client.get(f"{PUMP}/verdict").json() == before
        assert client.delete(url, params={"reason": "again"}).json()["withdrawal"]["reason"] == "wrong pump"
        assert client.delete(f"{API}/records/none", params={"reason": "x"}).status_code == 404
        (revision,) = client.get(f"{PUMP}/verdicts/revisions").json()["items"]
        assert revision["new_state"] is None
        assert revision["cause"] == "record_withdrawn"
        assert revision["cause_id"] == record_id
        # another record may now stand for the flight
        upload(client, 1, body(document(case_pressure_bar=[0.6] * 160)))

    def test_a_superseded_one_cannot_be_withdrawn(self, client: TestClient) -> None:
        first = upload(client, 0)["record_id"]
        upload(client, 0, body(document(case_pressure_bar=[0.6] * 160)), supersedes=first)
        assert client.delete(f"{API}/records/{first}", params={"reason": "x"}).status_code == 409


class TestKnownAt:
    def test_what_was_known_comes_back_exactly(self, client: TestClient) -> None:
        moments: list[tuple[str, dict[str, Any]]] = []

        def note() -> None:
            moments.append((datetime.now(UTC).isoformat(), client.get(f"{PUMP}/verdict").json()))

        first = upload(client, 3)["record_id"]
        note()
        upload(client, 1)
        note()
        upload(client, 3, body(document(case_pressure_bar=[0.6] * 160)), supersedes=first)
        note()
        installation = {"aircraft": "F-2", "position": "RH", "from": day(2)}
        entry = client.post(f"{PUMP}/installations", json=installation).json()["id"]
        note()
        client.patch(f"{API}/aircraft/F-2", json={"circuit": "separate_drain"})
        note()
        client.post(f"{PUMP}/maintenance", json={"at": day(2), "action": "sensor_replaced"})
        note()
        thresholds = {"values": {"window_minimum_duration_s": 400}, "reason": "only long windows"}
        client.put(f"{API}/thresholds/fleet/default", json=thresholds, headers={"If-Match": "*"})
        note()
        client.patch(f"{PUMP}", json={"pump_type": "h225_thesis"})
        note()
        client.delete(f"{PUMP}/installations/{entry}")
        note()
        assert len({str(verdict) for _, verdict in moments}) >= 7
        for known_at, verdict in moments:
            assert client.get(f"{PUMP}/verdict", params={"known_at": known_at}).json() == verdict
        early = client.get(f"{PUMP}/verdict", params={"known_at": "2020-01-01T00:00:00Z"}).json()
        assert early["state"] == "insufficient_data"
        assert early["quality"]["records_used"] == 0
        both = client.get(f"{PUMP}/verdict", params={"known_at": moments[1][0], "at": day(2)}).json()
        assert both["quality"]["records_used"] == 1

    def test_instants_need_a_zone(self, client: TestClient) -> None:
        upload(client, 0)
        for name in ("at", "known_at"):
            answer = client.get(f"{PUMP}/verdict", params={name: "2026-05-02T07:00:00"})
            assert answer.status_code == 422
            assert faults_of(answer) == {f"query.{name}"}


def test_revisions_are_paged(client: TestClient) -> None:
    for n in (2, 1, 0):
        record_id = upload(client, n)["record_id"]
        client.delete(f"{API}/records/{record_id}", params={"reason": "a trial"})
    url = f"{PUMP}/verdicts/revisions"
    everything = client.get(url).json()["items"]
    assert [r["at"] for r in everything] == [day(n).replace("+00:00", "Z") for n in (0, 1, 2)]
    first = client.get(url, params={"limit": 2}).json()
    second = client.get(url, params={"limit": 2, "cursor": first["next"]}).json()
    assert first["items"] + second["items"] == everything
    assert second["next"] is None


def test_changes_that_meet_lose_nothing(client: TestClient) -> None:
    """Uploads, entries and corrections of one aircraft at once end as one after the other would."""
    serials = [f"P-{i}" for i in range(4)]

    def station(i: int) -> dict[str, str]:
        return {"pump_serial": serials[i], "position": f"N{i}"}

    for i in range(4):
        upload(client, 0, **station(i))

    def send(n: int) -> int:
        params = {**station(n % 4), "flight_id": f"G{n}", "started_at": day(1 + n // 4)}
        # flights of their own: the same samples twice would be one flight
        warm = list(50.0 + 0.01 * n + 0.001 * np.arange(160.0))
        content = body(document(fluid_temperature_degc=warm))
        return client.post(f"{API}/records", content=content, headers=JSON, params=params).status_code

    def install(i: int) -> int:
        entry = {"aircraft": "F-1", "position": f"N{i}", "from": day(0)}
        return client.post(f"{API}/pumps/{serials[i]}/installations", json=entry).status_code

    def repaint(i: int) -> int:
        circuit = ("shared_return", "separate_drain")[i % 2]
        return client.patch(f"{API}/aircraft/F-1", json={"circuit": circuit}).status_code

    tasks = [*((send, n) for n in range(12)), *((install, i) for i in range(4)), *((repaint, i) for i in range(6))]
    random.Random(3).shuffle(tasks)
    with ThreadPoolExecutor(8) as pool:
        statuses = list(pool.map(lambda task: task[0](task[1]), tasks))
    assert set(statuses) <= {200, 201}
    client.patch(f"{API}/aircraft/F-1", json={"circuit": "separate_drain"})
    together = [client.get(f"{API}/pumps/{serial}/verdict").json() for serial in serials]
    assert [v["quality"]["records_used"] for v in together] == [4] * 4
    # a change that says nothing new is no change; this one folds everything anew, one after the other
    client.patch(f"{API}/aircraft/F-1", json={"circuit": "shared_return"})
    client.patch(f"{API}/aircraft/F-1", json={"circuit": "separate_drain"})
    assert [client.get(f"{API}/pumps/{serial}/verdict").json() for serial in serials] == together
