"""Fixtures for both databases: a file for SQLite, a cluster of our own for Postgres."""

import itertools
import os
import shutil
import warnings
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import pytest
import structlog

from service.storage.database import upgrade
from tests.fast_selection import mark_fast
from tests.postgres import Emptied, binary, cluster, create_database
from tests.study_selection import mark_studies

KINDS = ["sqlite", "postgres"]
_numbers = itertools.count(1)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    mark_studies(items)
    mark_fast(items)


@pytest.fixture(scope="session")
def postgres_cluster() -> Iterator[str]:
    """URL pattern of a running cluster; skips loudly, or fails where REQUIRE_POSTGRES is set, without binaries."""
    if binary("initdb") is None or binary("postgres") is None:
        reason = "POSTGRES-SKIPPED: initdb and postgres are not installed"
        if os.environ.get("REQUIRE_POSTGRES"):
            pytest.fail(reason)
        warnings.warn(reason, pytest.PytestWarning, stacklevel=1)
        pytest.skip(reason)
    with cluster() as url:
        yield url


@pytest.fixture(scope="session")
def migrated_sqlite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file with all migrations and no rows: tests get copies."""
    file = tmp_path_factory.mktemp("migrated") / "empty.sqlite"
    upgrade(f"sqlite:///{file}")
    return file


@pytest.fixture(scope="session")
def migrated_postgres(postgres_cluster: str) -> str:
    """Name of a database with all migrations and no rows: tests get copies."""
    name = "migrated"
    upgrade(create_database(postgres_cluster, name))
    return name


@pytest.fixture(scope="session")
def new_database(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], str]:
    """Makes a fresh, migrated database of a kind and gives its URL: for fixtures that live longer than one test."""

    def made(kind: str) -> str:
        if kind == "sqlite":
            file = tmp_path_factory.mktemp("database") / "test.sqlite"
            shutil.copyfile(request.getfixturevalue("migrated_sqlite"), file)
            return f"sqlite:///{file}"
        cluster_url = request.getfixturevalue("postgres_cluster")
        return create_database(cluster_url, f"t{next(_numbers)}", request.getfixturevalue("migrated_postgres"))

    return made


@pytest.fixture(scope="session")
def lent_postgres(new_database: Callable[[str], str]) -> Callable[[], AbstractContextManager[str]]:
    """Lends a migrated Postgres database for one test; what a test has left as it can be is emptied for the next."""
    emptied = Emptied(new_database("postgres"))
    free: list[str] = []

    @contextmanager
    def lent() -> Iterator[str]:
        url = free.pop() if free else new_database("postgres")
        yield url
        if emptied.again(url):
            free.append(url)

    return lent


@pytest.fixture(params=KINDS)
def database_url(request: pytest.FixtureRequest, new_database: Callable[[str], str]) -> Iterator[str]:
    """A migrated database of each kind without rows, the test's own while it runs."""
    if request.param == "sqlite":
        yield new_database("sqlite")
    else:
        with request.getfixturevalue("lent_postgres")() as url:
            yield url


# the default renderer draws tracebacks with every local variable: half a minute for one that reaches the twin
structlog.configure(processors=[structlog.processors.format_exc_info, structlog.processors.KeyValueRenderer()])
