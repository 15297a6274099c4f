"""Who sees to an alarm, until when; comments; many at once; and how often alarms come for nothing."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from service.storage.tables import AlarmAction, Finding, MaintenanceEvent, Message, Webhook
from tests.service.guarded import guarded_client, key
from tests.service.histories import day, pump_of, write_history
from tests.service.test_alarms import in_days
from tests.service.test_page_forms import come_in

ALARMS = "/api/v1/alarms"
HISTORIES = {
    "P-1": "hhi",
    "P-2": "hhppp",
    "P-3": "hhsss",
    "P-4": "hhPhhhhh",
    "P-5": "hhpppphhhhhh",
    "P-6": "hhpppphhhhhh",
}


@pytest.fixture
def guarded(database_url: str, tmp_path: Path) -> Iterator[TestClient]:
    with guarded_client(database_url, tmp_path) as running:
        with running.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
            for serial, letters in HISTORIES.items():
                write_history(session, letters, serial=serial)
            write_history(session, "hhppp", serial="P-2", operator="south")
        yield running


@pytest.fixture
def ann(guarded: TestClient) -> dict[str, str]:
    return key(guarded, "analyst", "north", owner="ann")


def alarm_ids(client: TestClient, who: dict[str, str], **filters: Any) -> dict[str, str]:
    found = client.get(ALARMS, params=filters, headers=who)
    assert found.status_code == 200, found.text
    return {a["pump_serial"]: a["id"] for a in found.json()["items"]}


def faults(answer: Any) -> set[str]:
    assert answer.status_code == 422, answer.text
    return {e["where"] for e in answer.json()["errors"]}


def test_a_plan_is_made_changed_and_taken_back(guarded: TestClient, ann: dict[str, str]) -> None:
    alarm = alarm_ids(guarded, ann)["P-2"]

    def plan(**body: Any) -> Any:
        return guarded.patch(f"{ALARMS}/{alarm}", json=body, headers=ann)

    due = in_days(3)
    made = plan(assignee=" line 2 ", due_at=due, work_order="WO-4711").json()
    assert (made["assignee"], made["work_order"], made["overdue"]) == ("line 2", "WO-4711", False)
    assert made["due_at"][:16] == due[:16]
    assert (made["state"], made["acknowledged"]) == ("active_unacknowledged", False)
    moved = plan(assignee="line 3", reason="line 2 is full").json()
    assert (moved["assignee"], moved["work_order"], moved["due_at"]) == ("line 3", "WO-4711", made["due_at"])
    last = moved["history"][-1]
    assert (last["event"], last["by"], last["assignee"], last["reason"]) == (
        "planned",
        "ann",
        "line 3",
        "line 2 is full",
    )
    assert plan(assignee="line 3").status_code == 409
    documented = guarded.get("/openapi.json").json()["paths"]
    assert "409" in documented[f"{ALARMS}/{{alarm_id}}"]["patch"]["responses"]
    assert "409" in documented[f"{ALARMS}/{{alarm_id}}/comments"]["post"]["responses"]
    assert plan(work_order=None).json()["work_order"] is None
    assert faults(plan()) == {"body"}
    assert faults(plan(reason="only a word")) == {"body"}
    assert faults(plan(due_at="2020-01-01T00:00:00Z")) == {"body.due_at"}
    assert faults(plan(due_at="2999-01-01T00:00:00", assignee="", mood=1)) == {
        "body.due_at",
        "body.assignee",
        "body.mood",
    }
    assert guarded.get(f"{ALARMS}/{alarm}", headers=ann).json()["assignee"] == "line 3"
    assert set(alarm_ids(guarded, ann, assignee="line 3")) == {"P-2"}
    assert alarm_ids(guarded, ann, assignee="line 2") == {}
    with guarded.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
        # the day passes
        for row in session.query(AlarmAction).where(AlarmAction.kind == "plan"):
            row.due_at = day(1)
        write_history(session, HISTORIES["P-2"] + "p", serial="P-2")
    assert set(alarm_ids(guarded, ann, overdue=True)) == {"P-2"}
    assert "P-2" not in alarm_ids(guarded, ann, overdue=False)
    assert guarded.get(f"{ALARMS}/{alarm}", headers=ann).json()["overdue"] is True
    assert guarded.post(f"{ALARMS}/{alarm}/close", json={"reason": "replaced"}, headers=ann).json()["overdue"] is False
    assert alarm_ids(guarded, ann, overdue=True) == {}
    assert plan(work_order="WO-1").json()["state"] == "closed"


def test_comments_and_plans_follow_the_history_and_ask_nobody_anew(guarded: TestClient, ann: dict[str, str]) -> None:
    alarm = alarm_ids(guarded, ann)["P-1"]
    guarded.patch(f"{ALARMS}/{alarm}", json={"assignee": "bob"}, headers=ann)
    said = guarded.post(f"{ALARMS}/{alarm}/comments", json={"text": "oil sample sent"}, headers=ann).json()
    assert (said["comments"], said["acknowledged"]) == (1, False)
    assert faults(guarded.post(f"{ALARMS}/{alarm}/comments", json={"text": "  "}, headers=ann)) == {"body.text"}
    guarded.post(f"{ALARMS}/{alarm}/acknowledge", headers=ann)
    with guarded.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
        session.add(Webhook(id="w", operator=None, url="https://x.example", events=["alarm.changed"], secret="whsec_eA==",
                            owner="ann", created_at=day(0), ended_at=None, end_reason=None))  # fmt: skip
        write_history(session, "hhip", serial="P-1")
    found = guarded.get(f"{ALARMS}/{alarm}", headers=ann).json()
    assert (found["state"], found["assignee"], found["comments"]) == ("active_unacknowledged", "bob", 1)
    assert [e["event"] for e in found["history"]] == [
        "raised", "planned", "commented", "acknowledged", "escalated", "reopened"
    ]  # fmt: skip
    # a comment is no attention: what was acknowledged as less stays unacknowledged, and others are told of it
    guarded.post(f"{ALARMS}/{alarm}/comments", json={"text": "borescope ordered"}, headers=ann)
    assert guarded.get(f"{ALARMS}/{alarm}", headers=ann).json()["state"] == "active_unacknowledged"
    with guarded.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
        assert [m.event for m in session.query(Message)] == ["alarm.changed"]
        write_history(session, "hhhh", serial="P-1")
    for answer in (
        guarded.patch(f"{ALARMS}/{alarm}", json={"assignee": "eve"}, headers=ann),
        guarded.post(f"{ALARMS}/{alarm}/comments", json={"text": "gone?"}, headers=ann),
    ):
        assert (answer.status_code, answer.json()["state"]) == (409, "withdrawn")
    kept = guarded.get(f"{ALARMS}/{alarm}", headers=ann).json()
    assert (kept["assignee"], kept["comments"]) == ("bob", 2)


def test_an_instant_is_written_and_no_number(guarded: TestClient, ann: dict[str, str]) -> None:
    """The document says date and time; a number was taken for seconds since 1970."""
    (alarm, *_) = guarded.get(ALARMS, headers=ann).json()["items"]
    for given in (0, 4e9, True, "4000000000", "0.5", "-1e9"):
        for path, body, where in (
            (f"{ALARMS}/actions", {"alarms": ["x"], "action": "shelve", "until": given}, "body.until"),
            (f"{ALARMS}/{alarm['id']}/shelve", {"reason": "x", "until": given}, "body.until"),
        ):
            answer = guarded.post(path, json=body, headers=ann)
            assert (answer.status_code, [f["where"] for f in answer.json()["errors"]]) == (422, [where]), given
        assert guarded.patch(f"{ALARMS}/{alarm['id']}", json={"due_at": given}, headers=ann).status_code == 422
        answer = guarded.get("/api/v1/records", params={"to": str(given)}, headers=ann)
        assert (answer.status_code, answer.json()["errors"][0]["where"]) == (422, "query.to"), given


def test_the_same_for_many(guarded: TestClient, ann: dict[str, str]) -> None:
    ids = alarm_ids(guarded, ann)
    foreign = alarm_ids(guarded, key(guarded, "viewer", "south"))["P-2"]

    def many(*alarms: str, **body: Any) -> Any:
        return guarded.post(f"{ALARMS}/actions", json={"alarms": alarms, **body}, headers=ann)

    first = many(ids["P-1"], ids["P-2"], ids["P-1"], action="acknowledge", reason="seen").json()
    assert (first["done"], [i["alarm"]["acknowledged"] for i in first["items"]]) == (2, [True, True])
    mixed = many(ids["P-2"], foreign, ids["P-3"], action="acknowledge").json()
    assert [i["done"] for i in mixed["items"]] == [False, False, True]
    assert "acknowledged already" in mixed["items"][0]["problem"]
    assert mixed["items"][1] == {
        "id": foreign, "done": False, "alarm": None, "problem": f"there is no alarm {foreign}"
    }  # fmt: skip
    shelf = many(ids["P-2"], ids["P-4"], action="shelve", reason="spare on Friday", until=in_days(2)).json()
    assert [i["done"] for i in shelf["items"]] == [True, False]
    planned = many(ids["P-2"], ids["P-3"], action="plan", assignee="line 2").json()
    assert {i["alarm"]["assignee"] for i in planned["items"]} == {"line 2"}
    assert many(ids["P-2"], action="shelve").json()["items"][0]["problem"].count("body.") == 2
    assert many(action="acknowledge").status_code == 422
    assert many(*(str(i) for i in range(201)), action="acknowledge").status_code == 422
    assert many(ids["P-1"], action="ignore").status_code == 422
    viewer = key(guarded, "viewer", "north")
    refused = guarded.post(f"{ALARMS}/actions", json={"alarms": [ids["P-1"]], "action": "unshelve"}, headers=viewer)
    assert refused.status_code == 403


def test_statistics_are_those_of_a_hand_count(guarded: TestClient, ann: dict[str, str]) -> None:
    with guarded.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
        held = {"recorded_at": day(9), "withdrawn_at": None, "author": "ann"}
        seen_to = {"id": "m", "pump_id": pump_of(session, "P-5", "north").id, **held}
        session.add(MaintenanceEvent(at=day(4), action="filter_changed", note="", **seen_to))
        refuted = {"id": "f", "pump_id": pump_of(session, "P-2", "north").id, **held}
        session.add(Finding(at=day(4), found="no_fault_found", removed=False, note="", **refuted))
    ids = alarm_ids(guarded, ann)
    guarded.post(f"{ALARMS}/{ids['P-3']}/acknowledge", headers=ann)
    found = guarded.get(f"{ALARMS}/statistics", headers=ann).json()
    # P-4 and P-6 ended by themselves, P-2 was refuted; P-5 ended after its filter was changed
    whole = found["all"]
    assert (whole["raised"], whole["cleared"], whole["withdrawn"], found["pumps"]) == (6, 3, 0, 6)
    assert (whole["nuisance"]["cases"], whole["nuisance"]["of"]) == (3, 4)
    assert whole["nuisance"]["low"] < 0.75 < whole["nuisance"]["high"]
    by_pump = {p["pump_serial"]: p for p in found["by_pump"]}
    lasted = {
        a["pump_serial"]: a for a in guarded.get(ALARMS, headers=ann).json()["items"] if a["cleared_at"] is not None
    }
    assert set(lasted) == {"P-4", "P-5", "P-6"}
    for serial, alarm in lasted.items():
        days = int(alarm["cleared_at"][8:10]) - int(alarm["onset_at"][8:10])
        assert by_pump[serial]["median_days"] == by_pump[serial]["longest_days"] == days
    assert by_pump["P-3"]["median_hours_to_acknowledge"] is not None
    assert by_pump["P-2"]["median_hours_to_acknowledge"] is None
    kinds = {k["verdict_state"]: (k["raised"], k["nuisance"]["of"]) for k in found["by_kind"]}
    assert sum(n for n, _ in kinds.values()) == 6
    assert kinds["system_leakage"] == (1, 0)
    short = guarded.get(f"{ALARMS}/statistics", params={"limit": 2}, headers=ann).json()
    assert (len(short["by_pump"]), short["pumps"]) == (2, 6)
    none = guarded.get(f"{ALARMS}/statistics", params={"from": "2027-01-01T00:00:00Z"}, headers=ann).json()
    assert (none["all"]["raised"], none["by_pump"], none["all"]["nuisance"]["share"]) == (0, [], None)
    back = {"from": "2027-01-01T00:00:00Z", "to": "2026-01-01T00:00:00Z"}
    assert guarded.get(f"{ALARMS}/statistics", params=back, headers=ann).status_code == 422
    with guarded.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
        write_history(session, "hhhh", serial="P-1")
    after = guarded.get(f"{ALARMS}/statistics", headers=ann).json()["all"]
    assert (after["raised"], after["withdrawn"]) == (5, 1)


def test_the_pages_plan_comment_and_count(guarded: TestClient, ann: dict[str, str]) -> None:
    ids = alarm_ids(guarded, ann)
    token = come_in(guarded, "cat", "analyst", "north")

    def post(url: str, **fields: Any) -> tuple[int, str]:
        answer = guarded.post(url, data={"csrf_token": token, "back": "/alarms", **fields}, follow_redirects=False)
        return answer.status_code, answer.text

    both = [ids["P-2"], ids["P-3"]]
    assert post("/alarms", alarm=both, action="plan", assignee="line 2", due_at="2099-01-01T10:00")[0] == 303
    # an empty field of many says nothing, one of one alarm's plan takes back
    assert post("/alarms", alarm=both, action="plan", work_order="WO-1", due_at="")[0] == 303
    assert post(f"/alarms/{ids['P-3']}/plan", assignee="", due_at="2099-01-01T10:00", work_order="WO-1")[0] == 303
    plans = {
        serial: tuple(guarded.get(f"{ALARMS}/{ids[serial]}", headers=ann).json()[n] for n in ("assignee", "due_at", "work_order"))
        for serial in ("P-2", "P-3")
    }  # fmt: skip
    assert plans == {
        "P-2": ("line 2", "2099-01-01T10:00:00Z", "WO-1"), "P-3": (None, "2099-01-01T10:00:00Z", "WO-1")
    }  # fmt: skip
    status, text = post(f"/alarms/{ids['P-3']}/plan", due_at="2001-01-01T10:00")
    assert (status, "lies in the past" in text) == (422, True)
    assert post("/alarms", alarm=both, action="comment", reason="<b>asked</b>")[0] == 303
    page = guarded.get(f"/alarms/{ids['P-2']}").text
    assert "&lt;b&gt;asked" in page
    assert "WO-1" in guarded.get("/alarms?assignee=line 2").text
    counted = guarded.get("/alarms/statistics").text
    kinds = guarded.get(f"{ALARMS}/statistics", headers=ann).json()["by_kind"]
    assert counted.count('<th scope="row"') == 1 + len(kinds) + len(HISTORIES)
    assert guarded.get("/alarms/statistics?days=7").status_code == 422
    assert guarded.get("/alarms/nothing").status_code == 404
