"""Serial numbers as operators have them: reachable by every call and page, or refused at the door with the reason."""

import json
from collections.abc import Iterator
from typing import Any
from urllib.parse import quote

import pytest
from fastapi.testclient import TestClient
from structlog.testing import capture_logs

from service.client import Client
from service.client.testing import MemoryService
from service.ingest.metadata import checked_metadata
from service.ingest.names import clean_name, look_of, name_fault
from service.settings import Settings
from tests.service.lent_application import lent
from tests.service.matrix import API, MATRIX, filled
from tests.service.records import METADATA, body, document

NAMES = [
    "SN/4711/A",
    "a..b",
    "../x",
    "100%",
    "a%2Fb",
    "a\\b",
    "a?b#c&d=e+f",
    "two words",
    "ПН-7/№ 3",
    "水泵/٣",
    "/",
    "x" * 200,
]
JSON = {"content-type": "application/json"}


@pytest.fixture(scope="module")
def client(new_settings: Any) -> Iterator[TestClient]:
    settings: Settings = new_settings("sqlite")
    with lent(settings) as running:
        yield running


def asked() -> list[tuple[str, str]]:
    """Every reading route with a pump or an aircraft in its address, and changes that leave the pump what it is."""
    writes = {("PATCH", f"{API}/pumps/{{serial}}"), ("PATCH", f"{API}/aircraft/{{name}}")}
    writes |= {("POST", f"{API}/pumps/{{serial}}/{what}") for what in ("findings",)}
    named = ("{serial}", "/aircraft/{name}")
    routes = [key for key in MATRIX if any(n in key[1] for n in named) and (key[0] == "GET" or key in writes)]
    return [*routes, ("GET", f"{API}/thresholds/{{scope}}/{{scope_id}}/versions")]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.postgres_in_study
def test_every_address_leads_to_the_pump(client: TestClient, name: str) -> None:
    content = {**document(), "pump_serial": name, "aircraft": name, "position": name, "flight_id": name}
    stored = client.post(f"{API}/records", content=body(content), headers=JSON)
    assert stored.status_code == 201, stored.text
    coded = quote(name, "")
    put = {"values": {"case_flow_limit_lpm": 1.4}, "reason": "earlier"}
    assert client.put(f"{API}/thresholds/pump/{coded}", json=put, headers={"If-Match": "*"}).status_code == 200
    ids = {"pump": coded, "aircraft": coded, "operator": "default"}
    routes = asked()
    assert len(routes) > 15
    for method, path in routes:
        entry = MATRIX[method, path]
        answer = client.request(
            method, filled(entry.url, ids).replace("/LH/", f"/{coded}/"), json=entry.body, headers=entry.headers
        )
        assert answer.status_code in (200, 201), (method, path, answer.text[:300])
    assert client.get(f"{API}/pumps/{coded}").json()["serial"] == name
    assert client.get(f"{API}/aircraft/{coded}").json()["aircraft"] == name
    assert client.get(f"{API}/records", params={"pump": name}).json()["items"][0]["pump_serial"] == name
    fleet = client.get("/").text
    assert f'href="/pumps/{coded}?operator=default"' in fleet
    page = client.get(f"/pumps/{coded}").text
    assert f"{API}/pumps/{coded}/damage-identification-curve" in page
    assert f"/pumps/{coded}/findings" in page or "findings" not in page


def test_forms_come_back_to_the_pump(client: TestClient) -> None:
    content = {**document(), "pump_serial": "SN/form", "flight_id": "form"}
    assert client.post(f"{API}/records", content=body(content), headers=JSON).status_code == 201
    form = {"at": "2026-05-03T00:00", "found": "no_fault_found"}
    address = "/pumps/SN%2Fform/findings?operator=default"
    answer = client.post(address, data=form, headers={"origin": "http://localhost"}, follow_redirects=False)
    assert answer.status_code == 303, answer.text
    assert answer.headers["location"] == "/pumps/SN%2Fform?operator=default#findings"


def test_a_name_with_the_end_of_another_address_is_its_own(client: TestClient) -> None:
    with capture_logs() as logged:
        for serial in ("P-9", "P-9/verdict"):
            content = {**document(), "pump_serial": serial, "flight_id": "F9"}
            assert client.post(f"{API}/records", content=body(content), headers=JSON).status_code == 201
        assert client.get(f"{API}/pumps/P-9%2Fverdict").json()["serial"] == "P-9/verdict"
        assert "state" in client.get(f"{API}/pumps/P-9/verdict").json()
        assert client.get(f"{API}/pumps/P-9%2fverdict/verdict").status_code == 200
    paths = [line["path"] for line in logged if "path" in line]
    assert f"{API}/pumps/P-9/verdict" in paths
    assert all(path.isprintable() for path in paths), "no stand-in in the log"
    missing = client.get(f"{API}/pumps/no%2Fsuch")
    assert missing.status_code == 404
    assert missing.json()["detail"].startswith("there is no pump no/such")


@pytest.mark.parametrize("name", [".", "..", "\u200b", "a\tb", "a\nb", "\x7f", "a\u2028b", "y" * 201, " . "])
def test_what_cannot_be_addressed_is_refused_with_the_reason(name: str) -> None:
    for where in ("pump_serial", "aircraft", "position", "flight_id"):
        checked, faults = checked_metadata({**METADATA, where: name})
        assert checked is None
        assert [f.where for f in faults] == [where]


def test_the_door_of_the_registry_refuses_the_same(client: TestClient) -> None:
    for path, field in (("pumps", "serial"), ("aircraft", "aircraft")):
        for name in ("..", ".", "\u200d"):
            answer = client.post(f"{API}/{path}", json={field: name})
            assert answer.status_code == 422
            assert answer.json()["errors"][0]["where"] == f"body.{field}"


def test_what_means_nothing_is_taken_off() -> None:
    for written in ("SN 1", " SN  1 ", "SN\u00a01", "\ufeffSN\u20091\u200b", "S\u00adN 1"):
        assert clean_name(written) == "SN 1"
    assert clean_name("e\u0301") == "\u00e9"
    assert clean_name("می\u200cروم") == "می\u200cروم"
    for name in NAMES:
        assert clean_name(name) == name
        assert name_fault(name) is None


def test_names_that_are_easily_taken_for_one_another_look_alike() -> None:
    same = ("SN-1", "sn-1", "SN–1", "SN−1", "SN_1", "SN 1", "SN-01", "SN-I", "ЅN-1", "ＳＮ-1")
    assert {look_of(name) for name in same} == {look_of("SN-1")}
    other = ("SN-2", "SN-11", "SN-1A", "SN-10", "NS-1", "SN/1", "SN.1")
    assert len({look_of(name) for name in (*other, "SN-1")}) == len(other) + 1


def test_whole_numbers_are_their_digits_in_every_text() -> None:
    values = {**METADATA, "pump_serial": 4711.0, "aircraft": 12, "flight_id": 7.0, "segment": 2.0, "position": 1.0}
    checked, faults = checked_metadata(values)
    assert faults == []
    assert checked is not None
    said = (checked.pump_serial, checked.aircraft, checked.flight_id, checked.segment, checked.position)
    assert said == ("4711", "12", "7", "2", "1")
    for bad in (4711.5, float("nan"), float("inf"), 1e300, True, [1.0]):
        assert [f.where for f in checked_metadata({**METADATA, "pump_serial": bad})[1]] == ["pump_serial"]


def test_the_service_in_memory_knows_such_names_too() -> None:
    memory = MemoryService()
    with Client("http://memory", transport=memory.transport) as service:
        content = {**document(), "pump_serial": "SN/1/verdict"}
        service.upload(json.dumps(content).encode(), "application/json")
        assert service.pump("SN/1/verdict")["serial"] == "SN/1/verdict"
        assert service.verdict("SN/1/verdict")["state"]
