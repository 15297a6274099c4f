"""The frame of the pages: the way through the sign-in, problems as pages, parameters that no page knows."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from service.web.dashboard.links import address, local_address
from tests.service.guarded import guarded_client, key
from tests.service.histories import write_history
from tests.service.matrix import API, MATRIX, OPEN, filled, seeded
from tests.service.test_page_forms import come_in
from tests.service.test_sign_in import PASSWORD, csrf, make

BROWSER = {"accept": "text/html,application/xhtml+xml"}


@pytest.fixture
def guarded(database_url: str, tmp_path: Path) -> Iterator[TestClient]:
    with guarded_client(database_url, tmp_path) as running:
        with running.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
            write_history(session, "hhi")
        yield running


def test_the_sign_in_leads_on_to_the_page_that_was_asked_for(guarded: TestClient) -> None:
    assert make(guarded, key(guarded, "admin"), "ann", role="analyst", operator="north").status_code == 201
    asked = guarded.get("/?page=2", follow_redirects=False)
    assert asked.status_code == 303
    page = guarded.get(asked.headers["location"])
    assert page.url.path == "/sign-in"
    wanted = re.findall(r'name="next" value="([^"]+)"', page.text)[0]
    wrong = {"csrf_token": csrf(page.text), "next": wanted, "name": "ann", "password": "not this one, no"}
    again = guarded.post("/sign-in", data=wrong)
    assert again.status_code == 401
    assert re.findall(r'name="next" value="([^"]+)"', again.text)[0] == wanted
    form = {**wrong, "csrf_token": csrf(again.text), "password": PASSWORD}
    come = guarded.post("/sign-in", data=form, follow_redirects=False)
    assert (come.status_code, come.headers["location"]) == (303, "/?page=2")
    assert guarded.get(come.headers["location"]).status_code == 200


def test_a_name_with_a_slash_leads_through_the_sign_in(guarded: TestClient) -> None:
    asked = guarded.get("/pumps/SN%2F1?operator=north", follow_redirects=False)
    assert asked.status_code == 303
    page = guarded.get(asked.headers["location"])
    wanted = re.findall(r'name="next" value="([^"]+)"', page.text)[0]
    assert wanted.replace("&amp;", "&") == "/pumps/SN%2F1?operator=north"


@pytest.mark.parametrize(
    "wanted",
    [
        "https://evil.example/",
        "//evil.example",
        "/\\evil.example",
        "/a\\b",
        "javascript:alert(1)",
        "",
        "/a\nb",
        "pumps",
    ],
)
def test_the_sign_in_leads_to_no_other_site(wanted: str) -> None:
    assert local_address(wanted) == "/"


def test_addresses_quote_what_they_are_made_of() -> None:
    assert address("pumps", "a/b c", query={"operator": "x&y", "none": None}) == "/pumps/a%2Fb%20c?operator=x%26y"
    assert local_address("/pumps/a%2Fb?x=1#here") == "/pumps/a%2Fb?x=1#here"


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_a_wrong_page_is_a_page_where_a_browser_asks(client: TestClient) -> None:
    for path in ("/nonsense", "/pumps/nobody", "/static/nothing.css"):
        page = client.get(path, headers=BROWSER)
        assert (page.status_code, page.headers["content-type"]) == (404, "text/html; charset=utf-8"), path
        assert "<h1>Not" in page.text
        assert 'href="/"' in page.text
        assert "default-src 'none'" in page.headers["content-security-policy"]
    assert client.put("/", headers=BROWSER).status_code == 405
    assert client.get("/nonsense").headers["content-type"] == "application/problem+json"
    for path in ("/api/v1/pumps/nobody", "/api/v1/nonsense"):
        assert client.get(path, headers=BROWSER).headers["content-type"] == "application/problem+json"


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_a_page_refuses_parameters_that_it_does_not_know(client: TestClient) -> None:
    for path in ("/?pages=2&speed=1", "/sign-in?speed=1"):
        page = client.get(path)
        assert page.status_code == 422, path
        assert "<strong>speed</strong> is not a parameter of this call" in page.text
    page = client.get("/?page=one")
    assert page.status_code == 422
    assert "<strong>page</strong>" in page.text


FORMS = [
    route for route, entry in MATRIX.items() if entry.role == OPEN and route[0] == "POST" and "sign" not in route[1]
]


def test_every_form_needs_a_session_and_its_token(
    database_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("service.notifications.guard._resolved", lambda *_: ["93.184.215.14"])
    monkeypatch.setattr("service.jobs.engine.start", lambda *_, **__: None)
    with guarded_client(database_url, tmp_path) as client:
        names = seeded(client, "north", "NORTH-1")
        urls = [filled(MATRIX[route].url, names) for route in FORMS]
        assert len(urls) > 25
        for url in urls:
            answer = client.post(url, data={"csrf_token": ""}, follow_redirects=False)
            assert (answer.status_code, answer.headers["location"]) == (303, "/sign-in"), url
        admin = key(client, "admin", "north")
        log = f"{API}/audit?limit=500"
        come_in(client, "ada", "admin", "north")
        before = client.get(log, headers=admin).json()["items"]
        for url in urls:
            for token in ("", "guess"):
                page = client.post(url, data={"csrf_token": token, "reason": "x"})
                assert page.status_code == 403, url
                assert "does not belong to this session" in page.text
        assert client.get(log, headers=admin).json()["items"] == before


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_without_sessions_every_form_must_come_from_these_pages(client: TestClient) -> None:
    for route in FORMS:
        url = re.sub(r"\{\w+\}", "x", route[1])
        for headers in ({}, {"origin": "https://evil.example"}, {"origin": "null"}):
            assert client.post(url, data={"reason": "x"}, headers=headers).status_code == 403, url
