"""Pump types added over the API: derived or whole, judged with, kept apart by operator, refused with every fault."""

from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from detectors.judgement.version import twin_version
from service.demo.fleet import DemoRecord
from tests.service.guarded import guarded_client, key
from twin.pumps import pump_type

API = "/api/v1"
CSV = {"content-type": "text/csv"}


def wide(name: str, gap_um: float = 10.5) -> dict[str, Any]:
    """A variant whose slippers leak more than the h225's."""
    quantity = {"value": gap_um, "unit": "um", "source": "bench run 12"}
    return {"id": name, "base": "h225", "changes": {"slipper.h": quantity}}


def case_flow(client: TestClient, name: str, **more: Any) -> float:
    point = {"speed_rpm": 4600, "fluid_temperature_degc": 50}
    answer = client.post(f"{API}/twin/operating-point", json={"pump_type": name, "conditions": [point]}, **more)
    assert answer.status_code == 200, answer.text
    return float(answer.json()["items"][0]["case_flow_lpm"])


def test_a_stored_type_is_what_its_pumps_are_judged_by(client: TestClient, healthy_records: list[DemoRecord]) -> None:
    made = client.post(f"{API}/pump-types", json=wide("h225-wide"))
    assert made.status_code == 201, made.text
    version = made.json()["twin_version"]
    assert version.startswith("h225-wide-")
    assert case_flow(client, "h225-wide") > case_flow(client, "h225") + 0.2
    client.post(f"{API}/pumps", json={"serial": healthy_records[0].pump.serial, "pump_type": "h225-wide"})
    residuals = []
    for record, named in zip(healthy_records[:2], ("h225-wide", ""), strict=True):
        sent = client.post(f"{API}/records", content=record.content, headers=CSV, params={"pump_type": named})
        assert sent.status_code == 201, sent.text
        assert sent.json()["verdict"]["twin_version"] == version
        residuals.append(sent.json()["residuals"]["case_pressure_bar"]["twin"])
    serial = healthy_records[0].pump.serial
    assert client.get(f"{API}/pumps/{serial}/damage-identification-curve").status_code == 200
    # another type: every record is compared with that one from now on
    assert client.patch(f"{API}/pumps/{serial}", json={"pump_type": "h225"}).status_code == 200
    again = client.get(f"{API}/records/{sent.json()['record_id']}").json()
    assert again["residuals"]["case_pressure_bar"]["twin"] < residuals[-1] - 0.05
    assert again["verdict"]["twin_version"] == twin_version(pump_type("h225"))


def test_what_one_type_answers_is_what_the_next_takes(client: TestClient) -> None:
    document = client.get(f"{API}/pump-types/h225").json()
    version = document.pop("twin_version")
    document |= {"id": "copy", "title": "the same pump under another name"}
    made = client.post(f"{API}/pump-types", json=document)
    assert made.status_code == 201, made.text
    assert made.json()["twin_version"].rpartition("-")[2] == version.rpartition("-")[2]
    toml = b'id = "toml"\nbase = "copy"\n[changes.piston.b]\nvalue = 0.006\nunit = "mm"\nsource = "x"\n'
    sent = client.post(f"{API}/pump-types", content=toml, headers={"content-type": "application/toml"})
    assert sent.status_code == 201, sent.text
    assert client.get(f"{API}/pump-types/toml").json()["quantities"]["piston.b"]["value"] == 0.006
    assert [t["id"] for t in client.get(f"{API}/pump-types").json()["items"]] == ["copy", "h225", "h225_thesis", "toml"]
    assert client.get(f"{API}/thresholds/pump-type/toml").status_code == 200


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_bad_types_are_refused_whole(client: TestClient) -> None:
    assert client.post(f"{API}/pump-types", json=wide("h225")).status_code == 409
    gone = wide("gone", gap_um=-1.0)
    gone["changes"]["piston.l_mean"] = {"value": 2.0, "unit": "mm", "source": "x"}
    impossible = client.post(f"{API}/pump-types", json=gone)
    assert impossible.status_code == 422
    faults = {fault["where"]: fault["problem"] for fault in impossible.json()["errors"]}
    assert set(faults) == {"body.slipper.h", "body.piston.l_mean"}
    assert "um" in faults["body.slipper.h"]
    assert "mm" in faults["body.piston.l_mean"]
    assert client.get(f"{API}/pump-types/gone").status_code == 404
    for content, kind, status in (
        (b"{", "application/json", 400),
        (b"[]", "application/json", 422),
        (b"id = ", "application/toml", 400),
        (b"x", "text/csv", 415),
        (b" " * (2**20 + 1), "application/json", 413),
        (
            b'{"id": "x", "base": "h225", "changes": {"slipper.h": {"value": 1e999, "unit": "um", "source": "x"}}}',
            "",
            422,
        ),
    ):
        assert client.post(f"{API}/pump-types", content=content, headers={"content-type": kind}).status_code == status


def test_a_type_of_one_operator_is_unknown_to_another(database_url: str, tmp_path: Path) -> None:
    with guarded_client(database_url, tmp_path) as client:
        north, south = (key(client, "engineer", operator) for operator in ("north", "south"))
        everybody = key(client, "engineer", None)
        assert client.post(f"{API}/pump-types", json=wide("own"), headers=north).status_code == 201
        assert client.get(f"{API}/pump-types/own", headers=north).status_code == 200
        assert client.get(f"{API}/pump-types/own", headers=south).status_code == 404
        point = {"pump_type": "own", "conditions": [{"speed_rpm": 4600, "fluid_temperature_degc": 50}]}
        assert client.post(f"{API}/twin/operating-point", json=point, headers=south).status_code == 422
        refused = client.post(f"{API}/pumps", json={"serial": "P-1", "pump_type": "own"}, headers=south)
        assert refused.status_code == 422
        assert client.post(f"{API}/pump-types", json=wide("own", 9.5), headers=south).status_code == 201
        assert case_flow(client, "own", headers=south) < case_flow(client, "own", headers=north)
        assert client.post(f"{API}/pump-types", json=wide("own"), headers=everybody).status_code == 409
        assert client.post(f"{API}/pump-types", json=wide("all"), headers=everybody).status_code == 201
        assert client.post(f"{API}/pump-types", json=wide("all"), headers=south).status_code == 409
        assert client.get(f"{API}/pump-types/all", headers=south).status_code == 200
