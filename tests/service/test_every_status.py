"""Answers of the API's document that no other test asks for: every one of them can happen, and looks as it is written."""

import json
import sys
from typing import Any

import pytest
from fastapi.testclient import TestClient

from service.ingest.mappings import latest_mapping
from service.registry.ownership import owned_tables
from service.storage.tables import QUEUED, SUCCEEDED, Job, Record
from service.web.api_document.document import openapi_document, operations
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


def test_what_moves_a_record_needs_its_bytes(client: TestClient) -> None:
    """Another circuit means another twin: the record has to be read again. What fails so changes nothing."""
    record = upload(client)
    apart = {"aircraft": "F-APART", "circuit": "separate_drain"}
    assert client.post(f"{API}/aircraft", json=apart).status_code == 201
    entries = f"{API}/pumps/P-1/installations"
    early = {"aircraft": "F-APART", "position": "LH", "from": "2020-01-01T00:00:00Z"}
    always = client.post(entries, json=early).json()["id"]
    late = {**early, "from": "2041-01-01T00:00:00Z"}
    assert client.patch(f"{entries}/{always}", json={"to": "2040-01-01T00:00:00Z"}).status_code == 200
    later = client.post(entries, json=late).json()["id"]
    _lose(client, record)
    place = client.get(f"{API}/records/{record}").json()["aircraft"]
    before = client.get(entries).json()
    problem(client.delete(f"{entries}/{always}"), 503)
    problem(client.patch(f"{entries}/{always}", json={"to": "2020-02-01T00:00:00Z"}), 503)
    problem(client.patch(f"{API}/aircraft/F-APART", json={"circuit": "shared_return"}), 503)
    assert client.get(entries).json() == before
    assert client.get(f"{API}/aircraft/F-APART").json()["circuit"] == "separate_drain"
    assert client.get(f"{API}/records/{record}").json()["aircraft"] == place
    assert client.delete(f"{entries}/{later}").status_code == 204


def test_installing_a_pump_elsewhere_needs_its_bytes(client: TestClient) -> None:
    _lose(client, upload(client))
    assert client.post(f"{API}/aircraft", json={"aircraft": "F-APART", "circuit": "separate_drain"}).status_code == 201
    entry = {"aircraft": "F-APART", "position": "LH", "from": "2020-01-01T00:00:00Z"}
    before = client.get(f"{API}/pumps/P-1/installations").json()
    problem(client.post(f"{API}/pumps/P-1/installations", json=entry), 503)
    listed = b"pump,aircraft,position,from,to\nP-1,F-APART,LH,2020-01-01T00:00:00Z,\n"
    problem(client.post(f"{API}/registry/installations.csv", content=listed, headers={"content-type": "text/csv"}), 503)
    assert client.get(f"{API}/pumps/P-1/installations").json() == before


def test_maintenance_on_records_of_an_older_reading_needs_their_bytes(client: TestClient) -> None:
    """A record that was reduced by an older twin is reduced again when its pump is next folded."""
    record = upload(client)
    entries = f"{API}/pumps/P-1/maintenance"
    event = {"at": "2020-01-01T00:00:00Z", "action": "filter_changed"}
    entry = client.post(entries, json=event).json()["id"]
    _lose(client, record)
    with client.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
        session.get_one(Record, record).reduced_with = "an older twin"
    problem(client.post(entries, json={**event, "action": "fluid_changed"}), 503)
    problem(client.patch(f"{entries}/{entry}", json={"at": "2020-02-01T00:00:00Z"}), 503)
    problem(client.delete(f"{entries}/{entry}"), 503)
    assert [e["id"] for e in client.get(entries).json()["items"]] == [entry]


def _lose(client: TestClient, record: str) -> None:
    context = client.app.state.context  # type: ignore[attr-defined]
    with context.database.reading() as session:
        assert context.raw_store.remove(session.get_one(Record, record).content_hash)


def test_two_versions_of_a_mapping_at_the_same_moment(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever read version 1 a moment ago cannot store a second version 2."""
    content = {"channels": [{"source": "P", "channel": "discharge_pressure_bar", "unit": "psi"}]}
    assert client.post(f"{API}/mappings", json={"name": "m", **content}).status_code == 201
    first = client.app.state.context.database  # type: ignore[attr-defined]
    with first.reading() as session:
        read = latest_mapping(session, "default", "m")
    assert client.put(f"{API}/mappings/m", json=content, headers={"If-Match": '"1"'}).status_code == 200
    monkeypatch.setattr("service.web.routes.mappings.latest_mapping", lambda *_: read)
    problem(client.put(f"{API}/mappings/m", json=content, headers={"If-Match": '"1"'}), 409)
    monkeypatch.undo()
    assert client.get(f"{API}/mappings/m").json()["version"] == 2


def test_an_upload_in_the_middle_of_a_deletion(
    database_url: str, tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A record that arrives after the records were deleted keeps its pump, and with it everything."""
    with guarded_client(database_url, tmp_path) as guarded:
        admin = key(guarded, "admin")
        content = json.dumps({**document(), "operator": "north"}).encode()
        record = guarded.post(f"{API}/records", content=content, headers={**JSON, **admin}).json()["record_id"]
        kept = {name: table for name, table in owned_tables().items() if name != "records"}
        monkeypatch.setattr("service.registry.deletion.owned_tables", lambda: kept)
        ending = f"{API}/operators/north?confirm=north&reason=contract+ended"
        assert "repeat" in problem(guarded.delete(ending, headers=admin), 409)["detail"]
        monkeypatch.undo()
        assert guarded.get(f"{API}/records/{record}", headers=admin).status_code == 200
        assert guarded.delete(ending, headers=admin).status_code == 200
        problem(guarded.get(f"{API}/records/{record}", headers=admin), 404)
