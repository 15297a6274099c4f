"""An aircraft names its fluid, and its pumps are judged by a twin with that fluid; on both databases."""

import math
from datetime import UTC, datetime
from typing import Any

import pytest
from fastapi.testclient import TestClient

from detectors.expectation.type_correction import HealthyCurve, HealthyPoint
from detectors.words.flights import Outline
from service.demo.fleet import HEALTHY, DemoPump, DemoRecord, pump_records
from service.history.known import Known, PlacedRecord
from service.history.setting import Setting
from service.monitoring.chain import chain
from twin.condition import Condition
from twin.operating_point import operating_point
from twin.pumps import circuit_parameters, pump_type
from twin.pumps.fluids import FLUIDS, with_fluid

API = "/api/v1"
THIN = "MIL-PRF-87257"
CSV = {"content-type": "text/csv"}
FLIGHTS = 14


@pytest.fixture(scope="session")
def thin_records() -> list[DemoRecord]:
    """Flights of a healthy pump in an aircraft that is filled with thin fluid."""
    return list(pump_records(DemoPump("P-87", "F-87", "LH", HEALTHY, THIN), FLIGHTS, seed=3))


def sent(client: TestClient, records: list[DemoRecord]) -> list[str]:
    found = []
    for record in records:
        answer = client.post(f"{API}/records", content=record.content, headers=CSV)
        assert answer.status_code == 201, answer.text
        found.append(answer.json()["record_id"])
    return found


def verdict(client: TestClient) -> dict[str, Any]:
    found: dict[str, Any] = client.get(f"{API}/pumps/P-87/verdict").json()
    return found


def case_residuals(client: TestClient, ids: list[str]) -> list[dict[str, float]]:
    return [client.get(f"{API}/records/{i}").json()["residuals"]["case_pressure_bar"] for i in ids]


def rms(residuals: list[dict[str, float]]) -> float:
    return math.sqrt(sum(r["residual"] ** 2 for r in residuals) / len(residuals))


@pytest.mark.postgres_in_study
def test_the_aircraft_s_fluid_is_the_twin_s(client: TestClient, thin_records: list[DemoRecord]) -> None:
    client.post(f"{API}/aircraft", json={"aircraft": "F-87", "fluid": THIN})
    ids = sent(client, thin_records)
    right, seen = verdict(client), case_residuals(client, ids)
    assert right["state"] == "healthy"
    assert not any("fluid" in flag for flag in right["quality"]["flags"])
    # what limits speak of is wear: half the viscosity is none
    flow = right["estimates"]["case_flow_at_reference_lpm"]
    assert flow["high"] < 1.9
    assert flow["mean"] < 1.5

    client.patch(f"{API}/aircraft/F-87", json={"fluid": "MIL-PRF-83282"})
    wrong, off = verdict(client), case_residuals(client, ids)
    for before, after in zip(seen, off, strict=True):
        assert after["measured"] == before["measured"]
        assert after["residual"] > before["residual"] + 0.05
    # what is left is how this pump and its drain differ from the nominal ones
    assert rms(off) > rms(seen) + 0.1
    assert wrong["estimates"]["case_flow_at_reference_lpm"]["mean"] > flow["mean"] + 0.2

    client.patch(f"{API}/aircraft/F-87", json={"fluid": THIN})
    assert verdict(client) == right


def test_said_late_or_early_is_the_same(client: TestClient, thin_records: list[DemoRecord]) -> None:
    """A correction of the registry refolds: the order of what becomes known decides nothing."""
    ids = sent(client, thin_records[:10])
    client.patch(f"{API}/aircraft/F-87", json={"fluid": THIN})
    late, seen = verdict(client), case_residuals(client, ids)
    window = client.get(f"{API}/records/{ids[-1]}").json()["windows"]
    means = next(w["means"] for w in window if w["kind"] == "zero_flow" and w["accepted"])
    condition = Condition(
        means["shaft_speed_rpm"]["mean"],
        means["fluid_temperature_degc"]["mean"],
        means["reservoir_pressure_bar"]["mean"],
    )
    twin = operating_point(with_fluid(pump_type("h225"), THIN).pump, condition, circuit_parameters("shared_return"))
    assert seen[-1]["twin"] == pytest.approx(float(twin.value("case_pressure_bar")[0]), abs=2e-4)
    curve = client.get(f"{API}/pumps/P-87/damage-identification-curve").json()
    assert curve["points"]
    assert late["twin_version"] == verdict(client)["twin_version"]


def test_a_measured_curve_holds_for_the_fluid_that_it_was_measured_with() -> None:
    curve = HealthyCurve((HealthyPoint(174.0, 0.4, 40.0, 4600.0), HealthyPoint(174.0, 0.4, 70.0, 4600.0)))
    known = Known(pump_type("h225"), {}, (), healthy=curve)
    assert known.healthy_in(Setting()) is curve
    assert known.healthy_in(Setting(fluid="MIL-PRF-83282")) is curve
    assert known.healthy_in(Setting(fluid="olive oil")) is curve
    assert known.healthy_in(Setting(fluid=THIN)) is None


def test_a_measured_curve_that_does_not_hold_is_said(client: TestClient, thin_records: list[DemoRecord]) -> None:
    points = [
        {
            "discharge_pressure_bar": 174.0,
            "case_minus_reservoir_bar": 0.45,
            "fluid_temperature_degc": t,
            "speed_rpm": 4600.0,
        }
        for t in (20.0, 35.0, 50.0, 65.0, 80.0)
    ]
    put = client.put(f"{API}/pump-types/h225/reference-curve", json={"points": points}, headers={"if-match": "*"})
    assert put.status_code in (200, 201), put.text
    sent(client, thin_records[:2])
    flags = verdict(client)["quality"]["flags"]
    assert not any("not one with" in flag for flag in flags)
    client.patch(f"{API}/aircraft/F-87", json={"fluid": THIN})
    flags = verdict(client)["quality"]["flags"]
    assert any(f"not one with {THIN}: judged against the twin (2 records)" in flag for flag in flags)


def test_links_of_a_history_follow_the_fluid() -> None:
    """Else what was folded with another fluid would be taken for what holds."""

    def links(fluid: str | None) -> list[str]:
        outline = Outline("r1", datetime(2026, 5, 2, tzinfo=UTC), "F-87", "LH", "F1", None, True, False)
        return chain(Known(pump_type("h225"), {}, (PlacedRecord(outline, "0", Setting(fluid=fluid)),)))

    assert links(THIN) != links(None)
    assert links("MIL-PRF-83282") == links(None)
    assert len({tuple(links(name)) for name in FLUIDS}) == len(FLUIDS)
