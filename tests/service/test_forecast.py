"""The forecast of one pump: over the API on stored trends, and from trends whose truth is known."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select

from detectors.prognosis.passage import Forecast, NoForecast
from service.reading.forecast import SPACING, TrendPoint, forecast_of_trend
from service.settings import Settings
from service.storage.database import Database
from service.storage.tables import ANALYSED, Installation, Pump, Record, StoredAssessment
from tests.service.records import body

LIMIT = 1.5
START = datetime(2026, 1, 1, 8, tzinfo=UTC)
START_HOURS = 500.0


def points(
    n: int, growth_per_hour: float, *, sd: float = 0.05, seed: int = 1, level: float = 0.9
) -> tuple[list[TrendPoint], float]:
    """Estimates of a growing case flow as a filter gives them: half of their error for ever, the rest slow (made by an
    AR(1) of 20 records); and the true flight hours to the limit.
    """
    rng = np.random.default_rng(seed)
    hours = START_HOURS + np.cumsum(rng.uniform(0.8, 3.5, n))
    truth = level + growth_per_hour * (hours - START_HOURS)
    slow = np.empty(n)
    slow[0] = rng.normal()
    for i in range(1, n):
        slow[i] = 0.95 * slow[i - 1] + np.sqrt(1.0 - 0.95**2) * rng.normal()
    mean = truth + sd * np.sqrt(0.5) * (rng.normal() + slow)
    track = [TrendPoint(float(h), float(m), sd) for h, m in zip(hours, mean, strict=True)]
    left = (LIMIT - truth[-1]) / growth_per_hour if growth_per_hour > 0.0 else np.inf
    return track, float(left)


def test_intervals_hold_the_truth_although_errors_are_shared() -> None:
    held, given = 0, 0
    for seed in range(25):
        track, left = points(100, 0.002, seed=seed)
        found = forecast_of_trend(track, LIMIT)
        if isinstance(found, Forecast):
            given += 1
            held += found.low <= left <= found.high
    assert given >= 15
    assert held >= 0.85 * given


def test_healthy_pumps_get_no_forecast() -> None:
    found = [forecast_of_trend(points(100, 0.0, seed=seed)[0], LIMIT) for seed in range(20)]
    assert sum(isinstance(f, Forecast) for f in found) <= 1


def test_a_farther_limit_and_an_earlier_look_take_longer() -> None:
    track, _ = points(120, 0.002, level=0.7)
    near, far = forecast_of_trend(track, LIMIT), forecast_of_trend(track, LIMIT + 0.3)
    assert isinstance(near, Forecast)
    assert isinstance(far, Forecast)
    assert near.low < far.low
    assert near.mean < far.mean
    assert near.high < far.high
    earlier = forecast_of_trend(track[:80], LIMIT)
    assert isinstance(earlier, Forecast)
    assert earlier.mean > near.mean


def test_an_error_that_all_share_widens_the_interval() -> None:
    track, _ = points(120, 0.002, sd=0.02, level=0.7)
    wider = [TrendPoint(p.flight_hours, p.mean, 3.0 * p.standard_deviation) for p in track]
    sure, unsure = forecast_of_trend(track, LIMIT), forecast_of_trend(wider, LIMIT)
    assert isinstance(sure, Forecast)
    assert isinstance(unsure, Forecast)
    assert unsure.high - unsure.low > sure.high - sure.low


def without_hours(track: Sequence[TrendPoint], every: int) -> list[TrendPoint]:
    return [p if i % every else TrendPoint(None, p.mean, p.standard_deviation) for i, p in enumerate(track)]


GROWING = points(100, 0.002)[0]


@pytest.mark.parametrize(
    ("track", "words"),
    [
        (GROWING[: SPACING * 7], "35 records of this installation have an estimate; at least 36"),
        (without_hours(GROWING, 1), "flight hours are missing for 100 of 100"),
        ([*GROWING[:50], *points(50, 0.002)[0]], "flight hours fall from"),
        (points(100, 0.002, level=1.8)[0], "already above the limit"),
        (points(100, 0.002, sd=0.08, level=1.05)[0], "lies within the error"),
    ],
)
def test_without_grounds_the_reason_is_given(track: list[TrendPoint], words: str) -> None:
    found = forecast_of_trend(track, LIMIT)
    assert isinstance(found, NoForecast)
    assert words in found.reason


def test_some_missing_hours_do_no_harm() -> None:
    assert isinstance(forecast_of_trend(without_hours(points(120, 0.002, level=0.7)[0], 4), LIMIT), Forecast)


def store(database_url: str, track: Sequence[TrendPoint], verdict: dict[str, Any], aircraft: Sequence[str]) -> None:
    """A pump F-1 whose records left this trend."""
    database = Database(database_url)
    with database.writing() as session:
        # the curve on the page wants a reduction; whose does not matter here
        reduction = session.scalars(select(Record.reduction)).first()
        pump = Pump(operator="default", serial="F-1", pump_type="h225", confirmed=True, created_at=START)
        session.add(pump)
        session.flush()
        for i, (point, place) in enumerate(zip(track, aircraft, strict=True)):
            at = START + timedelta(days=i)
            session.add(
                Record(
                    id=f"r{i:04d}",
                    operator="default",
                    pump_id=pump.id,
                    aircraft=place,
                    position="LH",
                    flight_id=f"F{i}",
                    segment="",
                    started_at=at,
                    flight_hours=point.flight_hours,
                    status=ANALYSED,
                    request={},
                    content_hash="0",
                    content_type="text/csv",
                    request_hash=f"q{i}",
                    identity_hash=f"i{i}",
                    received_at=at,
                    reduction=reduction,
                )
            )
            session.flush()
            half = 1.645 * point.standard_deviation
            flow = {"mean": point.mean, "low": point.mean - half, "high": point.mean + half}
            trend = {"case_flow_at_reference_lpm": flow}
            session.add(
                StoredAssessment(
                    record_id=f"r{i:04d}",
                    pump_id=pump.id,
                    at=at,
                    aircraft=place,
                    position="LH",
                    state="healthy",
                    trend=trend,
                    verdict=verdict,
                )
            )
    database.close()


@pytest.fixture
def verdict(client: TestClient) -> dict[str, Any]:
    """Any verdict of the right shape."""
    answer = client.post("/api/v1/records", content=body(), headers={"content-type": "application/json"})
    assert answer.status_code == 201
    found: dict[str, Any] = answer.json()["verdict"]
    return found


def test_shape_of_the_contract_and_sentence_on_the_page(
    client: TestClient, settings: Settings, verdict: dict[str, Any]
) -> None:
    track, left = points(120, 0.002, level=0.7)
    store(settings.database_url, track, verdict, ["F-A"] * 120)
    document = client.get("/api/v1/pumps/F-1/forecast").json()
    assert set(document) >= {"flight_hours", "limit", "reason"}
    assert document["reason"] is None
    assert document["limit"] == LIMIT
    assert document["limit_unit"] == "L/min"
    hours = document["flight_hours"]
    assert set(hours) == {"mean", "low", "high"}
    assert 0.0 <= hours["low"] < hours["mean"] < hours["high"]
    assert hours["low"] < left < hours["high"]
    page = client.get("/pumps/F-1").text
    assert hours["low"] < document["median_flight_hours"] < hours["mean"]  # late crossings draw the mean out
    assert f"{document['median_flight_hours']:.0f} flight hours" in page
    assert f"{hours['low']:.0f} to {hours['high']:.0f}" in page


def test_only_the_current_installation_counts(client: TestClient, settings: Settings, verdict: dict[str, Any]) -> None:
    store(settings.database_url, points(120, 0.002, level=0.7)[0], verdict, ["F-A"] * 110 + ["F-B"] * 10)
    document = client.get("/api/v1/pumps/F-1/forecast").json()
    assert document["flight_hours"] is None
    assert document["records"] == 10
    assert "10 records of this installation" in document["reason"]
    assert document["reason"] in client.get("/pumps/F-1").text


def test_an_entered_installation_starts_anew(client: TestClient, settings: Settings, verdict: dict[str, Any]) -> None:
    """The records name one aircraft all along: the entry says that the pump was away in between."""
    store(settings.database_url, points(120, 0.002, level=0.7)[0], verdict, ["F-A"] * 120)
    database = Database(settings.database_url)
    with database.writing() as session:
        pump_id = session.scalars(select(Pump.id).where(Pump.serial == "F-1")).one()
        at = START + timedelta(days=99, hours=12)
        session.add(
            Installation(
                id="i-1",
                pump_id=pump_id,
                recorded_at=at,
                author="test",
                aircraft="F-A",
                position="LH",
                installed_at=at,
            )
        )
    database.close()
    document = client.get("/api/v1/pumps/F-1/forecast").json()
    assert document["records"] == 20
    assert document["flight_hours"] is None


def test_records_without_flight_hours_say_so(client: TestClient, settings: Settings, verdict: dict[str, Any]) -> None:
    store(settings.database_url, without_hours(GROWING, 1), verdict, ["F-A"] * len(GROWING))
    document = client.get("/api/v1/pumps/F-1/forecast").json()
    assert document["flight_hours"] is None
    assert document["reason"] == "flight hours are missing for 100 of 100 records"


def test_unknown_and_unassessed_pumps(client: TestClient, verdict: dict[str, Any]) -> None:
    assert client.get("/api/v1/pumps/nobody/forecast").status_code == 404
    assert verdict["state"] == "insufficient_data"
    document = client.get("/api/v1/pumps/P-1/forecast").json()
    assert document["flight_hours"] is None
    assert document["reason"].startswith("0 records of this installation")
