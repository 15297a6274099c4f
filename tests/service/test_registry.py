"""Registry: aircraft, pumps, pump types and reference curves, with every status they answer."""

from typing import Any

import pytest
from fastapi.testclient import TestClient

from service.demo.fleet import DemoRecord
from tests.service.records import body, document

JSON = {"content-type": "application/json"}
API = "/api/v1"
SENSOR = {
    "channel": "case_pressure_bar",
    "identity": "SN-77",
    "full_scale_bar": 5.0,
    "accuracy_percent_full_scale": 0.5,
    "since": "2026-01-01T00:00:00+02:00",
}


def upload(client: TestClient, content: bytes | None = None, **params: str) -> dict[str, Any]:
    answer = client.post(f"{API}/records", content=content or body(), headers=JSON, params=params)
    assert answer.status_code == 201, answer.text
    found: dict[str, Any] = answer.json()
    return found


def faults_of(answer: Any) -> set[str]:
    return {fault["where"] for fault in answer.json()["errors"]}


class TestAircraft:
    def test_made_read_changed_listed(self, client: TestClient) -> None:
        new = {"aircraft": "F-2", "circuit": "separate_drain", "fluid": "MIL-PRF-83282", "sensors": [SENSOR]}
        made = client.post(f"{API}/aircraft", json=new)
        assert made.status_code == 201, made.text
        read = client.get(f"{API}/aircraft/F-2").json()
        assert read == made.json()
        assert read["circuit"] == "separate_drain"
        assert read["confirmed"] is True
        assert read["sensors"][0]["since"] == "2025-12-31T22:00:00+00:00"
        changed = client.patch(f"{API}/aircraft/F-2", json={"aircraft_type": "H225"})
        assert changed.status_code == 200
        assert changed.json() == read | {"aircraft_type": "H225"}
        assert [a["aircraft"] for a in client.get(f"{API}/aircraft").json()["items"]] == ["F-2"]
        assert client.post(f"{API}/aircraft", json=new).status_code == 409
        assert client.get(f"{API}/aircraft/F-9").status_code == 404
        assert client.patch(f"{API}/aircraft/F-9", json={}).status_code == 404

    def test_every_fault_is_named_and_nothing_changes(self, client: TestClient) -> None:
        bad = {
            "aircraft": "",
            "mood": 1,
            "sensors": [{**SENSOR, "full_scale_bar": -1, "since": "2026-01-01T00:00:00"}],
        }
        answer = client.post(f"{API}/aircraft", json=bad)
        assert answer.status_code == 422
        assert faults_of(answer) == {
            "body.aircraft",
            "body.mood",
            "body.sensors.0.full_scale_bar",
            "body.sensors.0.since",
        }
        twice = client.post(f"{API}/aircraft", json={"aircraft": "F-3", "sensors": [SENSOR, SENSOR]})
        assert twice.status_code == 422
        assert client.get(f"{API}/aircraft").json()["items"] == []

    def test_a_records_aircraft_becomes_known_unconfirmed(self, client: TestClient) -> None:
        upload(client)
        assert client.get(f"{API}/aircraft/F-1").json()["confirmed"] is False
        assert client.patch(f"{API}/aircraft/F-1", json={}).json()["confirmed"] is True

    def test_the_circuit_reaches_the_analysis_at_once_and_later(self, client: TestClient) -> None:
        before = upload(client)["residuals"]["case_pressure_bar"]
        client.patch(f"{API}/aircraft/F-1", json={"circuit": "separate_drain"})
        record_id = client.get(f"{API}/records").json()["items"][0]["record_id"]
        after = client.get(f"{API}/records/{record_id}").json()["residuals"]["case_pressure_bar"]
        # nothing but the case flow passes a separate drain: its resistance there is k_cr of table 3-4,
        # the same as from case to reservoir through the shared line at no other flow
        assert after["measured"] == before["measured"]
        assert after["twin"] != before["twin"]
        assert upload(client, flight_id="F2")["residuals"]["case_pressure_bar"]["twin"] == pytest.approx(after["twin"])

    def test_a_coarser_sensor_widens_the_residual_from_its_day_on(self, client: TestClient) -> None:
        coarse = {**SENSOR, "full_scale_bar": 50.0, "accuracy_percent_full_scale": 1.0, "since": "2026-05-03T00:00:00Z"}
        old = upload(client)
        late = upload(client, flight_id="F2", started_at="2026-05-04T07:00:00Z")
        client.patch(f"{API}/aircraft/F-1", json={"sensors": [coarse]})

        def spread(record_id: str) -> float:
            answer = client.get(f"{API}/records/{record_id}").json()
            return float(answer["residuals"]["case_pressure_bar"]["standard_deviation"])

        before = old["residuals"]["case_pressure_bar"]["standard_deviation"]
        assert spread(old["record_id"]) == pytest.approx(before)
        assert spread(late["record_id"]) > 2.0 * before

    def test_a_fluid_that_the_twin_does_not_know_is_said(self, client: TestClient) -> None:
        upload(client)
        client.patch(f"{API}/aircraft/F-1", json={"fluid": "olive oil"})
        flags = client.get(f"{API}/pumps/P-1/verdict").json()["quality"]["flags"]
        assert any("olive oil" in flag for flag in flags)


class TestPumps:
    def test_registered_before_its_first_record(self, client: TestClient) -> None:
        made = client.post(f"{API}/pumps", json={"serial": "P-1", "pump_type": "h225_thesis"})
        assert made.status_code == 201, made.text
        assert made.json()["confirmed"] is True
        assert client.post(f"{API}/pumps", json={"serial": "P-1"}).status_code == 409
        upload(client)
        pump = client.get(f"{API}/pumps/P-1").json()
        assert pump["confirmed"] is True
        assert pump["pump_type"] == "h225_thesis"
        assert client.get(f"{API}/pumps/P-1/verdict").json()["twin_version"].startswith("h225_thesis-")

    def test_confirmed_and_given_another_type(self, client: TestClient) -> None:
        upload(client)
        first = client.get(f"{API}/pumps/P-1/verdict").json()
        assert client.patch(f"{API}/pumps/P-1", json={}).json()["confirmed"] is True
        changed = client.patch(f"{API}/pumps/P-1", json={"pump_type": "h225_thesis"})
        assert changed.status_code == 200
        assert changed.json()["pump_type"] == "h225_thesis"
        verdict = client.get(f"{API}/pumps/P-1/verdict").json()
        assert verdict["twin_version"] != first["twin_version"]
        assert client.patch(f"{API}/pumps/P-9", json={}).status_code == 404
        assert faults_of(client.patch(f"{API}/pumps/P-1", json={"pump_type": "x", "mood": 1})) == {"body.mood"}
        assert faults_of(client.patch(f"{API}/pumps/P-1", json={"pump_type": "x"})) == {"body.pump_type"}

    def test_the_type_does_not_depend_on_the_order_of_arrival(self, client: TestClient) -> None:
        days = {"A": "2026-05-02T07:00:00Z", "B": "2026-05-03T07:00:00Z"}
        for serial, order in (("P-1", "AB"), ("P-2", "BA")):
            for name in order:
                kind = {"A": {"pump_type": "h225_thesis"}, "B": {"pump_type": "h225"}}[name]
                upload(client, pump_serial=serial, flight_id=name, started_at=days[name], **kind)
        verdicts = [client.get(f"{API}/pumps/{serial}/verdict").json() for serial in ("P-1", "P-2")]
        assert verdicts[0] == verdicts[1]
        assert client.get(f"{API}/pumps/P-2").json()["pump_type"] == "h225_thesis"
        assert any("pump type h225" in flag for flag in verdicts[0]["quality"]["flags"])


class TestPumpTypes:
    URL = f"{API}/pump-types/h225/reference-curve"
    POINT = {  # noqa: RUF012
        "discharge_pressure_bar": 174.0,
        "case_minus_reservoir_bar": 0.35,
        "fluid_temperature_degc": 50.0,
        "speed_rpm": 4600.0,
    }

    def test_built_in_sets_are_listed_with_their_sources(self, client: TestClient) -> None:
        assert [k["id"] for k in client.get(f"{API}/pump-types").json()["items"]] == ["h225", "h225_thesis"]
        kind = client.get(f"{API}/pump-types/h225").json()
        assert kind["limits"]["case_flow_lpm"]["value"] == 1.5
        assert "Mkadara" in kind["limits"]["case_flow_lpm"]["source"]
        assert client.get(f"{API}/pump-types/h160").status_code == 404

    def test_measured_points_come_back(self, client: TestClient) -> None:
        assert client.get(self.URL).json()["source"] == "twin"
        points = [self.POINT, {**self.POINT, "discharge_pressure_bar": 170.0, "case_minus_reservoir_bar": 0.5}]
        stored = client.put(self.URL, json={"points": points})
        assert stored.status_code == 200, stored.text
        read = client.get(self.URL).json()
        assert read["points"] == [
            {**point, "warming_k_per_min": 0.0} for point in points
        ]  # at rest, where nothing is said
        assert read["source"] == "measured"
        assert client.put(f"{API}/pump-types/h160/reference-curve", json={"points": points}).status_code == 404

    def test_bad_points_are_named(self, client: TestClient) -> None:
        bad = [{**self.POINT, "speed_rpm": 0, "mood": 1}, {**self.POINT, "case_minus_reservoir_bar": "NaN"}]
        answer = client.put(self.URL, json={"points": bad})
        assert answer.status_code == 422
        assert faults_of(answer) == {
            "body.points.0.speed_rpm",
            "body.points.0.mood",
            "body.points.1.case_minus_reservoir_bar",
        }
        assert client.put(self.URL, json={"points": [self.POINT]}).status_code == 422
        assert client.get(self.URL).json()["points"] == []


def test_the_trend_of_a_position_spans_its_pumps(client: TestClient) -> None:
    upload(client)
    upload(client, pump_serial="P-2", flight_id="F2", started_at="2026-05-09T07:00:00Z")
    upload(client, pump_serial="P-3", flight_id="F3", position="RH")
    url = f"{API}/aircraft/F-1/positions/LH/trend"
    trend = client.get(url, params={"metric": "case_residual_bar"}).json()
    assert [item["pump"] for item in trend["items"]] == ["P-1", "P-2"]
    assert client.get(url, params={"metric": "mood"}).status_code == 422
    assert client.get(f"{API}/aircraft/F-9/positions/LH/trend?metric=case_residual_bar").status_code == 404


def test_a_pump_that_never_paused_this_long_is_silent(
    healthy_client: TestClient, healthy_records: list[DemoRecord]
) -> None:
    client, serial = healthy_client, healthy_records[0].pump.serial
    assert client.get(f"{API}/pumps/{serial}").json()["silent"] is True
    assert [p["serial"] for p in client.get(f"{API}/fleet/summary").json()["silent"]] == [serial]
    assert "gone silent" in client.get("/").text
    pump = client.get(f"{API}/pumps/{serial}").json()
    place = {"aircraft": pump["aircraft"], "position": pump["position"]}
    removed = {**place, "from": "2020-01-01T00:00:00Z", "to": healthy_records[-1].started_at.isoformat()}
    assert client.post(f"{API}/pumps/{serial}/installations", json=removed).status_code == 201
    assert client.get(f"{API}/fleet/summary").json()["silent"] == []


def test_a_pump_heard_of_today_is_not_silent(client: TestClient) -> None:
    from datetime import UTC, datetime, timedelta

    upload(client, body(document()), started_at=(datetime.now(UTC) - timedelta(days=1)).isoformat())
    assert client.get(f"{API}/pumps/P-1").json()["silent"] is False


@pytest.mark.parametrize("path", ["/pumps/%00", "/aircraft/%00", "/pumps/%00/installations", "/pump-types/%00"])
def test_what_cannot_be_stored_is_not_found(client: TestClient, path: str) -> None:
    assert client.get(API + path).status_code in (404, 422)
    assert client.patch(f"{API}/pumps/%00", json={}).status_code in (404, 422)
    refused = client.post(f"{API}/aircraft", json={"aircraft": "F\x00"})
    assert faults_of(refused) == {"body.aircraft"}
