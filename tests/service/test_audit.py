"""The audit log: what is in it, who sees it, how it is asked."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from service.access.audit_proof import verify
from tests.service.guarded import guarded_client, key
from tests.service.records import body

AUDIT = "/api/v1/audit"
JSON = {"content-type": "application/json"}


@pytest.fixture
def guarded(database_url: str, tmp_path: Path) -> Iterator[TestClient]:
    with guarded_client(database_url, tmp_path) as running:
        yield running


@pytest.fixture
def root(guarded: TestClient) -> dict[str, str]:
    """An admin of all operators, after a few changes in each."""
    admin = key(guarded, "admin", owner="root")
    for operator in ("north", "south"):
        analyst = key(guarded, "analyst", operator, owner=f"ann of {operator}")
        assert guarded.post("/api/v1/records", content=body(), headers={**JSON, **analyst}).status_code == 201
        made = {"owner": "office", "role": "viewer", "operator": operator}
        assert guarded.post("/api/v1/keys", json=made, headers=admin).status_code == 201
    fleet = {"values": {"alarm_records": 4}, "reason": "x"}
    guarded.put("/api/v1/thresholds/fleet/default", json=fleet, headers={**admin, "If-Match": "*"})
    return admin


def test_an_operators_admin_sees_its_own_only(guarded: TestClient, root: dict[str, str]) -> None:
    everything = guarded.get(AUDIT, headers=root).json()["items"]
    assert [(e["action"], e["operator"]) for e in everything] == [
        ("thresholds.put", None),
        ("key.make", "south"),
        ("record.upload", "south"),
        ("key.make", "north"),
        ("record.upload", "north"),
    ]
    north = guarded.get(AUDIT, headers=key(guarded, "admin", "north"))
    assert [(e["action"], e["operator"]) for e in north.json()["items"]] == [
        ("key.make", "north"),
        ("record.upload", "north"),
    ]
    assert "south" not in north.text
    asked = guarded.get(AUDIT, params={"operator": "south"}, headers=key(guarded, "admin", "north"))
    assert asked.json()["items"] == []


def test_filters_and_pages(guarded: TestClient, root: dict[str, str]) -> None:
    def items(**params: str) -> list[str]:
        return [e["action"] for e in guarded.get(AUDIT, params=params, headers=root).json()["items"]]

    assert items(action="key.make") == items(action="key") == ["key.make"] * 2
    assert items(action="ke") == []
    assert items(action="%") == []
    assert items(actor="ann of north") == ["record.upload"]
    assert items(subject="thresholds/fleet/default") == ["thresholds.put"]
    assert items(operator="south") == ["key.make", "record.upload"]
    assert items(**{"from": "2126-01-01T00:00:00Z"}) == []
    assert len(items(to="2126-01-01T00:00:00Z")) == 5
    seen: list[str] = []
    cursor = None
    while True:
        params = {"limit": "2", **({"cursor": cursor} if cursor else {})}
        page = guarded.get(AUDIT, params=params, headers=root).json()
        seen += [f"{e['at']} {e['subject']}" for e in page["items"]]
        cursor = page["next"]
        if cursor is None:
            break
    assert seen == sorted(seen, reverse=True)
    assert len(set(seen)) == 5
    naive = guarded.get(AUDIT, params={"from": "2026-01-01T00:00:00"}, headers=root)
    assert naive.status_code == 422


def test_a_refused_or_repeated_change_leaves_no_entry(guarded: TestClient, root: dict[str, str]) -> None:
    before = guarded.get(AUDIT, headers=root).json()["items"]
    analyst = key(guarded, "analyst", "north")
    guarded.post("/api/v1/records", content=body(), headers={**JSON, **analyst})
    guarded.post("/api/v1/records", content=b"{}", headers={**JSON, **analyst})
    guarded.post("/api/v1/keys", json={"owner": "x", "role": "king"}, headers=root)
    stale = {"values": {"alarm_records": 5}, "reason": "x"}
    guarded.put("/api/v1/thresholds/fleet/default", json=stale, headers={**root, "If-Match": '"9"'})
    assert guarded.get(AUDIT, headers=root).json()["items"] == before


@pytest.mark.parametrize("role", ["viewer", "analyst", "engineer"])
def test_only_admins_read_it(guarded: TestClient, role: str) -> None:
    assert guarded.get(AUDIT).status_code == 401
    assert guarded.get(AUDIT, headers=key(guarded, role)).status_code == 403


def test_the_export_proves_the_log_and_shows_an_operator_its_own(guarded: TestClient, root: dict[str, str]) -> None:
    for headers, withheld in ((root, 0), (key(guarded, "admin", "north"), 3)):
        answer = guarded.get(f"{AUDIT}/export", headers=headers)
        assert answer.status_code == 200
        assert answer.headers["content-type"].startswith("application/x-ndjson")
        found = verify([json.loads(line) for line in answer.text.splitlines()], None)
        assert (found.faults, found.links, found.withheld) == ([], 5, withheld)
        assert ("south" in answer.text) == (withheld == 0)
