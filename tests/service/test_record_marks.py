"""Marks on records over the API: they refold, they are told, and what was known before them stays readable."""

import time
from datetime import UTC, datetime
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient

from tests.service.records import body, document

JSON = {"content-type": "application/json"}
API = "/api/v1"
KNOCKED = slice(100, 121)
SHIFT = 0.012
"""Small enough to be no spike [bar]."""


def upload(client: TestClient, content: bytes) -> dict[str, Any]:
    answer = client.post(f"{API}/records", content=content, headers=JSON)
    assert answer.status_code == 201, answer.text
    found: dict[str, Any] = answer.json()
    return found


def knocked() -> bytes:
    changed = np.array(document()["channels"]["case_pressure_bar"])
    changed[KNOCKED] += SHIFT
    return body(document(case_pressure_bar=list(changed)))


def case_residual(record: dict[str, Any]) -> float:
    residual: float = record["residuals"]["case_pressure_bar"]["residual"]
    return residual


def test_a_bad_stretch_refolds_and_its_withdrawal_takes_that_back(client: TestClient) -> None:
    before = upload(client, knocked())
    record = f"{API}/records/{before['record_id']}"
    known = datetime.now(UTC).isoformat()
    time.sleep(0.01)
    made = client.post(
        f"{record}/marks", json={"start_s": 99.5, "end_s": 120.5, "mark": "bad", "reason": "plug was moved"}
    )
    assert made.status_code == 201, made.text
    assert made.headers["Location"] == f"{record}/marks/{made.json()['id']}"
    after = client.get(record).json()
    assert case_residual(after) == pytest.approx(case_residual(before) - SHIFT * 21 / 120, abs=0.0008)
    assert any("marked bad" in flag for flag in after["flags"])
    assert "bridged" in after["windows"][-1]["bridged"]
    metric = {"metric": "case_residual_bar"}
    assert client.get(f"{API}/pumps/P-1/trend", params=metric).json()["items"][0]["value"] == pytest.approx(
        case_residual(after), abs=1e-6
    )
    as_known = client.get(f"{API}/pumps/P-1/verdict", params={"known_at": known}).json()
    assert {**as_known, "software": None} == {**before["verdict"], "software": None}
    assert [m["mark"] for m in client.get(f"{record}/marks").json()["items"]] == ["bad"]
    assert client.delete(f"{record}/marks/{made.json()['id']}").status_code == 204
    assert client.get(f"{record}/marks").json()["items"] == []
    again = client.get(record).json()
    assert case_residual(again) == case_residual(before)
    assert client.delete(f"{record}/marks/{made.json()['id']}").status_code == 404
    assert client.get(f"{API}/audit").json()["items"][0]["action"] == "record.unmark"


def test_a_good_stretch_makes_an_unsteady_record_count(client: TestClient) -> None:
    warming = list(40.0 + 0.15 * np.arange(160.0))
    before = upload(client, body(document(fluid_temperature_degc=warming)))
    assert before["residuals"] is None
    record = f"{API}/records/{before['record_id']}"
    made = client.post(
        f"{record}/marks", json={"start_s": 60, "end_s": 150, "mark": "good", "reason": "seen on the rig"}
    )
    assert made.status_code == 201, made.text
    after = client.get(record).json()
    assert after["residuals"] is not None
    assert after["explanation"] is None
    window = [w for w in after["windows"] if w["kind"] == "zero_flow"]
    assert [(w["start_s"], w["accepted"]) for w in window if w["accepted"]] == [(60.0, True)]
    assert client.get(f"{API}/pumps/P-1/verdict").json()["quality"]["records_used"] == 1


def test_the_same_marks_in_any_order_give_the_same_verdict(client: TestClient) -> None:
    first = upload(client, knocked())
    record = f"{API}/records/{first['record_id']}"
    one = {"start_s": 50, "end_s": 55, "mark": "bad", "reason": "a"}
    other = {"start_s": 99.5, "end_s": 120.5, "mark": "bad", "reason": "b"}
    verdicts = []
    for pair in ((one, other), (other, one)):
        ids = [client.post(f"{record}/marks", json=mark).json()["id"] for mark in pair]
        verdict = client.get(f"{API}/pumps/P-1/verdict").json()
        verdicts.append({**verdict, "software": None})
        for mark_id in ids:
            client.delete(f"{record}/marks/{mark_id}")
    assert verdicts[0] == verdicts[1]


def test_bad_marks_name_every_fault_and_change_nothing(client: TestClient) -> None:
    record = f"{API}/records/{upload(client, body())['record_id']}"
    answer = client.post(
        f"{record}/marks", json={"start_s": -1, "end_s": "x", "mark": "ugly", "reason": " ", "more": 1}
    )
    assert answer.status_code == 422
    assert {e["where"] for e in answer.json()["errors"]} >= {
        "body.start_s",
        "body.end_s",
        "body.mark",
        "body.reason",
        "body.more",
    }
    answer = client.post(f"{record}/marks", json={"start_s": 9, "end_s": 9, "mark": "bad", "reason": "why"})
    assert answer.status_code == 422
    assert client.get(f"{record}/marks").json()["items"] == []
    assert client.post(f"{API}/records/none/marks", json={}).status_code in (404, 422)


def test_a_withdrawn_record_cannot_be_marked(client: TestClient) -> None:
    record = f"{API}/records/{upload(client, body())['record_id']}"
    assert client.delete(record, params={"reason": "wrong pump"}).status_code == 200
    answer = client.post(f"{record}/marks", json={"start_s": 9, "end_s": 12, "mark": "bad", "reason": "why"})
    assert answer.status_code == 409
