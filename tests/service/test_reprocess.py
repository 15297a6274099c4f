"""Reprocessing with other versions: a rehearsal changes nothing, what is held at a version stays until it is changed."""

from datetime import UTC, datetime
from typing import Any

import pytest
from fastapi.testclient import TestClient

from detectors.judgement.version import twin_version
from service.demo.fleet import DemoRecord
from service.settings import Settings
from tests.detectors.fleet import FAULTS, history
from tests.service.finished_job import finished
from tests.service.lent_application import lent
from tests.service.stored_records import store
from twin.pumps import pump_type

API = "/api/v1"
N = 40
FLIGHTS = history(5, N, FAULTS["worn"]).observations
DEAF = {"baseline_records": 100.0}
"""A baseline longer than the history: nothing can be said of it."""


def reprocess(client: TestClient, **parameters: Any) -> dict[str, Any]:
    """Items of a job by pump."""
    body = {"kind": "reprocess", "parameters": {"only": "verdicts", **parameters}}
    answer = client.post(f"{API}/jobs", json=body)
    assert answer.status_code == 202, answer.text
    job = finished(client, answer.json()["id"])
    assert job["status"] == "succeeded", job
    return {item["pump"]: item for item in job["items"]}


def publish(client: TestClient, values: dict[str, float]) -> int:
    url = f"{API}/thresholds/fleet/default"
    put = {"values": values, "reason": "a trial"}
    answer = client.put(url, json=put, headers={"If-Match": client.get(url).headers["etag"]})
    assert answer.status_code == 200, answer.text
    return int(answer.json()["version"])


def state(client: TestClient, **more: str) -> tuple[str, int]:
    verdict = client.get(f"{API}/pumps/P-1/verdict", params=more).json()
    return verdict["state"], verdict["threshold_version"]


def alarms(client: TestClient) -> list[datetime]:
    return [
        datetime.fromisoformat(a["raised_at"])
        for a in client.get(f"{API}/alarms").json()["items"]
        if a["state"] != "withdrawn"
    ]


@pytest.mark.postgres_in_study
def test_an_earlier_version_of_the_thresholds(client: TestClient) -> None:
    context = client.app.state.context  # type: ignore[attr-defined]
    store(context, FLIGHTS[:-2], "P-1", "default")
    heard, raised = state(client), alarms(client)
    assert len(raised) == 1
    version = publish(client, DEAF)
    assert (state(client), alarms(client)) == (("insufficient_data", version), [])
    asked = datetime.now(UTC).isoformat()

    rehearsal = reprocess(client, threshold_version=0, dry_run=True)["P-1"]
    assert (state(client), alarms(client)) == (("insufficient_data", version), [])
    done = reprocess(client, threshold_version=0)["P-1"]
    told = ("status", "records", "changed", "changes", "state_before", "state_after", "alarms", "threshold_version")
    assert {name: rehearsal[name] for name in told} == {name: done[name] for name in told}
    assert (done["status"], done["state_before"], done["threshold_version"]) == ("changed", "insufficient_data", 0)
    assert [datetime.fromisoformat(a["raised_at"]) for a in done["alarms"]["gained"]] == raised
    assert done["alarms"]["lost"] == []
    assert done["changed"] == len(done["changes"]) > 0
    assert (state(client), alarms(client)) == (heard, raised)

    # the pump is held there: what follows, and what is asked, goes by that version
    store(context, FLIGHTS[-2:-1], "P-1", "default")
    assert state(client)[1] == 0
    baseline = client.get(f"{API}/thresholds/pump/P-1").json()["values"]["baseline_records"]
    assert baseline["value"] == 8.0
    assert state(client, known_at=asked) == ("insufficient_data", version)
    held = datetime.now(UTC).isoformat()

    # until it is let go, or thresholds that hold for it change
    assert reprocess(client)["P-1"]["state_after"] == "insufficient_data"
    assert state(client) == ("insufficient_data", version)
    assert state(client, known_at=held)[1] == 0
    reprocess(client, threshold_version=0)
    newest = publish(client, {**DEAF, "side_records": 5})
    assert state(client) == ("insufficient_data", newest)
    store(context, FLIGHTS[-1:], "P-1", "default")
    assert state(client) == ("insufficient_data", newest)


def test_another_parameter_set_of_the_twin_only_as_a_rehearsal(
    client: TestClient, worn_records: list[DemoRecord]
) -> None:
    for record in worn_records[:4]:
        assert client.post(f"{API}/records", content=record.content, headers={"content-type": "text/csv"}).is_success
    serial = worn_records[0].pump.serial
    before = client.get(f"{API}/pumps/{serial}/verdict").json()
    own, other = (twin_version(pump_type(name)) for name in ("h225", "h225_thesis"))
    found = reprocess(client, twin_version=other, dry_run=True)[serial]
    assert (found["records"], found["twin_version"]) == (4, other)
    assert reprocess(client, twin_version=own)[serial]["status"] == "unchanged"
    # a stored parameter set is one that can be run as well
    narrow = {
        "id": "rebuilt",
        "base": "h225",
        "changes": {"slipper.h": {"value": 8.2, "unit": "um", "source": "bench"}},
    }
    stored = client.post(f"{API}/pump-types", json=narrow).json()["twin_version"]
    assert reprocess(client, twin_version=stored, dry_run=True)[serial]["twin_version"] == stored
    assert client.get(f"{API}/pumps/{serial}/verdict").json() == before
    refused = client.post(f"{API}/jobs", json={"kind": "reprocess", "parameters": {"twin_version": other}})
    assert refused.status_code == 422
    assert "dry run" in refused.json()["errors"][0]["problem"]


def test_versions_that_do_not_exist_are_refused_by_name(client: TestClient) -> None:
    context = client.app.state.context  # type: ignore[attr-defined]
    store(context, FLIGHTS[:3], "P-1", "default")
    asked = {"kind": "reprocess", "parameters": {"threshold_version": 7, "twin_version": "h225-0-00000000"}}
    refused = client.post(f"{API}/jobs", json=asked)
    assert refused.status_code == 422
    faults = {e["where"]: e["problem"] for e in refused.json()["errors"]}
    assert "0 (built in) to 0" in faults["parameters.threshold_version"]
    assert twin_version(pump_type("h225")) in faults["parameters.twin_version"]
    assert client.get(f"{API}/jobs").json()["items"] == []


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_verdicts_by_other_thresholds_take_an_engineer(settings: Settings) -> None:
    from service.access.security import new_key

    with lent(settings.model_copy(update={"auth": "on"})) as client:
        context = client.app.state.context  # type: ignore[attr-defined]
        store(context, FLIGHTS[:3], "P-1", "north")
        with context.database.writing() as session:
            key = new_key(session, "somebody", "analyst", "north", None)[1]
        for dry_run, status in ((True, 202), (False, 403)):
            asked = {"threshold_version": 0, "dry_run": dry_run, "only": "verdicts"}
            answer = client.post(
                f"{API}/jobs",
                json={"kind": "reprocess", "parameters": asked},
                headers={"authorization": f"Bearer {key}"},
            )
            assert answer.status_code == status, answer.text
