"""Exports say what the API says, as CSV and as Parquet, within one operator."""

import csv
import io
from typing import Any

import pyarrow.parquet as pq
import pytest
from fastapi.testclient import TestClient

from service.demo.fleet import DemoRecord
from service.reading import exports
from service.settings import Settings
from tests.service.lent_application import lent
from tests.service.test_jobs import API


@pytest.fixture
def loaded(client: TestClient, worn_records: list[DemoRecord], monkeypatch: pytest.MonkeyPatch) -> TestClient:
    monkeypatch.setattr(exports, "_PAGE", 2)  # several pages of a small history
    for record in worn_records[:5]:
        answer = client.post(f"{API}/records", content=record.content, headers={"content-type": "text/csv"})
        assert answer.status_code == 201
    return client


def rows(client: TestClient, name: str, **params: str) -> list[dict[str, str]]:
    answer = client.get(f"{API}/exports/{name}.csv", params=params)
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("text/csv")
    return list(csv.DictReader(io.StringIO(answer.text)))


def table(client: TestClient, name: str) -> list[dict[str, Any]]:
    answer = client.get(f"{API}/exports/{name}.parquet")
    assert answer.status_code == 200
    found: list[dict[str, Any]] = pq.read_table(io.BytesIO(answer.content)).to_pylist()
    return found


def test_trends_are_those_of_the_api(loaded: TestClient) -> None:
    serial = loaded.get(f"{API}/pumps").json()["items"][0]["serial"]
    shown = loaded.get(f"{API}/pumps/{serial}/trend", params={"metric": "case_residual_bar"}).json()["items"]
    exported = [r for r in rows(loaded, "trends") if r["metric"] == "case_residual_bar"]
    assert [(r["record_id"], float(r["value"])) for r in exported] == [(i["record_id"], i["value"]) for i in shown]
    assert {r["unit"] for r in exported} == {"bar"}
    binary = [r for r in table(loaded, "trends") if r["metric"] == "case_residual_bar"]
    assert [r["value"] for r in binary] == [i["value"] for i in shown]


def test_verdicts_and_windows_are_complete_and_ordered(loaded: TestClient) -> None:
    verdicts = table(loaded, "verdicts")
    assert len(verdicts) == 5
    assert [v["at"] for v in verdicts] == sorted(v["at"] for v in verdicts)
    windows = table(loaded, "windows")
    for record_id in {v["record_id"] for v in verdicts}:
        shown = loaded.get(f"{API}/records/{record_id}/windows").json()["items"]
        mine = [w for w in windows if w["record_id"] == record_id]
        assert [(w["kind"], w["start_s"], w["accepted"]) for w in mine] == [
            (w["kind"], w["start_s"], w["accepted"]) for w in shown
        ]
        assert [w["mean_case_pressure_bar"] for w in mine] == [
            w["means"].get("case_pressure_bar", {}).get("mean") for w in shown
        ]


def test_filters_are_half_open_and_need_a_zone(loaded: TestClient) -> None:
    at = [r["at"] for r in rows(loaded, "verdicts")]
    assert [r["at"] for r in rows(loaded, "verdicts", **{"from": at[1], "to": at[3]})] == at[1:3]
    assert rows(loaded, "verdicts", pump="none") == []
    assert loaded.get(f"{API}/exports/verdicts.csv", params={"from": "2026-01-01T00:00:00"}).status_code == 422
    for name in ("nothing.csv", "trends.xlsx"):
        assert loaded.get(f"{API}/exports/{name}").status_code == 404


def test_exports_stay_within_the_operator(settings: Settings, worn_records: list[DemoRecord]) -> None:
    from service.access.security import new_key

    with lent(settings.model_copy(update={"auth": "on"})) as client:
        keys = {}
        with client.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
            for operator in ("north", "south"):
                keys[operator] = {"authorization": f"Bearer {new_key(session, operator, 'analyst', operator, None)[1]}"}
        headers = {"content-type": "text/csv", **keys["north"]}
        assert client.post(f"{API}/records", content=worn_records[0].content, headers=headers).status_code == 201
        for name in ("trends", "verdicts", "windows"):
            url = f"{API}/exports/{name}.csv"
            assert len(client.get(url, headers=keys["south"]).text.splitlines()) == 1
            assert len(client.get(url, headers=keys["north"]).text.splitlines()) > 1 or name == "trends"
            assert client.get(url).status_code == 401
