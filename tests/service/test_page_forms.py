"""Forms of the pump page: who may send them, what they do, what is said when they are wrong."""

import re
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from service.demo.fleet import DemoRecord
from tests.service.guarded import guarded_client, key
from tests.service.histories import write_history
from tests.service.test_sign_in import PASSWORD, csrf, make, sign_in

API = "/api/v1"
FINDING = {"at": "2026-05-10T12:00", "found": "pump_degradation", "measured_case_flow_lpm": "1.7", "removed": "yes"}


@pytest.fixture
def guarded(database_url: str, tmp_path: Path) -> Iterator[TestClient]:
    with guarded_client(database_url, tmp_path) as running:
        with running.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
            write_history(session, "hhi")
        yield running


def in_hours(n: float) -> str:
    return f"{datetime.now(UTC) + timedelta(hours=n):%Y-%m-%dT%H:%M}"


def come_in(client: TestClient, name: str, role: str, operator: str) -> str:
    """Sign in as a new user; the token of the session's forms."""
    assert make(client, key(client, "admin"), name, role=role, operator=operator).status_code == 201
    assert sign_in(client, name=name, password=PASSWORD).status_code == 303
    return csrf(client.get("/").text)


def test_an_alarm_goes_through_its_life_without_script(guarded: TestClient) -> None:
    ann = key(guarded, "analyst", "north")
    (alarm,) = guarded.get(f"{API}/alarms", headers=ann).json()["items"]
    token = come_in(guarded, "ann", "analyst", "north")

    def post(action: str, **fields: str) -> tuple[int, str]:
        url = f"/alarms/{alarm['id']}/{action}"
        answer = guarded.post(url, data={"csrf_token": token, **fields}, follow_redirects=False)
        return answer.status_code, answer.headers.get("location", answer.text)

    def now() -> dict[str, object]:
        return dict(guarded.get(f"{API}/alarms/{alarm['id']}", headers=ann).json())

    assert guarded.post(f"/alarms/{alarm['id']}/acknowledge", data={"csrf_token": "guess"}).status_code == 403
    assert now()["state"] == "active_unacknowledged"
    assert post("acknowledge") == (303, "/pumps/P-1?operator=north#alarms")
    assert now()["state"] == "active_acknowledged"
    assert post("acknowledge")[0] == 409
    status, page = post("shelve", until=in_hours(400))
    assert status == 422
    assert "is empty" in page
    assert "more than 168 h away" in page
    assert "/pumps/P-1?operator=north#alarms" in page
    assert post("shelve", until="tomorrow", reason="spare on Friday")[0] == 422
    assert post("shelve", until=in_hours(24), reason="spare on Friday")[0] == 303
    assert now()["shelved"] is True
    assert post("unshelve")[0] == 303
    assert post("close")[0] == 422
    assert post("ignore")[0] == 422
    assert post("close", reason="worn slippers found")[0] == 303
    assert now()["state"] == "closed"
    history = guarded.get(f"{API}/audit", headers=key(guarded, "admin", "north")).json()["items"]
    assert [e["actor"] for e in history if e["action"].startswith("alarm.")] == ["ann"] * 4


def test_forms_are_for_who_may_use_them(guarded: TestClient) -> None:
    ann = key(guarded, "analyst", "north")
    (alarm,) = guarded.get(f"{API}/alarms", headers=ann).json()["items"]
    forms = {f"/alarms/{alarm['id']}/acknowledge": {}, "/pumps/P-1/findings?operator=north": FINDING}
    for name, role, operator, status in (("vic", "viewer", "north", 403), ("sue", "analyst", "south", 404)):
        token = come_in(guarded, name, role, operator)
        for url, fields in forms.items():
            assert guarded.post(url, data={"csrf_token": token, **fields}).status_code == status, (name, url)
    guarded.cookies.clear()
    for url, fields in forms.items():
        assert guarded.post(url, data=fields, follow_redirects=False).headers["location"] == "/sign-in"
    assert guarded.get(f"{API}/alarms/{alarm['id']}", headers=ann).json()["acknowledged"] is False
    assert guarded.get(f"{API}/pumps/P-1/findings", headers=ann).json()["items"] == []


def test_a_finding_is_entered_and_every_fault_is_named(guarded: TestClient) -> None:
    ann = key(guarded, "analyst", "north")
    token = come_in(guarded, "ann", "analyst", "north")
    url = "/pumps/P-1/findings?operator=north"
    wrong = {"csrf_token": token, "at": "", "found": "gremlins", "measured_case_flow_lpm": "-1"}
    page = guarded.post(url, data=wrong)
    assert page.status_code == 422
    assert re.findall(r"<li><strong>(\w+)</strong>", page.text) == ["at", "found", "measured_case_flow_lpm"]
    sent = guarded.post(url, data={"csrf_token": token, "note": "<b>", **FINDING}, follow_redirects=False)
    assert (sent.status_code, sent.headers["location"]) == (303, "/pumps/P-1?operator=north#findings")
    (finding,) = guarded.get(f"{API}/pumps/P-1/findings", headers=ann).json()["items"]
    assert finding["at"] == "2026-05-10T12:00:00Z"
    assert (finding["found"], finding["measured_case_flow_lpm"], finding["removed"]) == ("pump_degradation", 1.7, True)
    assert finding["author"] == "ann"


def test_maintenance_is_entered_by_engineers_and_every_fault_is_named(guarded: TestClient) -> None:
    url = "/pumps/P-1/maintenance?operator=north"
    entry = {"at": "2026-05-10T12:00", "action": "sensor_replaced", "fluid": "", "channel": "case_pressure_bar"}
    token = come_in(guarded, "ann", "analyst", "north")
    assert guarded.post(url, data={"csrf_token": token, **entry}).status_code == 403
    token = come_in(guarded, "eve", "engineer", "north")
    wrong = {"at": "", "action": "drain_cleaned", "fluid": "olive oil", "channel": "case_pressure_bar"}
    page = guarded.post(url, data={"csrf_token": token, **wrong})
    assert page.status_code == 422
    assert re.findall(r"<li><strong>(\w+)</strong>", page.text) == ["at", "fluid", "channel"]
    assert guarded.get(f"{API}/pumps/P-1/maintenance", headers=key(guarded, "viewer", "north")).json()["items"] == []


@pytest.mark.parametrize("worn_settings", ["sqlite"], indirect=True)
def test_the_page_has_the_forms_and_without_sessions_knows_them_by_their_origin(
    worn_client: TestClient, worn_records: list[DemoRecord]
) -> None:
    client = worn_client
    serial = worn_records[0].pump.serial
    page = client.get(f"/pumps/{serial}").text
    (action,) = re.findall(r'action="(/alarms/\w+/acknowledge)"', page)
    assert {f.rpartition("/")[2] for f in re.findall(r'action="(/alarms/\w+/\w+)"', page)} == {
        "acknowledge", "shelve", "close",
    }  # fmt: skip
    assert client.post(action, headers={"origin": "https://evil.example"}).status_code == 403
    assert client.post(action).status_code == 403
    done = client.post(action, headers={"origin": "http://localhost"})
    assert done.status_code == 200
    assert "active, acknowledged" in done.text
    entered = client.post(
        f"/pumps/{serial}/findings", data={**FINDING, "note": "<b>"}, headers={"origin": "http://localhost"}
    )
    assert "&lt;b&gt;" in entered.text
    done = client.post(
        f"/pumps/{serial}/maintenance",
        data={"at": "2026-05-10T12:00", "action": "sensor_replaced", "fluid": "", "channel": "case_pressure_bar"},
        headers={"origin": "http://localhost"},
    )
    assert "Sensor replaced: <code>case_pressure_bar</code>" in done.text
    (event,) = client.get(f"{API}/pumps/{serial}/maintenance").json()["items"]
    assert (event["at"], event["fluid"], event["channel"]) == ("2026-05-10T12:00:00Z", None, "case_pressure_bar")
    assert "false alarms" in client.get("/").text
