"""Keys with scopes: each does what it names, within its role, and gives nothing away that it has not."""

from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from service.access.scopes import SCOPES, scope_of
from service.access.security import new_key
from tests.service.guarded import guarded_client
from tests.service.matrix import API, MATRIX, OPEN, PAGE, seeded, sent
from tests.service.records import body

JSON = {"content-type": "application/json"}


def scoped(client: TestClient, *scopes: str, role: str = "admin", operator: str | None = "north") -> dict[str, str]:
    database = client.app.state.context.database  # type: ignore[attr-defined]
    with database.writing() as session:
        _, text = new_key(session, "scoped", role, operator, None, scopes or None)
    return {"Authorization": f"Bearer {text}"}


def test_every_call_has_one_scope() -> None:
    found = {route: scope_of(route[0], route[1].removeprefix(API)) for route in MATRIX if route[1].startswith(API)}
    assert set(found.values()) == set(SCOPES)
    for (method, path), scope in found.items():
        if scope == "read":
            assert method == "GET" or path.startswith(f"{API}/twin/"), path
        if MATRIX[method, path].role == "admin":
            assert scope == "admin", (method, path)
    assert found["POST", f"{API}/records"] == found["POST", f"{API}/records/bulk"] == "upload"
    assert found["DELETE", f"{API}/records/{{record_id}}"] == "maintain"
    assert scope_of("PUT", "/something/new") == "maintain"


@pytest.fixture(autouse=True)
def _resolver(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.notifications.guard._resolved", lambda *_: ["93.184.215.14"])


@pytest.mark.postgres_in_study
def test_a_key_does_what_it_is_for_and_nothing_else(database_url: str, tmp_path: Path) -> None:
    with guarded_client(database_url, tmp_path) as client:
        ids = seeded(client, "north", "P-1")
        keys = {scope: scoped(client, scope, operator=None) for scope in SCOPES}
        for (method, path), entry in MATRIX.items():
            if not path.startswith(API) or entry.role in (OPEN, PAGE):
                continue
            own = scope_of(method, path.removeprefix(API))
            for scope, headers in keys.items():
                if scope == own:
                    continue  # the other tests call with rights
                answer = sent(client, method, entry, ids, **headers)
                assert answer.status_code == 403, (method, path, scope)
                assert f"scope {own}" in answer.json()["detail"]


def test_scopes_stay_below_the_role(database_url: str, tmp_path: Path) -> None:
    with guarded_client(database_url, tmp_path) as client:
        recorder = {**scoped(client, "upload", role="analyst"), **JSON}
        answer = client.post(f"{API}/records", content=body(), headers=recorder)
        assert answer.status_code == 201
        assert client.get(f"{API}/records/{answer.json()['record_id']}", headers=recorder).status_code == 403
        viewer = {**scoped(client, "upload", "maintain", role="viewer"), **JSON}
        assert client.post(f"{API}/records", content=body(), headers=viewer).status_code == 403
        both = scoped(client, "read", "upload", role="analyst")
        assert len(client.get(f"{API}/records", headers=both).json()["items"]) == 1


def test_nobody_gives_away_what_they_have_not(database_url: str, tmp_path: Path) -> None:
    with guarded_client(database_url, tmp_path) as client:
        some = scoped(client, "admin", "read")
        wanted: dict[str, Any] = {"owner": "x", "role": "admin"}
        for scopes in (None, ["upload"], ["read", "maintain"]):
            answer = client.post(f"{API}/keys", json={**wanted, "scopes": scopes}, headers=some)
            assert answer.status_code == 403, scopes
        made = client.post(f"{API}/keys", json={**wanted, "scopes": ["read"]}, headers=some)
        assert (made.status_code, made.json()["scopes"]) == (201, ["read"])
        for wrong in ([], ["fly"], ["read"] * 5):
            assert client.post(f"{API}/keys", json={**wanted, "scopes": wrong}, headers=some).status_code == 422
        whole = client.post(f"{API}/keys", json=wanted, headers=scoped(client)).json()
        assert whole["scopes"] is None


def test_the_pages_are_not_opened_by_a_key_for_single_calls(database_url: str, tmp_path: Path) -> None:
    with guarded_client(database_url, tmp_path) as client:
        for headers, status in ((scoped(client, "read"), 401), (scoped(client), 303)):
            client.get("/sign-in")
            form = {"csrf_token": client.cookies["casedrain_sign_in"], "key": headers["Authorization"].split()[1]}
            assert client.post("/sign-in", data=form, follow_redirects=False).status_code == status


@pytest.mark.parametrize("scopes", [[], ["fly"]])
def test_the_command_line_refuses_the_same(scopes: list[str]) -> None:
    with pytest.raises(ValueError, match="no scope"):
        new_key(None, "x", "viewer", None, None, scopes)  # type: ignore[arg-type]
