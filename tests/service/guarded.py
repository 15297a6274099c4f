"""A service with keys: clients and headers for each role and operator."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fastapi.testclient import TestClient

from service.access.security import new_key
from service.settings import Settings
from tests.service.lent_application import lent


@contextmanager
def guarded_client(database_url: str, folder: Path, **settings: Any) -> Iterator[TestClient]:
    """A running service that asks for keys; the client speaks to it as a browser on the same machine would."""
    made = Settings(database_url=database_url, data_dir=folder / "data", auth="on", **settings)
    with lent(made, base_url="http://localhost") as running:
        yield running


def key(client: TestClient, role: str, operator: str | None = None, owner: str | None = None) -> dict[str, str]:
    """Headers with a new key."""
    database = client.app.state.context.database  # type: ignore[attr-defined]
    with database.writing() as session:
        _, text = new_key(session, owner or f"{operator} {role}", role, operator, None)
    return {"Authorization": f"Bearer {text}"}
