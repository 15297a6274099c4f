"""Circuits as documents: stored, named in calls of the twin and on aircraft, refused with every fault, kept apart."""

import json
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from typer.testing import CliRunner

from service.command_line.main import app
from service.demo.fleet import DemoRecord
from service.studies.simulation.consumers import leaking
from tests.service.guarded import guarded_client, key
from twin.condition import Condition
from twin.pumps import pump_type
from twin.pumps.circuit_sets import CIRCUIT_SETS, Accumulator, CircuitSet, circuit_document, circuit_set_from
from twin.simulation.scenario import Scenario, Schedule

API = "/api/v1"
DRAIN = {"value": 0.6, "unit": "bar/(L/min)", "source": "hose bench", "uncertainty": 0.05}
IRONBIRD: dict[str, Any] = {
    "id": "ironbird",
    "drain": "separate",
    "changes": {"k_c": DRAIN, "k_c_slope": {"value": 0.0, "unit": "1/K", "source": "one temperature"}},
    "consumers": [{"name": "selector", "flow_lpm": 0.3}, {"name": "brake valve", "flow_lpm": 0.2}],
}


def point(client: TestClient, circuit: str, **more: Any) -> dict[str, Any]:
    condition = {"speed_rpm": 4600, "fluid_temperature_degc": 50, "circuit": circuit, **more}
    answer = client.post(f"{API}/twin/operating-point", json={"conditions": [condition]})
    assert answer.status_code == 200, answer.text
    item: dict[str, Any] = answer.json()["items"][0]
    return item


def test_a_stored_circuit_is_what_the_twin_runs_in(client: TestClient) -> None:
    made = client.post(f"{API}/circuits", json=IRONBIRD)
    assert made.status_code == 201, made.text
    assert made.headers["Location"] == f"{API}/circuits/ironbird"
    assert client.get(f"{API}/circuits/ironbird").json() == made.json()
    assert {c["id"] for c in client.get(f"{API}/circuits").json()["items"]} == {*CIRCUIT_SETS, "ironbird"}
    item = point(client, "ironbird")
    # equation 3-3: the drain takes k_c times the case flow, from the reservoir's 0 bar on
    assert item["case_pressure_bar"] == pytest.approx(0.6 * item["case_flow_lpm"], rel=1e-6)
    # both consumers count at 175 bar and leave by the return line
    same = point(client, "separate_drain", health={"system_leakage_lpm": 0.5})
    assert item["swashplate_angle_deg"] == pytest.approx(same["swashplate_angle_deg"], abs=0.01)
    assert item["swashplate_angle_deg"] > point(client, "separate_drain")["swashplate_angle_deg"] + 0.1
    body = {"circuit": "ironbird", "duration_s": 0.5, "sample_rate_hz": 2000}
    run = client.post(f"{API}/twin/simulation", json=body).json()
    assert run["circuit"] == "ironbird"
    mean = sum(run["channels"]["case_pressure_bar"]) / len(run["channels"]["case_pressure_bar"])
    assert mean == pytest.approx(item["case_pressure_bar"], rel=0.01)
    again = client.post(f"{API}/circuits", json=IRONBIRD)
    assert again.status_code == 409


def test_an_aircraft_names_it_and_its_pumps_are_judged_in_it(
    client: TestClient, healthy_records: list[DemoRecord]
) -> None:
    client.post(f"{API}/circuits", json=IRONBIRD)
    record = healthy_records[0]
    headers = {"content-type": "text/csv"}
    sent = client.post(f"{API}/records", content=record.content, headers=headers).json()
    before = sent["residuals"]["case_pressure_bar"]["twin"]
    tail = client.get(f"{API}/records/{sent['record_id']}").json()["aircraft"]
    missing = client.patch(f"{API}/aircraft/{tail}", json={"circuit": "garden hose"})
    assert missing.status_code == 422
    assert missing.json()["errors"][0]["where"] == "body.circuit"
    changed = client.patch(f"{API}/aircraft/{tail}", json={"circuit": "ironbird"})
    assert changed.status_code == 200, changed.text
    assert changed.json()["circuit"] == "ironbird"
    after = client.get(f"{API}/records/{sent['record_id']}").json()["residuals"]["case_pressure_bar"]["twin"]
    # 0.6 instead of 0.337 bar/(L/min)
    assert after > before + 0.2
    back = client.patch(f"{API}/aircraft/{tail}", json={"circuit": "shared_return"})
    assert back.status_code == 200
    again = client.get(f"{API}/records/{sent['record_id']}").json()["residuals"]["case_pressure_bar"]["twin"]
    assert again == pytest.approx(before)


def test_every_fault_is_named(client: TestClient) -> None:
    bad = {
        "id": "bad",
        "base": "nowhere",
        "drain": "both",
        "mood": 1,
        "changes": {
            "k_c": {**DRAIN, "value": -1.0},
            "k_x": DRAIN,
            "gamma": {"value": 1.0, "unit": "bar", "source": "x"},
        },
        "consumers": [{"name": "valve", "flow_lpm": -1}, "hose"],
        "accumulator": {"gas_volume_l": 0.5, "precharge_bar": 900.0},
    }
    refused = client.post(f"{API}/circuits", json=bad)
    assert refused.status_code == 422
    assert {e["where"] for e in refused.json()["errors"]} == {
        "body.mood",
        "body.base",
        "body.drain",
        "body.changes.k_c.value",
        "body.changes.k_x",
        "body.changes.gamma.unit",
        "body.consumers.0.flow_lpm",
        "body.consumers.1",
        "body.accumulator.precharge_bar",
    }
    condition = {"speed_rpm": 4600, "fluid_temperature_degc": 50, "circuit": "bad"}
    unknown = client.post(f"{API}/twin/operating-point", json={"conditions": [condition]})
    assert unknown.json()["errors"][0]["where"] == "body.conditions.0.circuit"


def test_circuits_belong_to_one_operator_or_to_all(database_url: str, tmp_path: Path) -> None:
    with guarded_client(database_url, tmp_path) as guarded:
        north, south = (key(guarded, "engineer", operator) for operator in ("north", "south"))
        assert guarded.post(f"{API}/circuits", json=IRONBIRD, headers=north).status_code == 201
        assert guarded.get(f"{API}/circuits/ironbird", headers=north).status_code == 200
        assert guarded.get(f"{API}/circuits/ironbird", headers=south).status_code == 404
        # the same name for another operator is another circuit
        assert guarded.post(f"{API}/circuits", json=IRONBIRD, headers=south).status_code == 201


def test_a_document_comes_back_as_it_was_read() -> None:
    found = circuit_set_from({**IRONBIRD, "accumulator": {"gas_volume_l": 0.5, "precharge_bar": 100.0}})
    assert circuit_set_from(circuit_document(found)) == found
    for own in CIRCUIT_SETS.values():
        again = circuit_set_from(circuit_document(own))
        assert again.circuit == own.circuit


def test_an_accumulator_is_as_soft_as_its_gas() -> None:
    kind = pump_type("h225")
    own = CIRCUIT_SETS["shared_return"]
    soft = CircuitSet(own.name, own.title, own.circuit, own.quantities, (), Accumulator(0.5, 100.0))
    oil = soft.around(kind).pump.volumes.discharge - kind.pump.volumes.discharge
    # dV/dP of p V^1.2 = const about 175 bar, by a difference
    gas = [0.5e-3 * (101.01325 / p) ** (1.0 / 1.2) for p in (175.01325, 177.01325)]
    assert oil / 1.5e9 == pytest.approx((gas[0] - gas[1]) / 2.0e5, rel=0.02)
    empty = CircuitSet(own.name, own.title, own.circuit, own.quantities, (), Accumulator(0.5, 180.0))
    assert empty.around(kind) is kind


def test_consumers_leak_beside_what_a_scenario_asks_for() -> None:
    schedule = Schedule((0.0, 1.0), (0.0, 1.0))
    for asked, found in ((None, None), (0.2, 0.7), (schedule, Schedule((0.0, 1.0), (0.5, 1.5)))):
        changes = {} if asked is None else {"system_leakage_lpm": asked}
        made = leaking(Scenario(1.0, Condition(4600.0, 50.0), changes=changes), 0.5)
        assert made.health.system_leakage_lpm == pytest.approx(0.5)
        assert made.changes.get("system_leakage_lpm") == found


def test_a_scenario_runs_in_a_circuit_of_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("ironbird.json").write_text(json.dumps(IRONBIRD))
    Path("short.toml").write_text("duration_s = 0.01\n[condition]\nspeed_rpm = 4600\nfluid_temperature_degc = 50\n")
    asked = ["simulate", "short.toml", "--output", "record.csv", "--circuit"]
    ran = CliRunner().invoke(app, [*asked, "ironbird.json"])
    assert ran.exit_code == 0, ran.output
    assert "# circuit: ironbird" in Path("record.csv").read_text()
    refused = CliRunner().invoke(app, [*asked, "garden-hose"])
    assert refused.exit_code == 2
    assert "--circuit garden-hose: is not known" in refused.output
