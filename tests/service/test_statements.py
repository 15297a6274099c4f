"""How many statements an upload costs the database: they, not the physics, are most of its time."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from fastapi.testclient import TestClient
from sqlalchemy import Engine, event

from tests.service.records import document

MOST = 16
"""Fifteen on SQLite; on Postgres one more locks the head of the audit chain."""


@contextmanager
def statements() -> Iterator[list[str]]:
    """Statements of all engines while the block runs."""
    found: list[str] = []

    def note(_connection: Any, _cursor: Any, statement: str, *_rest: Any) -> None:
        if not statement.startswith("BEGIN"):
            found.append(statement)

    event.listen(Engine, "before_cursor_execute", note)
    try:
        yield found
    finally:
        event.remove(Engine, "before_cursor_execute", note)


def flight(n: int) -> bytes:
    return json.dumps({**document(), "flight_id": f"F{n}", "started_at": f"2026-05-{n + 1:02d}T07:11:00Z"}).encode()


def test_what_an_upload_costs_the_database(client: TestClient) -> None:
    for n in range(5):
        with statements() as found:
            answer = client.post("/api/v1/records", content=flight(n), headers={"content-type": "application/json"})
        assert answer.status_code == 201, answer.text
    assert sum("FROM threshold_versions" in text for text in found) <= 2
    assert len(found) <= MOST, f"{len(found)} statements: " + "; ".join(" ".join(text.split())[:70] for text in found)
