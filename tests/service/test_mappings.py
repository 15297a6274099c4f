"""Channel mappings: an operator's own export becomes the record that it is."""

import json
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient
from sqlalchemy import func, select

from service.storage.tables import Pump, Record, Refusal, StoredMapping
from tests.service.finished_job import finished
from tests.service.records import METADATA, body, document

API = "/api/v1"
MAPPING: dict[str, Any] = {
    "name": "hums-export",
    "aircraft_type": "H225",
    "channels": [
        {"source": "Zeit", "channel": "time_s", "unit": "ms"},
        {"source": "P1", "channel": "discharge_pressure_bar", "unit": "psi"},
        {"source": "PC", "channel": "case_pressure_bar", "unit": "kPa", "pressure_reference": "absolute"},
        {"source": "N", "channel": "shaft_speed_rpm", "unit": "Hz"},
        {"source": "T", "channel": "fluid_temperature_degc", "unit": "degF"},
        {"source": "PR", "channel": "reservoir_pressure_bar", "scale": 0.1, "offset": 0.2},
    ],
    "metadata": {"Tail": "aircraft", "SN": "pump_serial", "Flug": "flight_id", "Beginn": "started_at"},
    "defaults": {"position": "LH", "ambient_pressure_bar": 1.0},
    "csv": {"delimiter": ";", "decimal": ",", "encoding": "cp1252"},
}


def export() -> bytes:
    """The record of ``document()`` as a foreign system writes it; factors from the units' definitions."""
    channels = {k: np.array(v) for k, v in document()["channels"].items()}
    foreign = {
        "Zeit": 1000.0 * channels["time_s"] + 5.0e6,
        "P1": channels["discharge_pressure_bar"] / 0.0689475729316836,
        "PC": 100.0 * (channels["case_pressure_bar"] + 1.0),
        "N": channels["shaft_speed_rpm"] / 60.0,
        "T": 1.8 * channels["fluid_temperature_degc"] + 32.0,
        "PR": (channels["reservoir_pressure_bar"] - 0.2) / 0.1,
        "Höhe": np.zeros(160),
    }
    named = {"Tail": "aircraft", "SN": "pump_serial", "Flug": "flight_id", "Beginn": "started_at"}
    lines = [f"# {k}: {METADATA[v]}" for k, v in named.items()] + [";".join(foreign)]
    lines += [";".join(f"{v:.9f}".replace(".", ",") for v in row) for row in zip(*foreign.values(), strict=True)]
    return "\n".join(lines).encode("cp1252")


def store(client: TestClient, **changes: Any) -> Any:
    return client.post(f"{API}/mappings", json={**MAPPING, **changes})


def upload(client: TestClient, content: bytes, **params: str) -> Any:
    return client.post(f"{API}/records", content=content, headers={"content-type": "text/csv"}, params=params)


def test_an_export_is_uploaded_as_it_is(client: TestClient) -> None:
    plain = client.post(
        f"{API}/records", content=body(), headers={"content-type": "application/json"}, params={"pump_serial": "P-0"}
    )
    assert store(client).status_code == 201
    answer = upload(client, export(), mapping="hums-export")
    assert answer.status_code == 201, answer.text
    assert answer.json()["pump_serial"] == "P-1"
    for name, residual in plain.json()["residuals"].items():
        assert answer.json()["residuals"][name]["measured"] == pytest.approx(residual["measured"], abs=1e-6)
    again = upload(client, export(), mapping="hums-export")
    assert again.status_code == 200
    assert again.json()["record_id"] == answer.json()["record_id"]
    assert upload(client, export()).status_code == 400


def test_a_new_version_leaves_records_what_they_are(client: TestClient) -> None:
    tag = store(client).headers["etag"]
    record_id = upload(client, export(), mapping="hums-export").json()["record_id"]
    before = client.get(f"{API}/pumps/P-1/verdict").json()
    changed = {k: v for k, v in MAPPING.items() if k != "name"} | {"defaults": {"position": "RH"}}
    url = f"{API}/mappings/hums-export"
    assert client.put(url, json=changed).status_code == 428
    assert client.put(url, json=changed, headers={"if-match": '"7"'}).status_code == 412
    assert client.put(url, json=changed, headers={"if-match": tag}).status_code == 200
    assert client.get(url).json()["version"] == 2
    assert client.get(f"{API}/mappings").json()["items"][0]["version"] == 2
    clash = upload(client, export(), mapping="hums-export", ambient_pressure_bar="1.0")
    assert clash.status_code == 409
    assert clash.json()["record_id"] == record_id
    assert client.get(f"{API}/pumps/P-1/verdict").json() == before
    # read again from its raw bytes, it is read as it was sent
    job = finished(client, client.post(f"{API}/jobs", json={"kind": "reprocess"}).json()["id"])
    assert [item["status"] for item in job["items"]] == ["unchanged"]
    assert client.get(f"{API}/pumps/P-1/verdict").json() == before


def test_a_bad_mapping_is_refused_with_every_fault(client: TestClient) -> None:
    bad = {
        "name": "x y",
        "channels": [
            {"source": "A", "channel": "case_pressure_bar", "unit": "degF"},
            {"source": "B", "channel": "no_such_channel"},
            {"source": "C", "channel": "time_s", "unit": "fortnits", "colour": "red"},
        ],
    }
    answer = client.post(f"{API}/mappings", json=bad)
    assert answer.status_code == 422
    places = {e["where"] for e in answer.json()["errors"]}
    assert {"body.name", "body.channels.0", "body.channels.1", "body.channels.2.colour"} <= places
    twice = {**MAPPING, "channels": [*MAPPING["channels"], {"source": "X", "channel": "time_s"}]}
    assert "two sources" in client.post(f"{API}/mappings", json=twice).text
    assert store(client).status_code == 201
    assert store(client).status_code == 409
    assert client.get(f"{API}/mappings/none").status_code == 404
    assert upload(client, export(), mapping="none").status_code == 404


def test_preview_shows_all_and_stores_nothing(client: TestClient) -> None:
    shown = client.post(
        f"{API}/mappings/preview",
        files={"file": ("a.csv", export(), "text/csv")},
        data={"mapping": json.dumps({k: v for k, v in MAPPING.items() if k != "name"})},
    )
    assert shown.status_code == 200, shown.text
    found = shown.json()
    assert {r["source"]: r["channel"] for r in found["recognised"]} == {
        r["source"]: r["channel"] for r in MAPPING["channels"]
    }
    assert found["unrecognised"] == ["Höhe"]
    assert found["faults"] == []
    assert found["missing"] == []
    assert len(found["rows"]) == 10
    assert found["rows"][1]["time_s"] == pytest.approx(1.0)
    assert found["rows"][0]["fluid_temperature_degc"] == pytest.approx(50.0, abs=0.5)
    store(client, channels=MAPPING["channels"][1:])
    params = {"mapping": "hums-export"}
    by_name = client.post(
        f"{API}/mappings/preview", content=export(), headers={"content-type": "text/csv"}, params=params
    )
    assert by_name.json()["missing"] == ["time_s"]
    assert {"where": "channels.time_s", "problem": "is missing"} in by_name.json()["faults"]
    with client.app.state.context.database.reading() as session:  # type: ignore[attr-defined]
        counts = [session.scalar(select(func.count()).select_from(t)) for t in (Record, Pump, Refusal)]
        assert counts == [0, 0, 0]
        assert session.scalar(select(func.count()).select_from(StoredMapping)) == 1


def test_mappings_of_other_operators_are_unseen(client: TestClient) -> None:
    for operator in ("north", "south"):
        assert client.post(f"{API}/mappings", json=MAPPING, params={"operator": operator}).status_code == 201
    assert client.get(f"{API}/mappings/hums-export").status_code == 404
    assert upload(client, export(), mapping="hums-export").status_code == 404
    assert upload(client, export(), mapping="hums-export", operator="north").status_code == 201
