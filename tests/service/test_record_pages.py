"""What a record holds, sample by sample, over the API and on its page: no extreme is lost, nothing is made up."""

import json
import re
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient

from service.storage.tables import Record
from tests.service.bursts import burst_document
from tests.service.records import body, document

API = "/api/v1"
JSON = {"content-type": "application/json"}
ORIGIN = {"origin": "http://localhost"}


def sent(client: TestClient, changed: dict[str, Any] | None = None, **params: Any) -> str:
    answer = client.post(f"{API}/records", content=body(changed), headers=JSON, params=params)
    assert answer.status_code in (201, 202), answer.text
    return str(answer.json()["record_id"])


def channel(found: dict[str, Any], name: str) -> dict[str, Any]:
    return next(c for c in found["channels"] if c["channel"] == name)


def broken() -> tuple[dict[str, Any], np.ndarray]:
    """A record with a spike and a dip of one sample each, and its discharge pressure."""
    record = document()
    pressure = np.array(record["channels"]["discharge_pressure_bar"])
    pressure[[97, 131]] = 190.0, 160.0
    record["channels"]["discharge_pressure_bar"] = pressure.tolist()
    return record, pressure


def test_a_stretch_with_its_windows_and_the_twin(client: TestClient) -> None:
    record_id = sent(client)
    whole = client.get(f"{API}/records/{record_id}/channels").json()
    windows = client.get(f"{API}/records/{record_id}/windows").json()["items"]
    assert whole["windows"] == windows
    part = client.get(f"{API}/records/{record_id}/channels?from=10&to=30.5").json()
    assert (part["start_s"], part["end_s"], part["samples"]) == (10.0, 30.0, 21)
    assert [w["kind"] for w in part["windows"]] == ["pump_off"]
    assert part["twin"] == []
    (window,) = [w for w in windows if w["kind"] == "zero_flow" and w["accepted"]]
    zero = next(w for w in windows if w["kind"] == "pump_off")["means"]
    offset = zero["case_pressure_bar"]["mean"] - zero["reservoir_pressure_bar"]["mean"]
    twin = {t["channel"]: t for t in whole["twin"]}
    for name, residual in window["residuals"].items():
        assert twin[name]["value"] == residual["twin"]
        assert (twin[name]["start_s"], twin[name]["end_s"]) == (window["start_s"], window["end_s"])
    case = twin["case_pressure_bar"]
    assert case["as_measured"] - case["value"] == pytest.approx(offset, abs=1e-3)
    assert twin["discharge_pressure_bar"]["as_measured"] == twin["discharge_pressure_bar"]["value"]


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
class TestChannels:
    def test_every_sample_is_there_where_there_are_few(self, client: TestClient) -> None:
        record, pressure = broken()
        record_id = sent(client, record)
        found = client.get(f"{API}/records/{record_id}/channels").json()
        shown = channel(found, "discharge_pressure_bar")
        assert (found["thinned"], found["samples"], shown["unit"], shown["missing"]) == (False, 160, "bar", 0)
        assert shown["time_s"] == record["channels"]["time_s"]
        assert shown["value"] == pressure.tolist()

    def test_thinning_loses_no_extreme(self, client: TestClient) -> None:
        record, pressure = broken()
        record_id = sent(client, record)
        for points in (4, 7, 20, 159):
            self.check_thinned(
                client.get(f"{API}/records/{record_id}/channels?points={points}").json(), points, pressure
            )

    @staticmethod
    def check_thinned(found: dict[str, Any], points: int, pressure: np.ndarray) -> None:
        shown = channel(found, "discharge_pressure_bar")
        assert found["thinned"] is True
        assert len(shown["value"]) <= points + 2
        assert shown["time_s"] == sorted(shown["time_s"])
        assert (min(shown["value"]), max(shown["value"])) == (pressure.min(), pressure.max())
        # what is shown was measured, at that time
        assert [pressure[round(t)] for t in shown["time_s"]] == shown["value"]
        borders = np.linspace(0.0, 159.0, max(points // 2, 1) + 1)
        for low, high in pairwise(borders):
            inside = pressure[int(np.ceil(low)) : int(np.ceil(high))]
            assert {inside.min(), inside.max()} <= set(shown["value"])

    def test_missing_samples_break_the_line(self, client: TestClient) -> None:
        record = document()
        flow: list[float | None] = [1.0] * 160
        flow[60:100] = [None] * 40
        record["channels"]["case_flow_lpm"] = flow
        record_id = sent(client, record)
        for points, holes in ((1000, 40), (40, 4)):
            shown = channel(client.get(f"{API}/records/{record_id}/channels?points={points}").json(), "case_flow_lpm")
            assert shown["missing"] == 40
            gaps = [t for t, v in zip(shown["time_s"], shown["value"], strict=True) if v is None]
            assert len(gaps) >= holes
            assert all(59.0 < t < 100.0 for t in gaps)

        for query, words in (
            ("from=30&to=30", "is not after from"),
            ("from=500", "goes from 0 to 159 s"),
            ("points=3", "greater than or equal to 4"),
            ("start_s=4", "is not a parameter of this call"),
        ):
            answer = client.get(f"{API}/records/{record_id}/channels?{query}")
            assert answer.status_code == 422, query
            assert words in answer.text


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
class TestPages:
    def test_the_list_says_what_each_added_or_why_not(self, client: TestClient) -> None:
        kept = sent(client)
        idle = document(shaft_speed_rpm=[0.0] * 160)
        useless = sent(client, {**idle, "flight_id": "F2", "started_at": "2026-05-03T07:11:00Z"})
        refused = client.post(f"{API}/records", content=body({"channels": {}}), headers=JSON)
        later = {**document(), "flight_id": "F3", "started_at": "soon", "aircraft": ""}
        waiting = client.post(f"{API}/records?wait=false", content=body(later), headers=JSON).json()["record_id"]
        page = client.get("/records").text
        assert f'href="/records/{kept}"' in page
        explanation = client.get(f"{API}/records/{useless}").json()["explanation"]
        assert f"Nothing: {explanation}." in page.replace("&#39;", "'")
        assert client.get(f"{API}/records/{waiting}").json()["status"] == "refused"
        faults = [*refused.json()["errors"], *client.get(f"{API}/records/{waiting}").json()["problem"]["errors"]]
        assert len(faults) > 8
        for fault in faults:
            assert f"<strong>{fault['where']}</strong>" in page
        (told,) = client.get(f"{API}/records/refusals").json()["items"]
        assert told["problem"] == refused.json()
        only = client.get("/records?status=refused").text
        assert waiting in only
        assert kept not in only
        assert kept in client.get("/records?pump=P-1&from=2026-05-02&to=2026-05-03").text
        assert useless not in client.get("/records?pump=P-1&from=2026-05-02&to=2026-05-03").text
        assert client.get("/records?status=lost").status_code == 422
        assert "<strong>from</strong> is not a time" in client.get("/records?from=spring").text

    def test_a_record_shows_its_channels_windows_and_faults(self, client: TestClient) -> None:
        record_id = sent(client)
        page = client.get(f"/records/{record_id}").text
        (svg,) = re.findall(r"<svg.*?</svg>", page, re.DOTALL)
        windows = client.get(f"{API}/records/{record_id}/windows").json()["items"]
        kinds = [w["kind"] if w["accepted"] else "rejected" for w in windows]
        panels = 4
        assert re.findall(r'<rect class="w (\w+)"', svg) == kinds * panels
        assert svg.count('class="twin"') == 2
        assert "case pressure (line), reservoir pressure (dashed) [bar]" in svg
        assert f'href="{API}/records/{record_id}/raw"' in page
        assert "sampled too slowly" in client.get(f"/records/{record_id}?spectrum=case_pressure_bar").text
        closer = client.get(f"/records/{record_id}?from=50&to=60").text
        assert "11 samples" in closer or "10 samples" in closer
        assert client.get(f"/records/{record_id}?from=60&to=50").status_code == 422
        assert client.get("/records/none").status_code == 404

    def test_a_fast_record_shows_its_orders(self, client: TestClient) -> None:
        record_id = sent(client, burst_document())
        page = client.get(f"/records/{record_id}?spectrum=discharge_pressure_bar").text
        assert page.count("<svg") == 2
        for order in client.get(f"{API}/records/{record_id}/spectrum?channel=discharge_pressure_bar").json()["orders"]:
            assert f"order {order['order']}" in page

    def test_without_its_bytes_a_record_still_says_what_was_found(self, client: TestClient) -> None:
        record_id = sent(client)
        context = client.app.state.context  # type: ignore[attr-defined]
        with context.database.reading() as session:
            digest = session.get_one(Record, record_id).content_hash
        context.raw_store.remove(digest)
        page = client.get(f"/records/{record_id}")
        assert page.status_code == 200
        assert "There is no picture" in page.text
        assert "zero flow" in page.text

    def test_a_record_is_withdrawn_with_a_reason(self, client: TestClient) -> None:
        record_id = sent(client)
        form = f"/records/{record_id}/withdraw"
        assert client.post(form, data={"reason": "wrong pump"}).status_code == 403
        assert "<strong>reason</strong>" in client.post(form, data={"reason": " "}, headers=ORIGIN).text
        done = client.post(form, data={"reason": "wrong <pump>"}, headers=ORIGIN)
        assert done.status_code == 200
        assert "wrong &lt;pump&gt;" in done.text
        assert json.loads(client.get(f"{API}/records/{record_id}").text)["status"] == "withdrawn"
