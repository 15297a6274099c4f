"""The inbox of alarms and the filters that it shares with the API."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from tests.service.guarded import guarded_client, key
from tests.service.histories import write_history
from tests.service.test_page_forms import come_in, in_hours

API = "/api/v1"


@pytest.fixture
def guarded(database_url: str, tmp_path: Path) -> Iterator[TestClient]:
    with guarded_client(database_url, tmp_path) as running:
        with running.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
            for serial, letters in (("P-1", "hhi"), ("P-2", "hhppp"), ("P-3", "hhsss"), ("P-4", "hhPhhhhh")):
                write_history(session, letters, serial=serial)
            write_history(session, "hhppp", serial="P-2", operator="south")
        yield running


def serials(page: str) -> list[str]:
    """Pumps in the rows of the inbox, in order."""
    return re.findall(r'<th scope="row"[^>]*><a href="[^"]*">([^<]+)</a>', page)


def test_the_inbox_is_narrowed_as_the_list_of_the_api_is(guarded: TestClient) -> None:
    headers = key(guarded, "viewer", "north")
    come_in(guarded, "vic", "viewer", "north")
    everything = guarded.get(f"{API}/alarms", headers=headers).json()["items"]
    assert {a["pump_serial"] for a in everything} == {"P-1", "P-2", "P-3", "P-4"}
    expected = {
        "priority=high": {"P-2", "P-3"},
        "priority=critical": {"P-4"},
        "side=system": {"P-3"},
        "verdict_state=indeterminate": {"P-1"},
        "state=active": {"P-1", "P-2", "P-3"},
        "state=cleared_unacknowledged": {"P-4"},
        "aircraft=F-1&side=pump": {"P-2", "P-4"},
        "aircraft=F-2": set(),
        "pump_type=h225&pump=P-2": {"P-2"},
        "pump_type=other": set(),
    }
    for query, wanted in expected.items():
        found = guarded.get(f"{API}/alarms?{query}", headers=headers).json()["items"]
        assert {a["pump_serial"] for a in found} == wanted, query
        assert (
            set(
                serials(
                    guarded.get(f"/alarms?every=true&{query}" if "state=a" not in query else f"/alarms?{query}").text
                )
            )
            == wanted
        )
    assert guarded.get(f"{API}/alarms?priority=urgent", headers=headers).status_code == 422
    page = guarded.get("/alarms?pump=&priority=&side=").text
    assert set(serials(page)) == {"P-1", "P-2", "P-3", "P-4"}
    assert "Acknowledge" not in page
    assert 'name="alarm"' not in page


def test_many_are_handled_at_once_and_what_fails_is_named(guarded: TestClient) -> None:
    headers = key(guarded, "viewer", "north")
    token = come_in(guarded, "ann", "analyst", "north")
    ids = {a["pump_serial"]: a["id"] for a in guarded.get(f"{API}/alarms", headers=headers).json()["items"]}
    (foreign,) = guarded.get(f"{API}/alarms", headers=key(guarded, "viewer", "south")).json()["items"]

    def post(chosen: list[str], **fields: str) -> tuple[int, str]:
        form = {"csrf_token": token, "back": "/alarms?state=open", "alarm": chosen, **fields}
        answer = guarded.post("/alarms", data=form, follow_redirects=False)
        return answer.status_code, answer.headers.get("location", answer.text)

    def state(serial: str) -> str:
        return str(guarded.get(f"{API}/alarms/{ids[serial]}", headers=headers).json()["state"])

    assert guarded.post("/alarms", data={"alarm": ids["P-1"], "action": "acknowledge"}).status_code == 403
    assert post([], action="acknowledge")[0] == 422
    assert post([ids["P-1"]], action="ignore")[0] == 422
    # the end of a shelf stands in the form whatever is done
    assert post([ids["P-1"], ids["P-2"]], action="acknowledge", until=in_hours(24)) == (303, "/alarms?state=open")
    assert (state("P-1"), state("P-2"), state("P-3")) == (
        "active_acknowledged", "active_acknowledged", "active_unacknowledged",
    )  # fmt: skip
    status, page = post([ids["P-2"], ids["P-3"], foreign["id"]], action="acknowledge")
    assert status == 409
    assert "1 of 3 alarms were handled" in page
    assert re.findall(r"<li><strong>([^<]+)</strong>", page) == ["P-2, 03 May 2026", foreign["id"]]
    assert 'href="/alarms?state=open"' in page
    assert state("P-3") == "active_acknowledged"
    assert post([ids["P-1"]], action="close")[0] == 409
    assert post([ids["P-1"], ids["P-4"]], action="close", reason="seen in the hangar")[0] == 303
    assert (state("P-1"), state("P-4")) == ("closed", "closed")
    assert post([ids["P-3"]], action="shelve", reason="spare on Friday", until=in_hours(24))[0] == 303
    assert serials(guarded.get("/alarms?state=shelved").text) == ["P-3"]
    one = guarded.post(
        f"/alarms/{ids['P-3']}/unshelve", data={"csrf_token": token, "back": "//evil.example"}, follow_redirects=False
    )
    assert (one.status_code, one.headers["location"]) == (303, "/")
    assert guarded.get(f"{API}/alarms/{foreign['id']}", headers=key(guarded, "viewer", "south")).json()[
        "acknowledged"
    ] is False  # fmt: skip
