"""The forecast of one pump: over the API on stored trends, and from trends whose truth is known."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select

from detectors.prognosis.passage import Forecast, NoForecast
from service.monitoring.refold import verdict_known_at
from service.reading import queries
from service.reading.forecast import (
    SPACING,
    TrendPoint,
    crossed,
    crossing_of_trend,
    forecast_of_trend,
    with_crossing,
)
from service.running import opened
from service.settings import Settings
from service.storage.database import Database
from service.storage.tables import ANALYSED, Installation, Pump, Record, StoredAssessment
from tests.detectors import fleet
from tests.service import stored_records
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


class TestCrossing:
    """The chance of crossing the limit before the next inspection."""

    def test_it_says_what_happens(self) -> None:
        """Growing pumps at every place of the last part of their lives: chances are the share of crossings that come."""
        rng = np.random.default_rng(9)
        chances, crossings = [], []
        for seed in range(60):
            growth, reached = rng.uniform(0.0015, 0.004), rng.uniform(1.15, 1.5)
            track, left = points(110, growth, seed=seed, level=reached - growth * 235.0)
            chance = crossing_of_trend(track, LIMIT, 50.0)
            assert chance is not None
            chances.append(chance)
            crossings.append(left <= 50.0)
        rare, sure = np.array(chances) < 0.1, np.array(chances) > 0.9
        assert min(rare.sum(), sure.sum()) >= 5
        assert np.mean(np.array(crossings)[rare]) <= 0.1
        assert np.mean(np.array(crossings)[sure]) >= 0.8
        # sixty pumps of such chances spread by 4 %
        assert np.mean(chances) == pytest.approx(np.mean(crossings), abs=0.12)

    def test_a_longer_interval_crosses_more(self) -> None:
        track, _ = points(120, 0.002, level=0.9)
        chances = [crossing_of_trend(track, LIMIT, hours) for hours in (1.0, 50.0, 200.0, 5000.0)]
        numbers = [c for c in chances if c is not None]
        assert numbers == sorted(numbers)
        assert len(numbers) == 4
        assert numbers[-1] > 0.99

    def test_there_is_one_wherever_there_is_an_estimate(self) -> None:
        """A small chance is said too: who hears of large ones only cannot hold them against what happens."""
        for track in (points(100, 0.0, level=0.6)[0], points(1, 0.0, level=0.6)[0], points(30, 0.0, level=0.6)[0]):
            chance = crossing_of_trend(track, LIMIT, 50.0)
            assert chance is not None
            assert chance < 0.02
        # one estimate at the limit: as likely beyond as not
        at_limit = crossing_of_trend([TrendPoint(START_HOURS, LIMIT, 0.1)], LIMIT, 50.0)
        assert at_limit is not None
        assert 0.5 <= at_limit < 0.65

    def test_without_flight_hours_there_is_none(self) -> None:
        track = points(100, 0.002)[0]
        undated = [TrendPoint(None, p.mean, p.standard_deviation) for p in track]
        assert crossing_of_trend([], LIMIT, 50.0) is None
        assert crossing_of_trend(undated, LIMIT, 50.0) is None
        assert crossing_of_trend([*undated[:60], *track[60:]], LIMIT, 50.0) is None
        assert crossing_of_trend([*track[50:], *track[:50]], LIMIT, 50.0) is None  # hours that fall

    def test_a_level_beyond_has_crossed(self) -> None:
        for growth, level in ((0.0, 2.0), (0.001, 2.0), (0.0, 1.62)):
            chance = crossing_of_trend(points(100, growth, level=level)[0], LIMIT, 50.0)
            assert chance is not None
            assert chance > (0.99 if level > 1.8 else 0.8)

    def test_it_is_never_below_the_chance_of_being_beyond(self) -> None:
        verdict: Any = {"probability_beyond_limit": 0.9}
        thresholds = {"case_flow_limit_lpm": LIMIT, "inspection_interval_h": 50.0}
        assert crossed(verdict, [], [], thresholds)["crossing"] == {"within_flight_hours": 50.0, "probability": 0.9}
        verdict = {"probability_beyond_limit": 0.3}
        assert crossed(verdict, [], [], thresholds)["crossing"] is None


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
    assert hours["low"] < left < hours["high"]
    page = client.get("/pumps/F-1").text
    assert hours["low"] < document["median_flight_hours"] < hours["mean"]  # late crossings draw the mean out
    assert f"{document['median_flight_hours']:.0f} flight hours" in page
    assert f"{hours['low']:.0f} to {hours['high']:.0f}" in page


def test_the_verdict_says_the_chance_of_crossing_before_the_next_inspection(
    client: TestClient, settings: Settings, verdict: dict[str, Any]
) -> None:
    track, _ = points(120, 0.002, level=0.93)
    # the trend alone: the chance of being beyond belongs to the record that the verdict comes from
    store(settings.database_url, track, verdict | {"probability_beyond_limit": None}, ["F-A"] * 120)
    url = "/api/v1/pumps/F-1/verdict"

    def crossing(**params: str) -> dict[str, float]:
        found: dict[str, float] = client.get(url, params=params).json()["crossing"]
        return found

    def expected(n: int, hours: float) -> Any:
        return pytest.approx(crossing_of_trend(track[:n], LIMIT, hours), rel=1e-6)

    assert crossing() == {"within_flight_hours": 50.0, "probability": expected(120, 50.0)}
    assert 0.05 < crossing()["probability"] < 0.999
    earlier = (START + timedelta(days=79)).isoformat()
    assert crossing(at=earlier)["probability"] == expected(80, 50.0)
    change = {"values": {"inspection_interval_h": 200}, "reason": "every second phase"}
    client.put("/api/v1/thresholds/pump/F-1", json=change, headers={"If-Match": "*"})
    longer = crossing()
    assert longer["within_flight_hours"] == 200.0
    assert longer["probability"] == expected(120, 200.0)
    early = (START + timedelta(days=9)).isoformat()
    assert crossing(at=early)["probability"] == expected(10, 200.0)
    assert crossing(at=early)["probability"] < longer["probability"]


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


def test_what_was_known_then_says_the_same_chance(settings: Settings) -> None:
    """A worn pump of the fleet: the stored trend and the fold of what was known give one answer."""
    context = opened(settings)
    flown = fleet.history(5, 60, fleet.FAULTS["worn"]).observations
    stored_records.store(context, flown, "P-1", "north")
    with context.database.writing() as session:
        for i, record in enumerate(session.scalars(select(Record).order_by(Record.started_at))):
            record.flight_hours = START_HOURS + 3.0 * i
    with context.database.reading() as session:
        pump = session.scalars(select(Pump)).one()
        for at in (None, flown[54].at):
            now = with_crossing(session, pump, queries.verdict(session, pump, at), at)
            assert now["crossing"] is not None
            assert now == verdict_known_at(session, pump, context.archive, datetime.now(UTC), at)
    context.close()
