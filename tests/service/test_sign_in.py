"""Users, sessions, keys: who comes in, for how long, and how they are kept out."""

import re
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select, update
from typer.testing import CliRunner

from service.command_line.main import app
from service.storage.tables import ApiKey, FailedSignIn, SignedIn, User
from tests.service.conftest import REAL_HASHER
from tests.service.guarded import guarded_client, key

PASSWORD = "a long enough sentence"


@pytest.fixture
def guarded(database_url: str, tmp_path: Path) -> Iterator[TestClient]:
    with guarded_client(database_url, tmp_path) as running:
        yield running


@pytest.fixture
def admin(guarded: TestClient) -> dict[str, str]:
    return key(guarded, "admin", owner="root")


@pytest.fixture
def ann(guarded: TestClient, admin: dict[str, str]) -> str:
    make(guarded, admin, "ann")
    return "ann"


def make(client: TestClient, who: dict[str, str], name: str, **more: Any) -> Any:
    return client.post(
        "/api/v1/users", json={"name": name, "password": PASSWORD, "role": "viewer", **more}, headers=who
    )


def csrf(text: str) -> str:
    found = re.search(r'name="csrf_token" value="([^"]+)"', text)
    assert found
    return found[1]


def sign_in(client: TestClient, **fields: str) -> Any:
    client.cookies.clear()
    token = csrf(client.get("/sign-in").text)
    return client.post("/sign-in", data={"csrf_token": token, **fields}, follow_redirects=False)


def database(client: TestClient) -> Any:
    return client.app.state.context.database  # type: ignore[attr-defined]


class TestSessions:
    def test_in_and_out(self, guarded: TestClient, ann: str) -> None:
        assert guarded.get("/", follow_redirects=False).headers["location"] == "/sign-in"
        answer = sign_in(guarded, name=ann, password=PASSWORD)
        assert answer.status_code == 303
        cookie = answer.headers["set-cookie"].lower()
        assert "httponly" in cookie
        assert "samesite=lax" in cookie
        page = guarded.get("/")
        assert page.status_code == 200
        assert "ann" in page.text
        token = guarded.cookies["casedrain_session"]
        assert guarded.post("/sign-out", data={"csrf_token": csrf(page.text)}).url.path == "/sign-in"
        guarded.cookies.set("casedrain_session", token)
        assert guarded.get("/", follow_redirects=False).status_code == 303, "the server has ended it, too"

    def test_the_cookie_needs_an_encrypted_way_but_on_this_machine(self, guarded: TestClient, ann: str) -> None:
        assert "secure" not in sign_in(guarded, name=ann, password=PASSWORD).headers["set-cookie"].lower()
        away = TestClient(guarded.app, base_url="https://casedrain.example.org")
        assert "secure" in sign_in(away, name=ann, password=PASSWORD).headers["set-cookie"].lower()

    def test_neither_token_nor_password_is_stored(self, guarded: TestClient, ann: str) -> None:
        sign_in(guarded, name=ann, password=PASSWORD)
        token = guarded.cookies["casedrain_session"]
        with database(guarded).reading() as session:
            assert session.scalars(select(SignedIn.token_hash)).one() != token
            assert session.scalars(select(User.password_hash)).one().startswith("$argon2id$")

    def test_forms_need_the_token_of_the_session(self, guarded: TestClient, ann: str) -> None:
        sign_in(guarded, name=ann, password=PASSWORD)
        for token in ("", "guess"):
            assert guarded.post("/sign-out", data={"csrf_token": token}).status_code == 403
        assert guarded.get("/").status_code == 200
        fresh = TestClient(guarded.app, base_url="http://localhost")
        assert fresh.post("/sign-in", data={"name": ann, "password": PASSWORD}).status_code == 403

    def test_the_cookie_reads_and_never_writes(self, guarded: TestClient, admin: dict[str, str]) -> None:
        make(guarded, admin, "boss", role="admin")
        sign_in(guarded, name="boss", password=PASSWORD)
        assert guarded.get("/api/v1/keys").status_code == 200
        assert guarded.post("/api/v1/keys", json={"owner": "x", "role": "viewer"}).status_code == 401

    def test_time_ends_a_session(self, guarded: TestClient, ann: str) -> None:
        long_ago = datetime.now(UTC) - timedelta(minutes=121)
        for change in ({"expires_at": datetime.now(UTC)}, {"last_used_at": long_ago}):
            sign_in(guarded, name=ann, password=PASSWORD)
            assert guarded.get("/", follow_redirects=False).status_code == 200
            with database(guarded).writing() as session:
                session.execute(update(SignedIn).values(**change))
            assert guarded.get("/", follow_redirects=False).status_code == 303

    @pytest.mark.parametrize("how", ["disabled", "password", "signed out"])
    def test_an_admin_ends_sessions(self, guarded: TestClient, admin: dict[str, str], ann: str, how: str) -> None:
        sign_in(guarded, name=ann, password=PASSWORD)
        assert guarded.get("/", follow_redirects=False).status_code == 200
        if how == "signed out":
            assert guarded.delete(f"/api/v1/users/{ann}/sessions", headers=admin).json() == {"ended": 1}
        else:
            body = {"disabled": True} if how == "disabled" else {"password": "another long sentence"}
            assert guarded.patch(f"/api/v1/users/{ann}", json=body, headers=admin).status_code == 200
        assert guarded.get("/", follow_redirects=False).status_code == 303
        again = sign_in(guarded, name=ann, password=PASSWORD).status_code
        assert again == (303 if how == "signed out" else 401)

    def test_a_key_starts_a_session_too_and_its_end_ends_it(self, guarded: TestClient, admin: dict[str, str]) -> None:
        made = guarded.post("/api/v1/keys", json={"owner": "office", "role": "viewer"}, headers=admin).json()
        assert sign_in(guarded, key="wrong").status_code == 401
        assert sign_in(guarded, key=made["key"]).status_code == 303
        assert made["key"] not in guarded.cookies["casedrain_session"]
        assert guarded.get("/", follow_redirects=False).status_code == 200
        guarded.delete(f"/api/v1/keys/{made['id']}", headers=admin)
        assert guarded.get("/", follow_redirects=False).status_code == 303
        assert sign_in(guarded, key=made["key"]).status_code == 401

    def test_a_user_sees_its_own_operator(self, guarded: TestClient, admin: dict[str, str]) -> None:
        make(guarded, admin, "norma", operator="north", role="admin")
        make(guarded, admin, "sue", operator="south")
        sign_in(guarded, name="norma", password=PASSWORD)
        assert [u["name"] for u in guarded.get("/api/v1/users").json()["items"]] == ["norma"]


def test_a_guess_costs_what_rfc_9106_asks() -> None:
    """Its second recommended option: three passes over 64 MiB in four lanes."""
    assert (REAL_HASHER.time_cost, REAL_HASHER.memory_cost, REAL_HASHER.parallelism) == (3, 65536, 4)
    assert REAL_HASHER.hash("any").startswith("$argon2id$v=19$m=65536,t=3,p=4$")


class TestGuessing:
    def test_five_failures_and_a_pause(self, guarded: TestClient, ann: str) -> None:
        for _ in range(5):
            assert sign_in(guarded, name=ann, password="wrong").status_code == 401
        answer = sign_in(guarded, name=ann, password=PASSWORD)
        assert answer.status_code == 429
        assert 0 < int(answer.headers["retry-after"]) <= 901
        with database(guarded).writing() as session:
            session.execute(update(FailedSignIn).values(at=datetime.now(UTC) - timedelta(minutes=16)))
        assert sign_in(guarded, name=ann, password=PASSWORD).status_code == 303

    def test_success_forgets_failures(self, guarded: TestClient, ann: str) -> None:
        for _ in range(2):
            for _ in range(4):
                sign_in(guarded, name=ann, password="wrong")
            assert sign_in(guarded, name=ann, password=PASSWORD).status_code == 303

    def test_an_unknown_name_sounds_like_a_wrong_password(self, guarded: TestClient, ann: str) -> None:
        texts = [sign_in(guarded, name=name, password="wrong").text for name in (ann, "nobody")]
        assert csrf(texts[0]) != csrf(texts[1])
        same = [re.sub(r'value="[^"]+"', "", text) for text in texts]
        assert same[0] == same[1]

    def test_many_names_from_one_place_are_slowed_down(self, guarded: TestClient, ann: str) -> None:
        now = datetime.now(UTC)
        with database(guarded).writing() as session:
            session.add_all(FailedSignIn(name_hash=f"{i}", address="testclient", at=now) for i in range(50))
        assert sign_in(guarded, name=ann, password=PASSWORD).status_code == 429


class TestUsers:
    def test_every_fault_is_named(self, guarded: TestClient, admin: dict[str, str]) -> None:
        body = {"name": " x", "password": "short", "role": "viewer", "wants_mail": True}
        answer = guarded.post("/api/v1/users", json=body, headers=admin)
        assert answer.status_code == 422
        assert {e["where"] for e in answer.json()["errors"]} == {"name", "password", "wants_mail"}
        assert "short" not in answer.text.replace("shorter", "")
        unknown = guarded.post("/api/v1/users", json={**body, "role": "king", "mood": 1}, headers=admin)
        assert {e["where"] for e in unknown.json()["errors"]} == {"body.role", "body.mood"}
        assert guarded.get("/api/v1/users", headers=admin).json()["items"] == []

    @pytest.mark.parametrize("email", ["x", "a@b@c", "a b@c", "a@b,c@d", "a@b\n"])
    def test_one_address_only(self, guarded: TestClient, admin: dict[str, str], email: str) -> None:
        assert make(guarded, admin, "ann", email=email).status_code == 422

    def test_names_are_unique(self, guarded: TestClient, admin: dict[str, str], ann: str) -> None:
        assert make(guarded, admin, ann).status_code == 409

    def test_change(self, guarded: TestClient, admin: dict[str, str], ann: str) -> None:
        body = {"role": "engineer", "email": "ann@example.org", "wants_mail": True}
        changed = guarded.patch(f"/api/v1/users/{ann}", json=body, headers=admin).json()
        assert {k: changed[k] for k in body} == body
        for bad in ({"email": None}, {"password": "short"}, {"role": "king"}, {"name": "bob"}):
            assert guarded.patch(f"/api/v1/users/{ann}", json=bad, headers=admin).status_code == 422
        assert guarded.patch("/api/v1/users/nobody", json={}, headers=admin).status_code == 404
        assert PASSWORD not in guarded.get("/api/v1/audit", headers=admin).text
        assert "password" not in changed

    def test_an_operators_admin_stays_at_home(self, guarded: TestClient, admin: dict[str, str], ann: str) -> None:
        north = key(guarded, "admin", "north")
        assert make(guarded, north, "norma").json()["operator"] == "north"
        assert make(guarded, north, "sue", operator="south").status_code == 403
        assert guarded.patch(f"/api/v1/users/{ann}", json={"role": "admin"}, headers=north).status_code == 404
        assert guarded.delete(f"/api/v1/users/{ann}/sessions", headers=north).status_code == 404

    def test_from_the_command_line(self, database_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("CASEDRAIN_DATABASE_URL", database_url)
        monkeypatch.setenv("CASEDRAIN_DATA_DIR", str(tmp_path / "data"))
        typed = f"{PASSWORD}\n{PASSWORD}\n"
        done = CliRunner().invoke(app, ["users", "create", "boss", "--role", "admin"], input=typed)
        assert done.exit_code == 0, done.output
        assert PASSWORD not in done.output
        wrong = CliRunner().invoke(app, ["users", "create", "boss", "--role", "king"], input="x\nx\n")
        assert wrong.exit_code == 1
        with guarded_client(database_url, tmp_path) as client:
            assert sign_in(client, name="boss", password=PASSWORD).status_code == 303
            audit = client.get("/api/v1/audit").json()["items"]
        assert [(e["actor"], e["action"]) for e in audit] == [("boss", "session.start"), ("command line", "user.make")]


class TestKeys:
    def test_a_key_expires(self, guarded: TestClient, admin: dict[str, str]) -> None:
        soon = (datetime.now(UTC) + timedelta(hours=1)).isoformat()
        body = {"owner": "office", "role": "viewer", "expires_at": soon}
        made = guarded.post("/api/v1/keys", json=body, headers=admin).json()
        who = {"Authorization": f"Bearer {made['key']}"}
        assert guarded.get("/api/v1/pumps", headers=who).status_code == 200
        with database(guarded).writing() as session:
            session.execute(update(ApiKey).where(ApiKey.id == made["id"]).values(expires_at=datetime.now(UTC)))
        answer = guarded.get("/api/v1/pumps", headers=who)
        assert answer.status_code == 401
        assert "expired" in answer.json()["detail"]

    def test_last_used_is_noted(self, guarded: TestClient, admin: dict[str, str]) -> None:
        made = guarded.post("/api/v1/keys", json={"owner": "office", "role": "viewer"}, headers=admin).json()
        assert made["last_used_at"] is None
        guarded.get("/api/v1/pumps", headers={"Authorization": f"Bearer {made['key']}"})
        items = guarded.get("/api/v1/keys", headers=admin).json()["items"]
        assert next(k for k in items if k["id"] == made["id"])["last_used_at"] is not None

    def test_revoked_is_revoked(self, guarded: TestClient, admin: dict[str, str]) -> None:
        made = guarded.post("/api/v1/keys", json={"owner": "office", "role": "viewer"}, headers=admin).json()
        url = f"/api/v1/keys/{made['id']}"
        assert guarded.delete(url, headers=key(guarded, "admin", "north")).status_code == 404
        assert guarded.delete(url, headers=key(guarded, "engineer")).status_code == 403
        assert guarded.delete(url, headers=admin).status_code == 204
        assert guarded.delete(url, headers=admin).status_code == 204
        answer = guarded.get("/api/v1/pumps", headers={"Authorization": f"Bearer {made['key']}"})
        assert answer.status_code == 401
        assert "revoked" in answer.json()["detail"]
        actions = [e["action"] for e in guarded.get("/api/v1/audit", headers=admin).json()["items"]]
        assert actions == ["key.revoke", "key.make"]


@pytest.mark.parametrize("path", ["keys", "users", "webhooks"])
def test_lists_are_paged(
    guarded: TestClient, admin: dict[str, str], monkeypatch: pytest.MonkeyPatch, path: str
) -> None:
    monkeypatch.setattr("service.notifications.guard._resolved", lambda *_: ["93.184.215.14"])
    for i in range(5):
        make(guarded, admin, f"user-{i}")
        guarded.post("/api/v1/keys", json={"owner": f"o{i}", "role": "viewer"}, headers=admin)
        guarded.post("/api/v1/webhooks", json={"url": f"https://hooks.test/{i}"}, headers=admin)
    url = f"/api/v1/{path}"
    everything = guarded.get(url, headers=admin).json()
    assert everything["next"] is None
    seen: list[Any] = []
    cursor = None
    while True:
        params = {"limit": 2, **({"cursor": cursor} if cursor else {})}
        page = guarded.get(url, params=params, headers=admin).json()
        seen += page["items"]
        cursor = page["next"]
        if cursor is None:
            break
    assert seen == everything["items"]
    assert len(seen) == (6 if path == "keys" else 5)
