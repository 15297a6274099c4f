"""Uploading by hand: several files, each with its own result; what is wrong is named and stops none of the others."""

import io
import zipfile
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from tests.service.guarded import guarded_client, key
from tests.service.records import body, document
from tests.service.test_page_forms import come_in

API = "/api/v1"
ORIGIN = {"origin": "http://localhost"}


def test_each_file_has_its_result(client: TestClient) -> None:
    good, bad = body(), body({"channels": {"time_s": [0, 1]}})
    files = [("file", ("good.json", good)), ("file", ("bad.json", bad)), ("file", ("other.bin", b"\x00\x01"))]
    assert client.post("/upload", files=files).status_code == 403
    looked = client.post("/upload/preview", files=files, headers=ORIGIN)
    assert looked.status_code == 200
    assert "It would be taken" in looked.text
    assert client.get(f"{API}/records").json()["items"] == []
    page = client.post("/upload", files=files, headers=ORIGIN)
    assert page.status_code == 200
    assert "1 taken, 2 refused" in page.text
    (record,) = client.get(f"{API}/records").json()["items"]
    assert f'href="/records/{record["record_id"]}"' in page.text
    for refusal in client.get(f"{API}/records/refusals").json()["items"]:
        for fault in refusal["problem"].get("errors", []):
            assert f"<strong>{fault['where']}</strong>" in page.text
    again = client.post("/upload", files=files[:1], headers=ORIGIN)
    assert "Known already" in again.text
    other = document()
    other["channels"]["fluid_temperature_degc"][3] += 1.0
    clash = client.post("/upload", files=[("file", ("second.json", body(other)))], headers=ORIGIN)
    assert clash.status_code == 409
    assert f'<a href="/records/{record["record_id"]}">The record that stands for this flight' in clash.text


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_what_is_typed_wins_and_what_is_none_of_the_form_is_refused(client: TestClient) -> None:
    file = [("file", ("good.json", body()))]
    page = client.post("/upload", files=file, data={"position": "RH", "operator": "north"}, headers=ORIGIN)
    assert "1 taken" in page.text
    (record,) = client.get(f"{API}/records").json()["items"]
    assert (record["position"], record["operator"]) == ("RH", "north")
    for data, status, words in (
        ({"colour": "red"}, 422, "<strong>colour</strong> is not a field of this form"),
        ({"mapping": "none such"}, 404, "none such"),
    ):
        answer = client.post("/upload", files=file, data=data, headers=ORIGIN)
        assert answer.status_code == status
        assert words in answer.text
    nothing = client.post("/upload", files=[("file", ("", b""))], headers=ORIGIN)
    assert nothing.status_code == 422
    assert "choose one or more files" in nothing.text
    large = client.post("/upload", files=[("file", ("large.json", b"{" * 2_000_001))], headers=ORIGIN)
    assert large.status_code == 413


def test_an_archive_becomes_a_job_and_forms_need_token_and_role(database_url: str, tmp_path: Path) -> None:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("one.json", body())
    files = [("file", ("many.zip", packed.getvalue()))]
    with guarded_client(database_url, tmp_path) as guarded:
        assert guarded.post("/upload", files=files, follow_redirects=False).headers["location"] == "/sign-in"
        token = come_in(guarded, "vic", "viewer", "north")
        assert guarded.get("/upload").status_code == 403
        assert guarded.post("/upload", files=files, data={"csrf_token": token}).status_code == 403
        token = come_in(guarded, "ann", "analyst", "north")
        assert guarded.post("/upload", files=files, data={"csrf_token": "guess"}).status_code == 403
        page = guarded.post("/upload", files=files, data={"csrf_token": token})
        assert page.status_code == 200
        (job,) = guarded.get(f"{API}/jobs", headers=key(guarded, "viewer", "north")).json()["items"]
        assert f'href="/jobs/{job["id"]}"' in page.text
        foreign = guarded.post(
            "/upload",
            files=[("file", ("good.json", body()))],
            data={"csrf_token": token, "operator": "south"},
        )
        assert foreign.status_code == 403
