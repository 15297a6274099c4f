"""Studies and reports as jobs: what they leave behind, who may fetch it, and what is refused."""

import multiprocessing
import os
import re
import signal
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from pydantic import TypeAdapter

from service.answers.job_documents import FleetReport
from service.errors import Unavailable
from service.jobs import evaluation
from tests.detectors.fleet import FAULTS, history
from tests.service.finished_job import finished
from tests.service.stored_records import store

API = "/api/v1"
STUDY = {"rows": ["setting 3 bar"], "pumps": 4, "healthy_records": 100, "seed": 5}


def asked(client: TestClient, kind: str, parameters: dict[str, Any], **more: Any) -> dict[str, Any]:
    answer = client.post(f"{API}/jobs", json={"kind": kind, "parameters": parameters, **more})
    assert answer.status_code == 202, answer.text
    return finished(client, answer.json()["id"])


@pytest.fixture
def fleet(client: TestClient) -> TestClient:
    context = client.app.state.context  # type: ignore[attr-defined]
    for operator, serial, fault in (("north", "N-1", "worn"), ("north", "N-2", None), ("south", "S-1", "setting")):
        seen = history(3, 40, FAULTS[fault] if fault else None)
        store(context, seen.observations, serial, operator)
    return client


def test_a_report_of_one_operator_as_page_and_numbers(fleet: TestClient) -> None:
    whole = asked(fleet, "report", {"since": "2026-01-01T00:00:00Z", "until": "2026-06-01T00:00:00Z"}, operator="north")
    assert (whole["status"], whole["result"]["counts"]) == ("succeeded", {"reported": 2})
    assert {(i["name"], i["operator"]) for i in whole["items"]} == {("N-1", "north"), ("N-2", "north")}
    numbers = fleet.get(f"{API}/jobs/{whole['id']}/result", params={"format": "json"})
    assert numbers.headers["content-type"] == "application/json"
    document = numbers.json()
    TypeAdapter(FleetReport).validate_python(document)
    assert [item["serial"] for item in document["ranking"]] == ["N-1", "N-2"]  # the worn one first
    assert document["ranking"][0]["reasons"]
    verdict = fleet.get(f"{API}/pumps/N-1/verdict").json()
    (chapter,) = [c for c in document["pumps"] if c["pump"]["serial"] == "N-1"]
    assert chapter["verdict"] == verdict
    assert chapter["alarms"]
    assert chapter["changes"][-1]["state"] == verdict["state"]
    trend = fleet.get(f"{API}/pumps/N-1/trend", params={"metric": "case_flow_at_reference_lpm"}).json()["items"]
    assert chapter["trends"]["case_flow_at_reference_lpm"][-1]["value"] == trend[-1]["value"]
    page = fleet.get(f"{API}/jobs/{whole['id']}/result")
    assert page.headers["content-type"].startswith("text/html")
    assert "script" not in page.headers["content-security-policy"]
    assert "S-1" not in page.text
    assert page.text.index("Pump N-1") < page.text.index("Pump N-2")
    assert verdict["advice"] in page.text
    assert page.text.count("<svg") == 4
    assert not re.search(r"(?:src|href)=\"(?!#)", page.text)  # it needs nothing else
    # only what the period holds
    early = asked(fleet, "report", {"pump": "N-1", "since": "2025-01-01T00:00:00Z", "until": "2025-02-01T00:00:00Z"})
    (chapter,) = fleet.get(f"{API}/jobs/{early['id']}/result?format=json").json()["pumps"]
    assert (chapter["trends"], chapter["changes"], chapter["alarms"]) == ({}, [], [])
    assert "No record within the period" in fleet.get(f"{API}/jobs/{early['id']}/result").text


REFUSED: list[tuple[str, dict[str, Any], int, str | None]] = [
    ("report", {"pump": "nobody"}, 404, None),
    ("report", {"since": "2026-02-01T00:00:00Z", "until": "2026-01-01T00:00:00Z"}, 422, "parameters.since"),
    ("report", {"mood": 1}, 422, "parameters.mood"),
    ("evaluation", {"rows": ["setting 3 bar", "nothing"]}, 422, "parameters.rows"),
    ("evaluation", {"pumps": 301, "healthy_records": 1}, 422, "parameters.healthy_records"),
]


def test_what_cannot_be_made_is_refused_before_it_starts(client: TestClient) -> None:
    for kind, parameters, status, where in REFUSED:
        answer = client.post(f"{API}/jobs", json={"kind": kind, "parameters": parameters})
        assert answer.status_code == status, answer.text
        if where is not None:
            assert where in [fault["where"] for fault in answer.json()["errors"]]
    assert client.get(f"{API}/jobs").json()["items"] == []


def _killed_once(_chunk: object, folder: Path) -> None:
    mark = folder.with_name(f"{folder.name}-killed")
    if not mark.exists():
        mark.parent.mkdir(parents=True, exist_ok=True)
        mark.touch()
        os.kill(os.getpid(), signal.SIGTERM)


def _nothing(_study: object, _folder: Path) -> dict[str, str]:
    return {"json": "{}"}


def test_a_study_outlives_the_process_that_judges(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    """A stop of all processes of a service, or memory that is short, ends it: it is made anew, and no chunk is lost."""
    forks = multiprocessing.get_context("fork")  # has what is patched here, and starts at once
    monkeypatch.setattr(evaluation.multiprocessing, "get_context", lambda _: forks)
    monkeypatch.setattr(evaluation, "judge_chunk", _killed_once)
    monkeypatch.setattr(evaluation, "_documents", _nothing)
    job = asked(client, "evaluation", STUDY)
    assert (job["status"], job["result"]["counts"]) == ("succeeded", {"judged": 8}), job
    data_dir = client.app.state.context.settings.data_dir  # type: ignore[attr-defined]
    assert list(data_dir.rglob("*-killed"))


@pytest.mark.study
def test_a_study_leaves_its_numbers_and_goes_on_where_it_stood(client: TestClient) -> None:
    job = asked(client, "evaluation", STUDY)
    assert job["status"] == "succeeded", job
    # 4 pumps, one in each reality, seen by windows and with bursts
    assert job["result"]["counts"] == {"judged": 8}
    study = client.get(f"{API}/jobs/{job['id']}/result?format=json").json()
    assert (study["study"]["seed"], study["study"]["pumps_per_row"]) == (5, 4)
    assert {row["row"] for row in study["rows"]} == {"setting 3 bar", "setting 3 bar; burst"}
    assert "Detection study" in client.get(f"{API}/jobs/{job['id']}/result").text
    files = job["result"]["files"]
    assert files["json"]["bytes"] == len(client.get(f"{API}/jobs/{job['id']}/result?format=json").content)
    context = client.app.state.context  # type: ignore[attr-defined]
    assert not (context.settings.data_dir.resolve() / "jobs" / job["id"]).exists()


def test_a_job_without_a_document_says_so(fleet: TestClient) -> None:
    job = asked(fleet, "reprocess", {"pump": "N-1", "only": "verdicts", "dry_run": True})
    answer = fleet.get(f"{API}/jobs/{job['id']}/result")
    assert answer.status_code == 404
    assert "a job reprocess leaves none" in answer.json()["detail"]
    assert fleet.get(f"{API}/jobs/none/result").status_code == 404


def test_a_report_ends_with_its_operator(fleet: TestClient) -> None:
    job = asked(fleet, "report", {}, operator="north")
    digests = [f["content_hash"] for f in job["result"]["files"].values()]
    raw = fleet.app.state.context.raw_store  # type: ignore[attr-defined]
    assert all(raw.get(d) for d in digests)
    gone = fleet.delete(f"{API}/operators/north", params={"confirm": "north", "reason": "contract ended"})
    assert gone.status_code == 200, gone.text
    assert set(digests) <= set(gone.json()["receipt"]["raw_files_removed"])
    for digest in digests:
        with pytest.raises(Unavailable):
            raw.get(digest)
