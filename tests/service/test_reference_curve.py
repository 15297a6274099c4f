"""A pump type's measured healthy curve judges its pumps, those that flew before it too."""

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from service.jobs import refolding
from tests.service.finished_job import finished
from tests.service.guarded import guarded_client, key
from tests.service.records import body, document

JSON = {"content-type": "application/json"}
API = "/api/v1"
URL = f"{API}/pump-types/h225/reference-curve"
MEASURED_BAR = 0.4
"""Case minus reservoir pressure of the hand-made record, at 50 degC and 4600 rpm."""


@pytest.fixture
def guarded(database_url: str, tmp_path: Path) -> Iterator[TestClient]:
    with guarded_client(database_url, tmp_path) as running:
        yield running


def points(rise: float) -> dict[str, Any]:
    """A bench's points about the record's condition; the last one has some demand, which lifts it."""
    quiet = [(174.0, rise, t, 4600.0) for t in (40.0, 45.0, 50.0, 55.0, 60.0)]
    names = ("discharge_pressure_bar", "case_minus_reservoir_bar", "fluid_temperature_degc", "speed_rpm")
    return {"points": [dict(zip(names, p, strict=True)) for p in (*quiet, (173.0, rise + 0.3, 50.0, 4600.0))]}


def upload(client: TestClient, flight: str = "F1", **who: str) -> None:
    # flights of their own: the same samples twice would be one flight
    warm = [t + 0.001 * int(flight[1:]) for t in document()["channels"]["fluid_temperature_degc"]]
    content = body(document(fluid_temperature_degc=warm))
    answer = client.post(f"{API}/records", content=content, headers={**JSON, **who}, params={"flight_id": flight})
    assert answer.status_code == 201, answer.text


def residuals(client: TestClient, **who: str) -> list[float]:
    trend = client.get(f"{API}/pumps/P-1/trend", params={"metric": "case_residual_bar"}, headers=who).json()
    return [item["value"] for item in trend["items"]]


def verdict(client: TestClient, **params: str) -> dict[str, Any]:
    found: dict[str, Any] = client.get(f"{API}/pumps/P-1/verdict", params=params).json()
    return found


def test_it_judges_what_flew_before_and_what_comes_after(client: TestClient) -> None:
    upload(client)
    (by_twin,) = residuals(client)
    before = datetime.now(UTC).isoformat()
    plain = verdict(client)["twin_version"]
    assert client.put(URL, json=points(0.6)).status_code == 200
    assert residuals(client)[0] == pytest.approx(MEASURED_BAR - 0.6, abs=0.01)
    first = verdict(client)["twin_version"]
    assert first.startswith(f"{plain}+curve-")
    upload(client, "F2")
    assert residuals(client) == pytest.approx([MEASURED_BAR - 0.6] * 2, abs=0.01)
    # another curve, another version; what was known before stays readable
    assert client.put(URL, json=points(MEASURED_BAR)).status_code == 200
    assert residuals(client) == pytest.approx([0.0] * 2, abs=0.01)
    assert verdict(client)["twin_version"] not in (plain, first)
    assert verdict(client, known_at=before)["twin_version"] == plain
    assert abs(by_twin) < 0.05


def test_outside_its_range_the_verdict_says_so(client: TestClient) -> None:
    upload(client)
    hot = {
        "points": [p | {"fluid_temperature_degc": p["fluid_temperature_degc"] + 40.0} for p in points(0.6)["points"]]
    }
    (by_twin,) = residuals(client)
    assert client.put(URL, json=hot).status_code == 200
    assert residuals(client) == [by_twin]
    (flag,) = (f for f in verdict(client)["quality"]["flags"] if "healthy curve" in f)
    assert flag.startswith("1 of 1 records outside the measured healthy curve (fluid_temperature_degc)")


def test_of_a_large_fleet_by_a_job(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(refolding, "MOST_PUMPS_AT_ONCE", 0)
    upload(client)
    assert client.put(URL, json=points(0.6)).status_code == 200
    (job,) = client.get(f"{API}/jobs", params={"kind": "refold"}).json()["items"]
    assert finished(client, job["id"])["status"] == "succeeded"
    assert residuals(client) == pytest.approx([MEASURED_BAR - 0.6], abs=0.01)


def test_an_operator_s_curve_touches_no_other_pumps(guarded: TestClient) -> None:
    north, south = key(guarded, "engineer", "north"), key(guarded, "engineer", "south")
    for who in (north, south):
        upload(guarded, **who)
    theirs = residuals(guarded, **south)
    assert guarded.put(URL, json=points(0.6), headers=north).status_code == 200
    assert residuals(guarded, **north) == pytest.approx([MEASURED_BAR - 0.6], abs=0.01)
    assert residuals(guarded, **south) == theirs


def test_points_that_the_twin_cannot_follow_are_named(client: TestClient) -> None:
    bad = points(0.6)
    bad["points"][1]["speed_rpm"] = bad["points"][4]["speed_rpm"] = 29_000.0
    answer = client.put(URL, json=bad)
    assert answer.status_code == 422
    assert [e["where"] for e in answer.json()["errors"]] == ["body.points.1", "body.points.4"]
    assert "29000 rpm" in answer.json()["errors"][0]["problem"]
    assert client.get(URL).json()["source"] == "twin"
