"""Sign-in by an OpenID provider: state, nonce, PKCE, audience, signature, one use; and passwords beside it."""

import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from unittest import mock
from urllib.parse import parse_qs, urlsplit

import pytest
from fastapi.testclient import TestClient
from joserfc.jwk import RSAKey
from sqlalchemy import update

from service.settings import Settings
from service.storage.tables import PendingSignIn
from tests.service.guarded import guarded_client, key
from tests.service.issuer import CLIENT_ID, CLIENT_SECRET, FakeIssuer

API = "/api/v1"
CALLBACK = "/sign-in/oidc/callback"


@pytest.fixture
def issuer() -> Iterator[FakeIssuer]:
    made = FakeIssuer()
    yield made
    made.close()


@pytest.fixture
def client(database_url: str, tmp_path: Path, issuer: FakeIssuer) -> Iterator[TestClient]:
    settings = {"oidc_issuer": issuer.url, "oidc_client_id": CLIENT_ID, "oidc_client_secret": CLIENT_SECRET}
    with guarded_client(database_url, tmp_path, oidc_name="North Helicopters", **settings) as running:
        user = {"name": "j.dupont", "role": "analyst", "operator": "north", "oidc_subject": "sub-7"}
        assert running.post(f"{API}/users", json=user, headers=key(running, "admin")).status_code == 201
        yield running


def away(client: TestClient, wanted: str = "/records") -> str:
    answer = client.get(f"/sign-in/oidc?next={wanted}", follow_redirects=False)
    assert answer.status_code == 303
    return answer.headers["location"]


def back(client: TestClient, **parameters: str) -> Any:
    return client.get(CALLBACK, params=parameters, follow_redirects=False)


def signed_in(client: TestClient) -> bool:
    return client.get(f"{API}/records").status_code == 200


def test_somebody_who_is_linked_comes_in_where_they_wanted(client: TestClient, issuer: FakeIssuer) -> None:
    assert "Sign in with North Helicopters" in client.get("/sign-in").text
    answer = back(client, **issuer.allow(away(client), "sub-7"))
    assert (answer.status_code, answer.headers["location"]) == (303, "/records")
    assert signed_in(client)
    entries = client.get(f"{API}/audit", headers=key(client, "admin")).json()["items"]
    assert ("session.start", "j.dupont", "north") in [(e["action"], e["actor"], e["operator"]) for e in entries]


def test_an_answer_counts_once_and_in_its_browser_only(client: TestClient, issuer: FakeIssuer) -> None:
    given = issuer.allow(away(client), "sub-7")
    browser = client.cookies["casedrain_oidc"]
    client.cookies.clear()
    assert back(client, **given).status_code == 401  # another browser was made to follow the link
    assert not signed_in(client)
    client.cookies.clear()
    client.cookies.set("casedrain_oidc", browser)
    assert back(client, **given).status_code == 401  # and that has used the state up
    client.cookies.clear()
    good = issuer.allow(away(client), "sub-7")
    browser = client.cookies["casedrain_oidc"]
    assert back(client, **good).status_code == 303
    client.cookies.clear()
    client.cookies.set("casedrain_oidc", browser)
    assert back(client, **good).status_code == 401
    assert not signed_in(client)


def test_a_code_of_another_sign_in_is_not_taken(client: TestClient, issuer: FakeIssuer) -> None:
    stolen = issuer.allow(away(client), "sub-7")["code"]
    address = away(client)
    mine = {k: v[0] for k, v in parse_qs(urlsplit(address).query).items()}
    answer = back(client, code=stolen, state=mine["state"])  # PKCE: this browser's verifier is another one's
    assert answer.status_code == 401
    assert "invalid_grant" in answer.text
    assert not signed_in(client)


FOREIGN: list[dict[str, Any]] = [
    {"nonce": "another"},
    {"nonce": None},
    {"aud": "another-service"},
    {"aud": [CLIENT_ID, "another"], "azp": "another"},
    {"iss": "http://evil.example"},
    {"exp": int(time.time()) - 3600},
    {"exp": None},
    {"sub": None},
    {"sub": ""},
    {"sub": 7},
]


def test_tokens_for_somebody_else_open_nothing(client: TestClient, issuer: FakeIssuer) -> None:
    for claims in FOREIGN:
        issuer.claims = claims
        with mock.patch("service.web.dashboard.oidc.check_pace"):  # so many failures would be slowed down
            assert back(client, **issuer.allow(away(client), "sub-7")).status_code == 401, claims
        assert not signed_in(client), claims


def test_tokens_that_the_issuer_did_not_sign_open_nothing(client: TestClient, issuer: FakeIssuer) -> None:
    issuer.signs_with = RSAKey.generate_key(2048, {"kid": "k1"}, auto_kid=False)
    assert back(client, **issuer.allow(away(client), "sub-7")).status_code == 401
    issuer.signs_as_the_public_key = True
    assert back(client, **issuer.allow(away(client), "sub-7")).status_code == 401
    assert not signed_in(client)


def test_who_is_not_linked_or_lost_access_stays_out(client: TestClient, issuer: FakeIssuer) -> None:
    answer = back(client, **issuer.allow(away(client), "sub-8"))
    assert answer.status_code == 401
    assert "an admin links it" in answer.text
    admin = key(client, "admin")
    assert client.patch(f"{API}/users/j.dupont", json={"disabled": True}, headers=admin).status_code == 200
    assert back(client, **issuer.allow(away(client), "sub-7")).status_code == 401
    assert back(client, error="access_denied", state="x").status_code == 401
    again = {"disabled": False, "oidc_subject": None}
    client.patch(f"{API}/users/j.dupont", json=again, headers=admin)
    assert back(client, **issuer.allow(away(client), "sub-7")).status_code == 401


def test_an_issuer_that_is_away_leaves_passwords(client: TestClient, issuer: FakeIssuer) -> None:
    issuer.is_away = True
    answer = client.get("/sign-in/oidc", follow_redirects=False)
    assert answer.status_code == 503
    assert "use a password" in answer.text
    issuer.is_away = False
    given = issuer.allow(away(client), "sub-7")
    issuer.is_away = True
    assert back(client, **given).status_code == 503
    assert not signed_in(client)


def test_a_sign_in_that_took_too_long_is_over(client: TestClient, issuer: FakeIssuer) -> None:
    given = issuer.allow(away(client), "sub-7")
    database = client.app.state.context.database  # type: ignore[attr-defined]
    with database.writing() as session:
        session.execute(update(PendingSignIn).values(expires_at=datetime(2020, 1, 1, tzinfo=UTC)))
    assert back(client, **given).status_code == 401
    assert "example" not in away(client, "https://evil.example").split("redirect_uri")[0]


def test_links_are_given_by_who_sees_everybody(client: TestClient) -> None:
    north, everybody = key(client, "admin", "north"), key(client, "admin")
    linked = {"name": "x", "role": "viewer", "oidc_subject": "sub-9"}
    assert client.post(f"{API}/users", json=linked, headers=north).status_code == 403
    assert client.patch(f"{API}/users/j.dupont", json={"oidc_subject": "s"}, headers=north).status_code == 403
    assert client.post(f"{API}/users", json={**linked, "oidc_subject": "sub-7"}, headers=everybody).status_code == 409
    assert client.post(f"{API}/users", json={"name": "y", "role": "viewer"}, headers=everybody).status_code == 422
    assert [u["oidc_subject"] for u in client.get(f"{API}/users", headers=north).json()["items"]] == ["sub-7"]


def test_without_an_issuer_there_is_no_such_page(database_url: str, tmp_path: Path) -> None:
    with guarded_client(database_url, tmp_path) as running:
        assert running.get("/sign-in/oidc").status_code == 404
        assert running.get(CALLBACK).status_code == 404
        assert "oidc" not in running.get("/sign-in").text


def test_settings_go_together() -> None:
    for wrong in (
        {"oidc_issuer": "https://id.example"},
        {"oidc_client_id": "casedrain"},
        {"oidc_issuer": "http://id.example", "oidc_client_id": "casedrain"},
    ):
        with pytest.raises(ValueError, match="CASEDRAIN_OIDC"):
            Settings(_env_file=None, **wrong)  # type: ignore[call-arg, arg-type]


def test_who_fails_on_purpose_keeps_nobody_else_out(client: TestClient, issuer: FakeIssuer) -> None:
    answers = [back(client, code="x", state="x").status_code for _ in range(8)]
    assert answers[0] == 401
    assert answers[-1] == 429  # slowed down
    client._transport.client = ("192.0.2.7", 50000)  # type: ignore[attr-defined]
    assert back(client, **issuer.allow(away(client), "sub-7")).status_code == 303
