"""Answers of the API's document that no other test asks for: every one of them can happen, and looks as it is written."""

import json
import sys
from typing import Any

import pytest
from fastapi.testclient import TestClient

from service.api_document.document import openapi_document, operations
from service.tables import QUEUED, SUCCEEDED, Job, Record
from tests.service.guarded import guarded_client, key
from tests.service.records import body, document
from tests.service.test_jobs import archive

API = "/api/v1"
JSON, ZIP = {"content-type": "application/json"}, {"content-type": "application/zip"}


def upload(client: TestClient, **metadata: Any) -> str:
    content = json.dumps({**document(), **metadata}).encode()
    return str(client.post(f"{API}/records", content=content, headers=JSON).json()["record_id"])


def problem(answer: Any, status: int) -> dict[str, Any]:
    """The problem document of an answer, which is one of those that the API's document has for its call."""
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    found: dict[str, Any] = answer.json()
    assert (found["status"], bool(found["detail"])) == (status, True)
    return found


def test_an_address_that_cannot_be_stored_is_refused_everywhere(client: TestClient) -> None:
    asked = 0
    for method, path, operation in operations(openapi_document(client.app)):  # type: ignore[arg-type]
        if "422" not in operation["responses"]:
            continue
        named = "{" in path
        address = path.replace("{", "a%00").replace("}", "") if named else f"{path}?cursor=%00"
        found = problem(client.request(method, address), 422)
        assert [e["where"] for e in found["errors"]] == ["path" if named else "query"], (method, path)
        asked += 1
    assert asked > 70


def test_what_does_not_exist(client: TestClient) -> None:
    for path in ("exports/nothing.csv", "pump-types/nothing/reference-curve", "jobs/nothing/result"):
        problem(client.get(f"{API}/{path}"), 404)


def test_parquet_without_its_extra(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert "casedrain[parquet]" in problem(client.get(f"{API}/exports/trends.parquet"), 415)["detail"]


def test_previews_refuse_files_as_uploads_do(client: TestClient) -> None:
    mapping = {"name": "m", "channels": [{"source": "P", "channel": "discharge_pressure_bar", "unit": "psi"}]}
    assert client.post(f"{API}/mappings", json=mapping).status_code == 201
    url = f"{API}/mappings/preview?mapping=m"
    problem(client.post(url, content=b"{", headers=JSON), 400)
    problem(client.post(url, content=b"x", headers={"content-type": "application/pdf"}), 415)
    large = b"0" * (client.app.state.context.settings.max_upload_bytes + 1)  # type: ignore[attr-defined]
    problem(client.post(url, content=large, headers=JSON), 413)


def test_archives_that_cannot_be_taken(client: TestClient) -> None:
    url = f"{API}/records/bulk"
    content = archive({"a.json": body()})
    problem(client.post(f"{url}?mapping=nothing", content=content, headers=ZIP), 404)
    problem(client.post(f"{url}?mood=good&pump_serial=", content=b"", headers=ZIP), 422)


def test_a_document_is_there_when_its_job_has_ended(client: TestClient) -> None:
    upload(client)
    context = client.app.state.context  # type: ignore[attr-defined]
    job = client.post(f"{API}/jobs", json={"kind": "reprocess", "parameters": {"dry_run": True}}).json()["id"]
    with context.database.writing() as session:
        session.get_one(Job, job).status = QUEUED
    assert "queued" in problem(client.get(f"{API}/jobs/{job}/result"), 409)["detail"]
    with context.database.writing() as session:
        row = session.get_one(Job, job)
        row.status = SUCCEEDED
        row.result = {"files": {"html": {"content_hash": "0" * 64, "bytes": 1}}}
    problem(client.get(f"{API}/jobs/{job}/result"), 503)
    assert "there is html" in problem(client.get(f"{API}/jobs/{job}/result?format=json"), 404)["detail"]


def test_what_must_be_read_again_and_is_gone(client: TestClient) -> None:
    record = upload(client)
    context = client.app.state.context  # type: ignore[attr-defined]
    with context.database.reading() as session:
        assert context.raw_store.remove(session.get_one(Record, record).content_hash)
    problem(client.get(f"{API}/records/{record}/raw"), 503)
    problem(client.get(f"{API}/records/{record}/spectrum?channel=discharge_pressure_bar"), 503)
    # windows depend on the pump type: they would have to be found anew
    before = client.get(f"{API}/pumps/P-1").json()
    problem(client.patch(f"{API}/pumps/P-1", json={"pump_type": "h225_thesis"}), 503)
    assert client.get(f"{API}/pumps/P-1").json() == before


def test_another_operator_s_mapping_is_nobody_s_business(database_url: str, tmp_path: Any) -> None:
    with guarded_client(database_url, tmp_path) as guarded:
        viewer = key(guarded, "viewer", "north")
        url = f"{API}/mappings/preview?mapping=m&operator=south"
        problem(guarded.post(url, content=body(), headers={**JSON, **viewer}), 403)
        problem(guarded.get(f"{API}/mappings/m?operator=south", headers=viewer), 403)
