"""Uploading a record: statuses, formats, identity, conflicts, and every kind of bad input."""

import gzip
import json
import time
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import func, select

from service.demo.fleet import DemoRecord
from service.settings import Settings
from service.storage.tables import Pump, Record, Refusal, StoredAssessment
from service.web.app import create_app
from tests.service.lent_application import lent
from tests.service.records import METADATA, body, document

JSON = {"content-type": "application/json"}
CSV = {"content-type": "text/csv"}


def post(client: TestClient, content: bytes, headers: dict[str, str] = JSON, **params: str) -> Any:
    return client.post("/api/v1/records", content=content, headers=headers, params=params)


def n_rows(client: TestClient, table: type) -> int:
    with client.app.state.context.database.reading() as session:  # type: ignore[attr-defined]
        return session.scalar(select(func.count()).select_from(table)) or 0


def test_new_is_201_and_known_is_200(client: TestClient) -> None:
    first = post(client, body())
    assert first.status_code == 201, first.text
    again = post(client, body())
    assert again.status_code == 200
    assert again.json()["record_id"] == first.json()["record_id"]
    answer = first.json()
    assert answer["status"] == "analysed"
    assert answer["verdict"]["state"] == "insufficient_data"
    zero_flow = [w for w in answer["windows"] if w["kind"] == "zero_flow" and w["accepted"]]
    assert zero_flow
    residual = answer["residuals"]["case_pressure_bar"]
    assert residual["residual"] == pytest.approx(residual["measured"] - residual["twin"])
    assert residual["measured"] == pytest.approx(0.9, abs=0.01)
    assert set(zero_flow[-1]["means"]["case_pressure_bar"]) == {"mean", "standard_error"}


def test_csv_gzip_and_json_say_the_same(client: TestClient, healthy_records: list[DemoRecord]) -> None:
    content = healthy_records[0].content
    plain = post(client, content, CSV)
    assert plain.status_code == 201, plain.text
    for i, (sent, headers) in enumerate(
        (
            (gzip.compress(content), {"content-type": "application/gzip"}),
            (gzip.compress(content), {"content-type": "text/csv", "content-encoding": "gzip"}),
            (content, {"content-type": "application/octet-stream"}),
        )
    ):
        other = post(client, sent, headers, flight_id=f"other-{i}")
        assert other.status_code == 201, other.text
        assert other.json()["windows"] == plain.json()["windows"]


def test_request_metadata_win_over_the_file(client: TestClient) -> None:
    answer = post(client, body(), pump_serial="P-2", flight_hours="12.5")
    assert answer.status_code == 201
    assert answer.json()["pump_serial"] == "P-2"
    assert client.get("/api/v1/pumps/P-2").json()["flight_hours"] == 12.5
    assert client.get("/api/v1/pumps/P-1").status_code == 404


def test_raw_bytes_come_back(client: TestClient) -> None:
    record_id = post(client, body()).json()["record_id"]
    assert client.get(f"/api/v1/records/{record_id}/raw").content == body()


def test_wait_false_is_202_and_becomes_analysed_or_refused(client: TestClient) -> None:
    good = post(client, body(), wait="false")
    assert good.status_code == 202
    assert client.get(f"/api/v1/records/{good.json()['record_id']}").json()["status"] == "analysed"
    bad = post(client, body(document(case_pressure_bar=None)), wait="false")
    assert bad.status_code == 202
    refused = client.get(f"/api/v1/records/{bad.json()['record_id']}").json()
    assert refused["status"] == "refused"
    assert refused["problem"]["errors"] == [{"where": "channels.case_pressure_bar", "problem": "is missing"}]


def test_another_record_for_the_same_flight_is_a_conflict_that_names_the_first(client: TestClient) -> None:
    first = post(client, body()).json()["record_id"]
    other = document(case_pressure_bar=[0.6] * 160)
    clash = post(client, body(other))
    assert clash.status_code == 409
    assert clash.json()["record_id"] == first
    replaced = post(client, body(other), supersedes=first)
    assert replaced.status_code == 201, replaced.text
    assert client.get(f"/api/v1/records/{first}").json()["status"] == "superseded"
    assert client.get("/api/v1/pumps/P-1").json()["records"] == 1


def test_the_unknown_pump_is_registered_unconfirmed(client: TestClient) -> None:
    post(client, body())
    assert client.get("/api/v1/pumps/P-1").json()["confirmed"] is False


def test_a_record_without_zero_flow_is_stored_and_says_why(client: TestClient) -> None:
    answer = post(client, body(document(flight_control_activity=[0.8] * 160)))
    assert answer.status_code == 201
    assert "no zero-flow window" in answer.json()["explanation"]
    assert answer.json()["residuals"] is None
    assert answer.json()["verdict"]["quality"]["records_used"] == 0


def test_absolute_pressures_become_gauge(client: TestClient) -> None:
    gauge = post(client, body()).json()["residuals"]
    shifted = document()
    for name in ("discharge_pressure_bar", "case_pressure_bar", "reservoir_pressure_bar"):
        shifted["channels"][name] = [v + 0.8 for v in shifted["channels"][name]]
    shifted |= {"pressure_reference": "absolute", "ambient_pressure_bar": 0.8, "flight_id": "F2"}
    absolute = post(client, body(shifted)).json()["residuals"]
    for name, value in gauge.items():
        assert absolute[name]["measured"] == pytest.approx(value["measured"], abs=1e-6)


def backwards() -> list[float]:
    time = [float(i) for i in range(160)]
    time[20] = 5.0
    return time


def with_text() -> list[Any]:
    samples: list[Any] = document()["channels"]["case_pressure_bar"]
    samples[3] = "0,9"
    return samples


BAD: list[tuple[str, bytes, dict[str, str], int, list[str]]] = [
    ("missing channel", body(document(shaft_speed_rpm=None)), JSON, 422, ["channels.shaft_speed_rpm"]),
    ("text in a number", body(document(case_pressure_bar=with_text())), JSON, 422, ["channels.case_pressure_bar[3]"]),
    ("unequal lengths", body(document(case_pressure_bar=[0.9] * 7)), JSON, 422, ["channels.case_pressure_bar"]),
    ("time backwards", body(document(time_s=backwards())), JSON, 422, ["channels.time_s[20]"]),
    (
        "170 bar of case pressure",
        body(document(case_pressure_bar=[170.0] * 160)),
        JSON,
        422,
        ["channels.case_pressure_bar"],
    ),
    ("77 rpm", body(document(shaft_speed_rpm=[0.0] * 40 + [76.7] * 120)), JSON, 422, ["channels.shaft_speed_rpm"]),
    ("rad/s", body(document(shaft_speed_rpm=[0.0] * 40 + [481.7] * 120)), JSON, 422, ["channels.shaft_speed_rpm"]),
    ("kelvin", body(document(fluid_temperature_degc=[323.0] * 160)), JSON, 422, ["channels.fluid_temperature_degc"]),
    ("pascal", body(document(discharge_pressure_bar=[1.74e7] * 160)), JSON, 422, ["channels.discharge_pressure_bar"]),
    ("only NaN", body(document(case_pressure_bar=[None] * 160)), JSON, 422, ["channels.case_pressure_bar"]),
    ("empty body", b"", JSON, 400, ["body"]),
    ("not JSON", b"{", JSON, 400, ["body"]),
    ("an array", b"[]", JSON, 400, ["body"]),
    ("truncated gzip", gzip.compress(body())[:-40], {"content-type": "application/gzip"}, 400, ["body"]),
    ("no gzip at all", body(), {"content-type": "application/gzip"}, 400, ["body"]),
    ("wrong type", body(), {"content-type": "application/pdf"}, 415, ["content-type"]),
    ("no channels", json.dumps(METADATA).encode(), JSON, 422, ["channels", "channels.time_s"]),
    (
        "half a character",
        json.dumps({**document(), "pump_serial": "P\ud800", "aircraft": "F\udfff"}).encode(),
        JSON,
        422,
        ["pump_serial", "aircraft"],
    ),
    (
        "lists for texts",
        body({**document(), "pump_serial": ["P-1"], "started_at": {"day": 1}}),
        JSON,
        422,
        ["pump_serial", "started_at"],
    ),
    ("not UTF-8", b"time_s\n\xff\xfe", CSV, 400, ["byte 7"]),
    ("no header", b"# pump_serial: 1\n", CSV, 400, ["body"]),
    ("ragged rows", b"time_s,case_pressure_bar\n1,2,3\n2,3\n", CSV, 422, ["line 2"]),
    (
        "bad metadata",
        body({**document(), "started_at": "2026-05-02T07:11:00", "aircraft": "", "flight_hours": "many"}),
        JSON,
        422,
        ["started_at", "aircraft", "flight_hours"],
    ),
    (
        "absolute without ambient",
        body({**document(), "pressure_reference": "absolute"}),
        JSON,
        422,
        ["ambient_pressure_bar"],
    ),
]


@pytest.mark.parametrize(("content", "headers", "status", "places"), [b[1:] for b in BAD], ids=[b[0] for b in BAD])
def test_bad_input_gets_one_problem_and_stores_nothing(
    client: TestClient, content: bytes, headers: dict[str, str], status: int, places: list[str]
) -> None:
    answer = post(client, content, headers)
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    problem = answer.json()
    assert {"type", "title", "status", "detail", "errors"} <= set(problem)
    assert set(places) <= {e["where"] for e in problem["errors"]}
    assert [n_rows(client, t) for t in (Record, Pump, StoredAssessment)] == [0, 0, 0]
    assert n_rows(client, Refusal) == 1


def test_all_faults_come_in_one_message(client: TestClient) -> None:
    broken = document(
        shaft_speed_rpm=None, time_s=backwards(), case_pressure_bar=[0.9] * 7, fluid_temperature_degc=[300.0] * 160
    )
    del broken["aircraft"]
    places = {e["where"] for e in post(client, body(broken)).json()["errors"]}
    assert {
        "aircraft",
        "channels.shaft_speed_rpm",
        "channels.time_s[20]",
        "channels.case_pressure_bar",
        "channels.fluid_temperature_degc",
    } <= places


def test_single_spikes_are_no_reason_to_refuse(client: TestClient) -> None:
    spiky = document()
    spiky["channels"]["case_pressure_bar"][100] = 170.0
    spiky["channels"]["shaft_speed_rpm"][90] = 77.0
    answer = post(client, body(spiky))
    assert answer.status_code == 201
    assert answer.json()["residuals"]["case_pressure_bar"]["measured"] == pytest.approx(0.9, abs=0.01)


def test_a_refused_record_leaves_its_neighbours_alone(client: TestClient) -> None:
    post(client, body())
    before = client.get("/api/v1/pumps/P-1/verdict").json()
    assert post(client, body({**document(time_s=backwards()), "flight_id": "F2"})).status_code == 422
    assert client.get("/api/v1/pumps/P-1/verdict").json() == before


def test_too_large_is_413(client: TestClient) -> None:
    assert post(client, b"x" * 2_000_001).status_code == 413


def test_a_gzip_bomb_is_413(settings: Settings) -> None:
    bomb = gzip.compress(b"0" * 50_000_000)
    assert len(bomb) < 100_000
    with lent(settings.model_copy(update={"max_inflated_bytes": 1_000_000})) as client:
        assert post(client, bomb, {"content-type": "application/gzip"}).status_code == 413


def test_unknown_query_parameters_are_refused_by_name(client: TestClient) -> None:
    answer = post(client, body(), tail="F-1")
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["where"] == "query.tail"


@pytest.mark.study
def test_stored_but_not_analysed_is_picked_up_at_the_next_start(client: TestClient, settings: Any) -> None:
    from service.access.security import EVERYBODY
    from service.monitoring.acceptance import Upload

    context = client.app.state.context  # type: ignore[attr-defined]
    with context.spool.of(body()) as file:
        record_id = context.acceptance.store(Upload(file, "application/json", "", {}), EVERYBODY).record_id
    assert client.get(f"/api/v1/records/{record_id}").json()["status"] == "stored"
    with TestClient(create_app(settings), base_url="http://localhost") as restarted:
        for _ in range(100):
            status = restarted.get(f"/api/v1/records/{record_id}").json()["status"]
            if status != "stored":
                break
            time.sleep(0.1)
        assert status == "analysed"
