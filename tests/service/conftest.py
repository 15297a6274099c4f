"""A running application on either database, and flight records to send."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from service.demo.fleet import PUMPS, DemoRecord, pump_records
from service.settings import Settings
from service.web.app import create_app

WORN = next(p for p in PUMPS if "worn" in p.truth.words)
HEALTHY = PUMPS[0]


@pytest.fixture
def settings(database_url: str, tmp_path: Path) -> Settings:
    return Settings(database_url=database_url, data_dir=tmp_path / "data", auth="off", max_upload_bytes=2_000_000)


@pytest.fixture
def client(settings: Settings) -> Iterator[TestClient]:
    with TestClient(create_app(settings), raise_server_exceptions=False) as running:
        yield running


@pytest.fixture(scope="session")
def worn_records() -> list[DemoRecord]:
    """Flights of the demo's worn pump, few enough to be quick."""
    return list(pump_records(WORN, 24, seed=1))


@pytest.fixture(scope="session")
def healthy_records() -> list[DemoRecord]:
    return list(pump_records(HEALTHY, 12, seed=1))
