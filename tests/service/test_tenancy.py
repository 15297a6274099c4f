"""Walks every route with every role and with another operator's key: nothing is done, shown, counted or hinted at."""

import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from service.access.security import ROLES
from service.settings import Settings
from service.web.app import create_app
from tests.service.guarded import guarded_client, key
from tests.service.matrix import ENDING, MATRIX, OPEN, PAGE, routes_of, seeded, sent

ROUTES = sorted(MATRIX, key=lambda route: (route == ENDING, route[0] == "DELETE", route))
WRITES = [route for route in ROUTES if route[0] != "GET" and route[1].startswith("/api/") and route != ENDING]
NO_CHANGE = ("/twin/", "/thresholds/preview", "/mappings/preview", "/mappings/suggest")


@pytest.fixture(autouse=True)
def _nothing_runs_beside(monkeypatch: pytest.MonkeyPatch) -> None:
    """No message leaves, and jobs wait: what a request does is what can be seen right after it."""
    monkeypatch.setattr("service.jobs.engine.start", lambda *_, **__: None)
    monkeypatch.setattr("service.jobs.engine.stop", lambda: None)
    monkeypatch.setattr("service.notifications.guard._resolved", lambda *_: ["93.184.215.14"])
    monkeypatch.setattr("service.notifications.webhook_call.call", lambda *_: None)


@contextmanager
def signed_in(client: TestClient, role: str, operator: str) -> Iterator[TestClient]:
    """A browser with a session of its own, started by a key of that role."""
    browser = TestClient(client.app, base_url="http://localhost", raise_server_exceptions=False)
    token = re.findall(r'name="csrf_token" value="([^"]+)"', browser.get("/sign-in").text)[0]
    text = key(client, role, operator)["Authorization"].removeprefix("Bearer ")
    form = {"csrf_token": token, "key": text}
    assert browser.post("/sign-in", data=form, follow_redirects=False).status_code == 303
    yield browser


def test_every_route_has_an_entry() -> None:
    assert set(routes_of(create_app(Settings(auth="on")))) == set(MATRIX)


WITH_CHARTS = {("GET", "/pumps/{serial}"), ("GET", "/records/{record_id}")}


class TestRoles:
    @pytest.mark.parametrize("role", [None, *ROLES])
    @pytest.mark.postgres_in_study
    def test_who_may(self, database_url: str, tmp_path: Path, role: str | None) -> None:
        with guarded_client(database_url, tmp_path) as client:
            names = seeded(client, "north", "NORTH-1")
            headers = {} if role is None else key(client, role, "north")
            wrong = []
            for method, path in ROUTES:
                entry = MATRIX[method, path]
                if entry.role in (OPEN, PAGE):
                    continue
                status = sent(client, method, entry, names, **headers).status_code
                allowed = role is not None and ROLES.index(role) >= ROLES.index(entry.role)
                expected = 401 if role is None else 403
                if ((status not in (401, 403, 500)) if not allowed else status in (401, 403, 500)) or (
                    not allowed and status != expected
                ):
                    wrong.append((method, path, status))
            assert wrong == []

    @pytest.mark.postgres_in_study
    def test_pages_ask_for_a_session_of_their_role(self, database_url: str, tmp_path: Path) -> None:
        pages = [route for route in ROUTES if MATRIX[route].role == PAGE]
        with guarded_client(database_url, tmp_path) as client:
            names = seeded(client, "north", "NORTH-1")
            for route in pages:
                answer = sent(client, route[0], MATRIX[route], names)
                assert (answer.status_code, answer.headers["location"].partition("?")[0]) == (303, "/sign-in"), route
            for role in ROLES:
                with signed_in(client, role, "north") as browser:
                    seen = {route: sent(browser, route[0], MATRIX[route], names) for route in pages}
                statuses = {route: answer.status_code for route, answer in seen.items()}
                may = {route: ROLES.index(role) >= ROLES.index(MATRIX[route].page_role) for route in pages}
                assert statuses == {route: 200 if may[route] else 403 for route in pages}
                made = {".svg": "image/svg+xml", ".pdf": "application/pdf"}
                pictures = [route for route in pages if route[1][-4:] in made and may[route]]
                found = {(route[1][-4:], seen[route].headers["content-type"]) for route in pictures}
                assert found == set(made.items())
                for route, answer in seen.items():
                    if route in pictures:
                        continue
                    assert "text/html" in answer.headers["content-type"], route
                    # nothing runs but the one file of our own, where there are charts
                    text = answer.text
                    if may[route] and route in WITH_CHARTS:
                        text = text.replace('<script src="/static/chart.js" defer></script>', "", 1)
                    assert "<script" not in text, route
                    assert "style=" not in answer.text, route
                titles = [
                    re.findall(r"<title>([^<]+)</title>", seen[route].text)[0]
                    for route in pages
                    if may[route] and route not in pictures
                ]
                assert len(set(titles)) == len(titles)

    @pytest.mark.postgres_in_study
    def test_what_is_open_holds_no_data(self, database_url: str, tmp_path: Path) -> None:
        with guarded_client(database_url, tmp_path) as client:
            names = seeded(client, "aquilo", "AQ-4711")
            told = [text for name, text in names.items() if name != "version"]
            for method, path in ROUTES:
                if MATRIX[method, path].role == OPEN:
                    text = sent(client, method, MATRIX[method, path], names).text.lower()
                    assert [t for t in told if t.lower() in text] == [], path

    @pytest.mark.postgres_in_study
    def test_every_change_leaves_an_entry_in_the_audit_log(self, database_url: str, tmp_path: Path) -> None:
        with guarded_client(database_url, tmp_path) as client:
            names = seeded(client, "north", "NORTH-1")
            admin = key(client, "admin", "north")
            silent = []
            for method, path in WRITES:
                before = len(client.get("/api/v1/audit?limit=500", headers=admin).json()["items"])
                status = sent(client, method, MATRIX[method, path], names, **admin).status_code
                after = len(client.get("/api/v1/audit?limit=500", headers=admin).json()["items"])
                grown = status < 300 and not any(part in path for part in NO_CHANGE)
                if after - before != grown:
                    silent.append((method, path, status, after - before))
            assert silent == []

    def test_the_end_of_an_operator_is_known_to_who_sees_everybody(self, database_url: str, tmp_path: Path) -> None:
        with guarded_client(database_url, tmp_path) as client:
            names = seeded(client, "north", "NORTH-1")
            assert sent(client, ENDING[0], MATRIX[ENDING], names, **key(client, "admin", "north")).status_code == 200
            (entry,) = client.get("/api/v1/audit", headers=key(client, "admin")).json()["items"]
        assert (entry["action"], entry["subject"], entry["operator"]) == ("operator.delete", "operator/north", None)
        assert entry["details"]["reason"] == "contract ended"


class TestOperators:
    """An operator's answers are the same whether or not another operator has data beside it."""

    @staticmethod
    def answers(client: TestClient, foreign: dict[str, str]) -> dict[tuple[str, str], tuple[int, str]]:
        """What the southern admin hears when it asks for everything, with the northern names."""
        south = key(client, "admin", "south")
        found = {}
        with signed_in(client, "admin", "south") as browser:
            for method, path in ROUTES:
                entry = MATRIX[method, path]
                if entry.role == OPEN:
                    continue
                asker, headers = (browser, {}) if entry.role == PAGE else (client, south)
                answer = sent(asker, method, entry, foreign, **headers)
                found[method, path] = (answer.status_code, normal(answer.text, foreign))
        return found

    @pytest.mark.postgres_in_study
    def test_nothing_of_the_other_is_seen_or_done(self, database_url: str, tmp_path: Path) -> None:
        with guarded_client(database_url, tmp_path / "both") as client:
            north = seeded(client, "north", "NORTH-1")
            seeded(client, "south", "SOUTH-1")
            admin = key(client, "admin", "north")
            before = everything(client, admin)
            beside = self.answers(client, north)
            assert everything(client, admin) == before
            for kind in ("aircraft", "installations"):
                told = client.get(f"/api/v1/registry/{kind}.csv", headers=key(client, "viewer", "south")).text
                assert "SOUTH" in told.upper(), kind
                assert "NORTH" not in told.upper(), kind
        for route, (status, text) in beside.items():
            expected = 404 if MATRIX[route].named else 422 if MATRIX[route].refused else None
            assert status == expected if expected else status < 300, (route, status)
            # Australia/North is a zone, and nobody's
            told = re.sub(r'<option value="[\w/+-]+">', "", text) if route == ("GET", "/preferences") else text
            assert "north" not in told.lower(), route
        with guarded_client(f"sqlite:///{tmp_path / 'alone.sqlite'}", tmp_path / "alone") as client:
            seeded(client, "south", "SOUTH-1")
            alone = self.answers(client, north)
        # the proof of the log runs over everybody's salted hashes: how many there are shows, what they stand for does not
        proof = ("GET", "/api/v1/audit/export")
        different = [route for route in beside if beside[route] != alone[route] and route != proof]
        assert different == [], [(beside[r], alone[r]) for r in different]


def everything(client: TestClient, who: dict[str, str]) -> dict[str, Any]:
    """All that the northern admin sees of its own, but the times of use of keys."""
    paths = (
        "records",
        "pumps",
        "alarms",
        "mappings",
        "jobs",
        "aircraft",
        "keys",
        "users",
        "webhooks",
        "audit",
        "thresholds/operator/north",
    )
    found = {path: client.get(f"/api/v1/{path}", headers=who).json() for path in paths}
    for item in found["keys"]["items"]:
        item.pop("last_used_at")
    return found


def normal(text: str, names: dict[str, str]) -> str:
    """A text without what differs from run to run, and without the names that the request brought along."""
    if text.startswith("{") and "\n" not in text.strip():
        text = json.dumps(json.loads(text), sort_keys=True)
    for name, value in names.items():
        if name != "version":
            text = text.replace(value, f"<{name}>")
    text = re.sub(r"\bcd_[\w-]{20,}|whsec_[\w+/=]+|[0-9a-f]{32}|20\d\d-\d\d-\d\dT[0-9:.]+Z", "*", text)
    text = re.sub(r'name="csrf_token" value="[^"]+"', "", text)
    # the pages' own way to write instants and ids
    text = re.sub(r"<code>[0-9a-f]{8}</code>", "*", text)
    text = re.sub(r"\d\d \w{3} 20\d\d(?: \d\d:\d\d)?|20\d\d-\d\d-\d\dT\d\d:\d\d", "*", text)
    # versions of thresholds are numbered by one counter for the whole service
    return re.sub(r'"(version|effective_version|threshold_version)": \d+|version:? \d+', "version", text)
