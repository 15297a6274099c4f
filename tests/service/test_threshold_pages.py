"""The page of thresholds: origin, preview, a change over a version that somebody else has replaced, restore."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from tests.service.guarded import guarded_client, key
from tests.service.histories import write_history
from tests.service.records import body
from tests.service.test_page_forms import come_in

API = "/api/v1"
LAYER = {"scope": "operator", "id": "north"}


@pytest.fixture
def guarded(database_url: str, tmp_path: Path) -> Iterator[TestClient]:
    with guarded_client(database_url, tmp_path) as running:
        with running.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
            write_history(session, "hhh")
        yield running


def test_a_layer_is_changed_looked_at_and_restored(guarded: TestClient) -> None:
    token = come_in(guarded, "eve", "engineer", "north")
    headers = key(guarded, "viewer", "north")

    def post(path: str, **fields: str) -> tuple[int, str]:
        answer = guarded.post(path, data={"csrf_token": token, **LAYER, **fields}, follow_redirects=False)
        return answer.status_code, answer.headers.get("location", answer.text)

    def own() -> tuple[int, dict[str, float]]:
        found = guarded.get(f"{API}/thresholds/operator/north", headers=headers).json()
        return found["version"], found["own"]

    link = "/thresholds?scope=operator&id=north"
    status, page = post("/thresholds", version="0", **{"value.alarm_records": "99", "value.nonsense": "1"})
    assert status == 422
    assert set(re.findall(r"<li><strong>([^<]+)</strong>", page)) == {
        "values.alarm_records", "values.nonsense", "reason",
    }  # fmt: skip
    assert 'name="value.alarm_records" value="99"' in page
    assert own() == (0, {})
    assert post("/thresholds", version="0", reason="noise", **{"value.alarm_records": "five"})[0] == 422
    assert post("/thresholds", version="0", reason="noise", **{"value.alarm_records": "5"}) == (303, link)
    assert own()[1] == {"alarm_records": 5.0}
    first = own()[0]
    page = guarded.get(link).text
    assert "operator/north" in page
    assert f'name="version" value="{first}"' in page
    # the form was made from version 0: somebody else was quicker
    status, page = post("/thresholds", version="0", reason="late", **{"value.alarm_records": "7"})
    assert status == 412
    assert 'href="/thresholds?scope=operator&amp;id=north"' in page
    fields = {"value.alarm_records": "0.99995e1", "value.side_records": "7"}
    assert post("/thresholds", version=str(first), reason="more", **fields) == (303, link)
    second, values = own()
    assert values == {"alarm_records": 9.9995, "side_records": 7.0}
    page = guarded.get(link).text
    assert "alarm_records from 5 to 9.9995; side_records set to 7" in page
    assert 'name="value.alarm_records" value="9.9995"' in page
    assert post("/thresholds/restore", version=str(first), number=str(first))[0] == 412
    assert post("/thresholds/restore", version=str(second), number="first")[0] == 422
    assert post("/thresholds/restore", version=str(second), number=str(first), reason="calmer") == (303, link)
    assert own()[1] == {"alarm_records": 5.0}
    assert guarded.post("/thresholds", data={**LAYER, "version": "0"}).status_code == 403
    assert post("/thresholds", version="0", reason="all", scope="fleet", id="default")[0] == 403


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_a_preview_says_what_the_api_says_and_changes_nothing(client: TestClient) -> None:
    record = client.post(f"{API}/records", content=body(), headers={"content-type": "application/json"})
    assert record.status_code == 201
    layer, origin = {"scope": "pump", "id": "P-1"}, {"origin": "http://localhost"}
    form = {**layer, "version": "0", "value.alarm_on_delay_flights": "4"}
    assert client.post("/thresholds/preview", data=form).status_code == 403
    shown = client.post("/thresholds/preview", data=form, headers=origin)
    assert shown.status_code == 200
    found = client.post(f"{API}/thresholds/preview", json={**layer, "values": {"alarm_on_delay_flights": 4}}).json()
    words = f"{found['totals']['alarms_with_candidate']} alarms</strong> instead of {found['totals']['alarms_now']}"
    assert words in shown.text
    assert "On 1 stored records of 1 pumps" in shown.text
    assert "Nothing is changed yet" in shown.text
    assert 'name="value.alarm_on_delay_flights" value="4"' in shown.text
    assert client.get(f"{API}/thresholds/pump/P-1").json()["version"] == 0
    wrong = client.post("/thresholds/preview", data={**form, "value.alarm_on_delay_flights": "400"}, headers=origin)
    assert wrong.status_code == 422
    assert "values.alarm_on_delay_flights" in wrong.text


def test_layers_of_others_are_not_there(guarded: TestClient) -> None:
    come_in(guarded, "sue", "engineer", "south")
    for query in ("scope=operator&id=north", "scope=pump&id=P-1", "scope=moon&id=1"):
        assert guarded.get(f"/thresholds?{query}").status_code == 404
    page = guarded.get("/thresholds").text
    assert "north" not in page
    assert "Publish" not in page
