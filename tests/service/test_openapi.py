"""The API's description: committed, complete, shown without any script."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from service.web.api_document.document import operations
from tests.openapi_document import DOCUMENT, document_text
from tests.service.matrix import MATRIX, OPEN, PAGE

COMMITTED: dict[str, Any] = json.loads(DOCUMENT.read_text(encoding="utf-8"))
OPERATIONS = [(m, p, o) for m, p, o in operations(COMMITTED)]
IDS = [f"{m} {p}" for m, p, _ in OPERATIONS]


def test_it_does_not_change_unnoticed() -> None:
    assert document_text() == DOCUMENT.read_text(encoding="utf-8"), "run `python tests/openapi_document.py` and commit"


def test_every_call_is_in_it() -> None:
    # forms and what stands around them; pages are known by their role
    hidden = {r for r, entry in MATRIX.items() if entry.role == OPEN and r[0] == "POST"}
    hidden |= {("GET", "/docs"), ("GET", "/openapi.json"), ("GET", "/sign-in")}
    hidden |= {("GET", "/sign-in/oidc"), ("GET", "/sign-in/oidc/callback")}
    expected = {route for route, entry in MATRIX.items() if entry.role != PAGE} - hidden
    assert {(m, p) for m, p, _ in OPERATIONS} == expected


@pytest.mark.parametrize(("method", "path", "operation"), OPERATIONS, ids=IDS)
def test_a_call_is_complete(method: str, path: str, operation: dict[str, Any]) -> None:
    assert operation["summary"]
    assert operation["description"]
    assert operation["tags"]
    shared = COMMITTED["components"]["responses"]
    problems = {
        s: shared[r["$ref"].rpartition("/")[2]] if "$ref" in r else r
        for s, r in operation["responses"].items()
        if int(s) >= 400
    }
    for status, response in problems.items():
        content = response["content"]["application/problem+json"]
        assert content["schema"] == {"$ref": "#/components/schemas/Problem"}
        assert content["example"]["status"] == int(status)
    if path.startswith("/api/"):
        assert operation["security"] == [{"key": []}]
        assert {"401", "500"} <= set(problems)
        # one of a few names in the path: another one is refused, not missed
        assert ("404" in problems) or "{" not in path or path.endswith("{kind}.csv")
    (good, *_) = [r for s, r in sorted(operation["responses"].items()) if s.startswith("2")]
    for kind, content in good.get("content", {}).items():
        assert kind != "application/json" or content.get("example")
    for content in operation.get("requestBody", {}).get("content", {}).values():
        for option in (content.get("schema") or {}).get("anyOf", [content.get("schema") or {}]):
            name = option.get("$ref", "").rpartition("/")[2]
            if name:
                assert COMMITTED["components"]["schemas"][name].get("examples"), name


def test_every_reference_leads_somewhere() -> None:
    for name in re.findall(r'"#/components/schemas/([^"]+)"', json.dumps(COMMITTED)):
        assert name in COMMITTED["components"]["schemas"]


def test_the_page_shows_every_call_without_scripts(client: TestClient) -> None:
    page = client.get("/docs")
    assert page.status_code == 200
    assert "<script" not in page.text
    assert "style=" not in page.text
    assert "http://" not in page.text.replace("http://www.w3.org/", "").replace("http://127.0.0.1", "")
    assert "default-src 'none'" in page.headers["content-security-policy"]
    for method, path, _ in OPERATIONS:
        assert f"{method} {path}" in page.text
    assert set(re.findall(r'href="#([^"]+)"', page.text)) - {"main"} == {o["operationId"] for _, _, o in OPERATIONS}
    assert client.get("/redoc").status_code == 404


def test_the_examples_ship_with_the_package() -> None:
    text = (Path(__file__).parents[2] / "service" / "web" / "api_document" / "examples.json").read_text(
        encoding="utf-8"
    )
    assert json.loads(text)
    assert not re.search(r"cd_[\w-]{40}|whsec_[\w+/=]{20}", text), "no example may hold what looks like a secret"
