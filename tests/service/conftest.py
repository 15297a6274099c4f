"""An application at work on either database, and flight records to send."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal
from unittest import mock

import pytest
from argon2 import PasswordHasher
from fastapi.testclient import TestClient

from service.access import users
from service.demo.fleet import PUMPS, DemoRecord, pump_records
from service.settings import Settings
from service.web.answer_route import Checking
from tests.conftest import KINDS
from tests.service import lent_application
from tests.service.kept_histories import KeptHistories
from tests.service.lent_application import lent

REAL_HASHER = users._hasher

Checking.is_on = True
WORN = next(p for p in PUMPS if "worn" in p.truth.words)
HEALTHY = PUMPS[0]


@pytest.fixture
def settings(database_url: str, tmp_path: Path) -> Settings:
    return Settings(database_url=database_url, data_dir=tmp_path / "data", auth="off", max_upload_bytes=2_000_000)


@pytest.fixture(scope="session")
def new_settings(
    new_database: Callable[[str], str], tmp_path_factory: pytest.TempPathFactory
) -> Callable[..., Settings]:
    """Settings of a service on a fresh database of a kind: for fixtures that live longer than one test."""

    def made(kind: str, auth: Literal["on", "off"] = "off") -> Settings:
        folder = tmp_path_factory.mktemp("data")
        return Settings(database_url=new_database(kind), data_dir=folder, auth=auth, max_upload_bytes=2_000_000)

    return made


@pytest.fixture
def client(settings: Settings) -> Iterator[TestClient]:
    with lent(settings) as running:
        yield running


@pytest.fixture(scope="session", autouse=True)
def _lent_applications_end() -> Iterator[None]:
    yield
    lent_application.close()


@pytest.fixture(scope="session", autouse=True)
def _passwords_cost_little() -> Iterator[None]:
    """A hash of a password is slow by intention, a third of a second of processor; test_sign_in looks at the real one."""
    quick = PasswordHasher(time_cost=1, memory_cost=8, parallelism=1)
    nobody = quick.hash("nobody has this password")
    with mock.patch.object(users, "_hasher", quick), mock.patch.object(users, "_NOBODY", nobody):
        yield


@pytest.fixture(scope="session")
def worn_records() -> list[DemoRecord]:
    """Flights of the demo's worn pump, few enough to be quick."""
    return list(pump_records(WORN, 24, seed=1))


@pytest.fixture(scope="session")
def healthy_records() -> list[DemoRecord]:
    return list(pump_records(HEALTHY, 12, seed=1))


@pytest.fixture(scope="session")
def kept_histories(request: pytest.FixtureRequest, new_settings: Callable[..., Settings]) -> KeptHistories:
    return KeptHistories(new_settings, lambda: str(request.getfixturevalue("postgres_cluster")))


@pytest.fixture(params=KINDS)
def worn_settings(
    request: pytest.FixtureRequest, kept_histories: KeptHistories, worn_records: list[DemoRecord], tmp_path: Path
) -> Settings:
    """Settings of a service of each kind to which ``worn_records`` have been uploaded."""
    return kept_histories.copied(request.param, worn_records, tmp_path)


@pytest.fixture
def worn_client(worn_settings: Settings) -> Iterator[TestClient]:
    """A client of a service to which ``worn_records`` have been uploaded."""
    with lent(worn_settings) as running:
        yield running


@pytest.fixture(params=KINDS)
def healthy_client(
    request: pytest.FixtureRequest, kept_histories: KeptHistories, healthy_records: list[DemoRecord], tmp_path: Path
) -> Iterator[TestClient]:
    """A client of a service to which ``healthy_records`` have been uploaded."""
    with lent(kept_histories.copied(request.param, healthy_records, tmp_path)) as running:
        yield running
