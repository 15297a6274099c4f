"""The verdict does not depend on how records arrived: order, repetition, concurrency."""

import random
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest
from fastapi.testclient import TestClient

from service.demo.fleet import DemoRecord
from service.settings import Settings
from tests.service.lent_application import lent

CSV = {"content-type": "text/csv"}


def upload(client: TestClient, record: DemoRecord) -> int:
    return client.post("/api/v1/records", content=record.content, headers=CSV).status_code


def everything(client: TestClient, serial: str) -> dict[str, Any]:
    """All that the pump's history says, without ids that name the place of storage."""
    pump = f"/api/v1/pumps/{serial}"
    return {
        "verdict": client.get(f"{pump}/verdict").json(),
        "changes": client.get(f"{pump}/verdicts").json(),
        "trend": client.get(f"{pump}/trend", params={"metric": "case_residual_bar"}).json(),
    }


@pytest.fixture(scope="module")
def ordered(worn_records: list[DemoRecord], new_settings: Callable[..., Settings]) -> dict[str, Any]:
    """What ordered uploads give, on SQLite."""
    with lent(new_settings("sqlite")) as client:
        for record in worn_records:
            assert upload(client, record) == 201
        return everything(client, worn_records[0].pump.serial)


def test_the_worn_pump_is_found_on_its_side(ordered: dict[str, Any]) -> None:
    verdict = ordered["verdict"]
    assert verdict["state"] in ("pump_degradation", "indeterminate")
    if verdict["state"] == "indeterminate":
        assert "pump_degradation" in verdict["candidates"]
    assert verdict["quality"]["records_used"] == 24


def test_shuffled_and_repeated_uploads_give_the_same(
    client: TestClient, worn_records: list[DemoRecord], ordered: dict[str, Any]
) -> None:
    shuffled = [*worn_records, *worn_records[::3]]
    random.Random(5).shuffle(shuffled)
    statuses = [upload(client, record) for record in shuffled]
    assert statuses.count(201) == len(worn_records)
    assert statuses.count(200) == len(shuffled) - len(worn_records)
    assert everything(client, worn_records[0].pump.serial) == ordered


def test_concurrent_uploads_lose_nothing(
    client: TestClient, worn_records: list[DemoRecord], healthy_records: list[DemoRecord], ordered: dict[str, Any]
) -> None:
    mixed = [*worn_records, *healthy_records, *worn_records[:4]]
    random.Random(6).shuffle(mixed)
    with ThreadPoolExecutor(6) as pool:
        statuses = list(pool.map(lambda record: upload(client, record), mixed))
    assert set(statuses) <= {200, 201}
    assert everything(client, worn_records[0].pump.serial) == ordered
    assert client.get(f"/api/v1/pumps/{healthy_records[0].pump.serial}").json()["records"] == len(healthy_records)


def test_verdict_at_an_event_time_is_what_it_was_then(client: TestClient, worn_records: list[DemoRecord]) -> None:
    early, late = worn_records[:10], worn_records[10:14]
    for record in early:
        upload(client, record)
    pump = f"/api/v1/pumps/{worn_records[0].pump.serial}"
    then = client.get(f"{pump}/verdict").json()
    for record in late:
        upload(client, record)
    at = early[-1].started_at.isoformat().replace("+00:00", "Z")
    assert client.get(f"{pump}/verdict", params={"at": at}).json() == then
    assert client.get(f"{pump}/verdict", params={"at": "2020-01-01T00:00:00Z"}).json()["state"] == "insufficient_data"
