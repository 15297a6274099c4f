"""A pump type without a twin over HTTP: its channels declared, its curve measured, its records judged; on both databases.

Records have the layout of the public hydraulic rig: cycles of a minute at 1 Hz, regulated pressure and oil temperature and
nothing else. The cycles here are invented; ``benchmarks.rig_judge`` judges the real ones.
"""

import json
import os
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient

from benchmarks.rig_judge import DOCUMENT, THRESHOLDS, Block, channels, curve_points, cycles, histories

API = "/api/v1"
TYPE = DOCUMENT["id"]
WEAK_BAR = 0.28
"""What weak pump leakage takes off the rig's regulated pressure."""
COOLERS = (36.0, 45.0)


def cycle(rng: np.random.Generator, oil: float, fall: float = 0.0, warming: float = 0.0) -> tuple[Any, Any]:
    """Pressure and temperature of one minute: closed for seconds 2 to 8, then loaded; the probe lags by a minute."""
    temperature = oil + warming * (np.arange(60.0) - 30.0) / 60.0 + 0.02 * rng.normal(size=60)
    pressure = np.full(60, 150.0) + rng.normal(size=60)
    pressure[2:8] = 191.4 - 0.065 * (oil + warming - 36.0) - fall + 0.015 * rng.normal() + 0.02 * rng.normal(size=6)
    return pressure, temperature


def measured_curve(rng: np.random.Generator) -> list[dict[str, float]]:
    """Points of a healthy pump at both coolers' conditions."""
    blocks = []
    for oil in (*COOLERS, *COOLERS, *COOLERS):
        pairs = [cycle(rng, oil + rng.uniform(-0.7, 0.7)) for _ in range(4)]
        blocks.append(Block((100, 100, 0, 130, 0), np.array([p for p, _ in pairs]), np.array([t for _, t in pairs])))
    return as_sent(blocks)


def as_sent(blocks: list[Block]) -> list[dict[str, float]]:
    """Points of the curve in the shape of the API: what the type lacks is left out."""
    return [
        {
            "discharge_pressure_bar": p.discharge_pressure_bar,
            "fluid_temperature_degc": p.fluid_temperature_degc,
            "warming_k_per_min": p.warming_k_per_min,
        }
        for p in curve_points(blocks)
    ]


def knows_rig(client: TestClient, points: list[dict[str, float]]) -> TestClient:
    """The service, told of the rig's type, its thresholds and its curve."""
    answer = client.post(f"{API}/pump-types", json=dict(DOCUMENT))
    assert answer.status_code == 201, answer.text
    put = {"values": THRESHOLDS, "reason": "the circuit is closed for six seconds"}
    address = f"{API}/thresholds/pump-type/{TYPE}"
    assert client.put(address, json=put, headers={"If-Match": "*"}).status_code == 200
    answer = client.put(f"{API}/pump-types/{TYPE}/reference-curve", json={"points": points})
    assert answer.status_code == 200, answer.text
    return client


@pytest.fixture
def rig(client: TestClient) -> TestClient:
    """A service that knows the rig's type, its thresholds and its curve."""
    return knows_rig(client, measured_curve(np.random.default_rng(1)))


def sent(client: TestClient, serial: str, pairs: list[tuple[Any, Any]], first: int = 0) -> dict[str, Any]:
    """Upload cycles of one pump; the last answer."""
    answer: Any = None
    for i, (pressure, temperature) in enumerate(pairs, first):
        record = {
            "pump_serial": serial,
            "pump_type": TYPE,
            "aircraft": "rig",
            "position": "MP1",
            "flight_id": f"cycle-{i}",
            "started_at": f"2015-01-01T{i // 60:02d}:{i % 60:02d}:00Z",
            "channels": {name: samples.tolist() for name, samples in channels(pressure, temperature).items()},
        }
        answer = client.post(f"{API}/records", content=json.dumps(record), headers={"content-type": "application/json"})
        assert answer.status_code == 201, answer.text
    found: dict[str, Any] = answer.json()
    return found


def healthy_before(rng: np.random.Generator) -> list[tuple[Any, Any]]:
    return [cycle(rng, oil) for oil in COOLERS for _ in range(5)]


@pytest.mark.study
@pytest.mark.parametrize("fall", [0.0, WEAK_BAR])
def test_a_leak_is_a_change_of_open_cause_and_health_stays_health(rig: TestClient, fall: float) -> None:
    rng = np.random.default_rng(7)
    answer = sent(rig, "MP1", [*healthy_before(rng), *(cycle(rng, COOLERS[1], fall) for _ in range(12))])
    verdict = answer["verdict"]
    (window,) = [w for w in answer["windows"] if w["accepted"]]
    assert (window["kind"], window["residuals"]) == ("zero_flow", {})
    assert verdict["quality"]["records_used"] == 22
    assert verdict["quality"]["reservoir_pressure"] == "nominal"
    # nothing shows how much flows, so nobody says it
    assert verdict["estimates"] == {} == verdict["minimum_detectable"]
    assert verdict["probability_beyond_limit"] is None
    assert any("case pressure is not measured" in spot["because"] for spot in verdict["blind_spots"])
    first = verdict["advice"].split(". ")[0]
    assert "case pressure is not measured" in first
    assert "no twin of its own" in first
    trend = rig.get(f"{API}/pumps/MP1/trend", params={"metric": "discharge_residual_bar"}).json()["items"]
    assert trend[-1]["value"] == pytest.approx(-fall, abs=0.08)
    if not fall:
        assert verdict["state"] == "healthy"
        assert "Fly on" not in verdict["advice"]
        return
    assert (verdict["state"], verdict["side"]) == ("indeterminate", "unknown")
    assert {"pump_degradation", "system_leakage", "compensator_fault", "sensor_fault"} <= set(verdict["candidates"])
    assert verdict["sensor"] == "discharge_pressure_bar"
    assert "against a gauge" in verdict["resolving_measurement"]
    assert "Do not replace the pump on this" in verdict["advice"]


@pytest.mark.postgres_in_study
def test_a_cycle_that_still_warms_is_not_judged_and_the_verdict_says_so(rig: TestClient) -> None:
    rng = np.random.default_rng(8)
    before = healthy_before(rng)
    sent(rig, "MP2", before)
    # the pump is 3 K warmer than its probe says: what a weak leak takes off, and more, would hide or appear
    warming = [cycle(rng, COOLERS[0], warming=3.0) for _ in range(4)]
    verdict = sent(rig, "MP2", warming, len(before))["verdict"]
    assert verdict["state"] == "healthy"
    assert verdict["quality"]["records_used"] == len(before)
    assert any(
        "4 of 14 records outside the measured healthy curve (warming_k_per_min)" in f
        for f in verdict["quality"]["flags"]
    )
    assert verdict["advice"].startswith("Nothing is known since 4 record(s)")
    assert any("not judged" in spot["because"] for spot in verdict["blind_spots"])
    steady = sent(rig, "MP2", [cycle(rng, COOLERS[0])], len(before) + 4)["verdict"]
    assert "Nothing is known" not in steady["advice"]


def test_without_a_curve_nothing_is_judged(client: TestClient) -> None:
    client.post(f"{API}/pump-types", json=dict(DOCUMENT))
    client.put(
        f"{API}/thresholds/pump-type/{TYPE}", json={"values": THRESHOLDS, "reason": "short"}, headers={"If-Match": "*"}
    )
    rng = np.random.default_rng(9)
    verdict = sent(client, "MP3", [cycle(rng, COOLERS[0]) for _ in range(2)])["verdict"]
    assert verdict["state"] == "insufficient_data"
    assert any("no healthy curve has been measured" in flag for flag in verdict["quality"]["flags"])


def test_every_answer_about_such_a_pump_stands(rig: TestClient) -> None:
    rng = np.random.default_rng(10)
    record = sent(rig, "MP4", [cycle(rng, COOLERS[0]) for _ in range(9)])["record_id"]
    for address in (
        "pumps/MP4",
        "pumps/MP4/verdict",
        "pumps/MP4/forecast",
        "pumps/MP4/damage-identification-curve",
        "pumps/MP4/damage-identification-curve?format=svg",
        f"records/{record}",
        f"records/{record}/windows",
        f"records/{record}/channels",
        f"pump-types/{TYPE}",
        f"pump-types/{TYPE}/reference-curve",
        "fleet/summary",
        "fleet/ranking",
        "exports/windows.csv",
        "exports/verdicts.csv",
    ):
        answer = rig.get(f"{API}/{address}")
        assert answer.status_code == 200, (address, answer.text)
    assert rig.get(f"{API}/pump-types/{TYPE}").json()["lacks"] == ["case_pressure_bar", "shaft_speed_rpm"]
    for page in ("/", "/pumps/MP4", f"/records/{record}", "/records"):
        assert rig.get(page).status_code == 200, page
    spectrum = rig.get(f"{API}/records/{record}/spectrum", params={"channel": "discharge_pressure_bar"})
    assert spectrum.status_code in (200, 404, 422)


def test_a_channel_that_is_not_declared_is_still_required(client: TestClient) -> None:
    rng = np.random.default_rng(11)
    pressure, temperature = cycle(rng, COOLERS[0])
    record = {
        "pump_serial": "P",
        "aircraft": "A",
        "position": "LH",
        "flight_id": "1",
        "started_at": "2015-01-01T00:00:00Z",
        "channels": {n: s.tolist() for n, s in channels(pressure, temperature).items()},
    }
    answer = client.post(f"{API}/records", json=record)
    assert answer.status_code == 422
    assert {e["where"] for e in answer.json()["errors"]} == {"channels.case_pressure_bar", "channels.shaft_speed_rpm"}


def test_a_document_that_declares_wrongly_names_every_fault(client: TestClient) -> None:
    wrong = {**DOCUMENT, "lacks": ["time_s", 7, "case_pressure_bar", "discharge_pressure_bar"], "own_twin": "no"}
    answer = client.post(f"{API}/pump-types", json=wrong)
    assert answer.status_code == 422
    where = {e["where"] for e in answer.json()["errors"]}
    assert where == {"body.lacks", "body.lacks.0", "body.lacks.1", "body.own_twin"}
    client.post(f"{API}/pump-types", json=dict(DOCUMENT))
    points = [{"fluid_temperature_degc": 40.0}, {"discharge_pressure_bar": 190.0}]
    answer = client.put(f"{API}/pump-types/{TYPE}/reference-curve", json={"points": points})
    where = {e["where"] for e in answer.json()["errors"]}
    assert where == {"body.points.0.discharge_pressure_bar", "body.points.1.fluid_temperature_degc"}


@pytest.mark.skipif(
    "CASEDRAIN_RIG" not in os.environ, reason="CASEDRAIN_RIG names no archive of the public rig's cycles"
)
def test_the_real_rig_over_http(client: TestClient) -> None:
    with np.load(os.environ["CASEDRAIN_RIG"]) as archive:
        blocks = cycles({name: archive[name] for name in archive.files})
    chosen = [next(found for found in histories(blocks) if found[0].profile[2:4] == (grade, 90)) for grade in (0, 1, 2)]
    said = []
    for grade, (block, training, before) in enumerate(chosen):
        if not grade:
            knows_rig(client, as_sent(training))
        pairs = [pair for b in (*before, block) for pair in zip(b.pressure, b.temperature, strict=True)]
        said.append(sent(client, f"MP-{grade}", pairs)["verdict"])
    assert [v["state"] for v in said] == ["healthy", "indeterminate", "indeterminate"]
    assert all("pump_degradation" in v["candidates"] for v in said[1:])
