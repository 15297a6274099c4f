"""Sensors and clocks that cannot have meant what they say: a sentence each, and a wrong date is evidence of nothing."""

import io
import json
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient
from nptdms import ChannelObject, RootObject, TdmsWriter

from service.ingest.doubts import doubts
from service.ingest.raw import Limits
from service.ingest.tdms_format import parsed
from tests.service.records import METADATA, document
from twin.pumps import PUMP_TYPES

PUMP = PUMP_TYPES["h225"]
JSON = {"content-type": "application/json"}
LIMITS = Limits(10_000_000, 1_000_000)


def channels(**changes: Any) -> dict[str, Any]:
    return {name: np.array(samples) for name, samples in document(**changes)["channels"].items()}


def run_up(n: int, rate_hz: float, start_s: float = 20.0) -> dict[str, Any]:
    """A record whose pump needs ``start_s`` to reach its speed."""
    time = np.arange(n) / rate_hz
    speed = 4600.0 * np.clip((time - 40.0) / start_s, 0.0, 1.0)
    return {"time_s": time, "shaft_speed_rpm": speed}


class TestDoubts:
    def test_a_good_record_has_none(self) -> None:
        assert doubts(channels(), PUMP) == ()
        for rate in (0.2, 1.0, 10.0, 60.0, 1000.0 / 60.0, 100.0):
            assert doubts(run_up(int(160 * rate), rate), PUMP) == ()

    @pytest.mark.parametrize("inverted", [lambda p: -p, lambda p: 1.0 - p, lambda p: 5.0 - p])
    def test_an_inverted_sensor(self, inverted: Any) -> None:
        found = channels()
        found["case_pressure_bar"] = inverted(found["case_pressure_bar"])
        (words,) = doubts(found, PUMP)
        assert "falls by 0.4 bar when the pump starts" in words
        del found["reservoir_pressure_bar"]
        assert len(doubts(found, PUMP)) == 1

    def test_a_reservoir_that_falls_takes_the_case_along(self) -> None:
        found = channels()
        fallen = np.where(found["shaft_speed_rpm"] > 0.0, -0.8, 0.0)
        found["case_pressure_bar"] += fallen
        found["reservoir_pressure_bar"] += fallen
        assert doubts(found, PUMP) == ()

    @pytest.mark.parametrize(("unit", "factor"), [("minutes", 60.0), ("hours", 3600.0)])
    @pytest.mark.parametrize("rate", [1.0, 2.0, 10.0])
    def test_a_time_in_another_unit(self, unit: str, factor: float, rate: float) -> None:
        found = run_up(int(160 * rate), rate)
        found["time_s"] = np.round(found["time_s"] / factor, 6 if unit == "minutes" else 9)
        (words,) = doubts(found, PUMP)
        assert f"looks like {unit}" in words

    def test_a_time_in_milliseconds(self) -> None:
        found = run_up(100, 1.0)
        found["time_s"] = found["time_s"] * 1000.0
        (words,) = doubts(found, PUMP)
        assert "milliseconds" in words

    def test_a_bench_whose_motor_is_quick(self) -> None:
        assert doubts(run_up(16_000, 100.0, start_s=0.8), PUMP) == ()


def test_verdicts_say_it(client: TestClient) -> None:
    inverted = document()
    inverted["channels"]["case_pressure_bar"] = [1.4 - p for p in inverted["channels"]["case_pressure_bar"]]
    answer = client.post("/api/v1/records", content=json.dumps(inverted), headers=JSON)
    assert answer.status_code == 201, answer.text
    assert any("inverted" in flag for flag in answer.json()["verdict"]["quality"]["flags"])


def sent(client: TestClient, n: int, at: datetime, hours: float) -> Any:
    changed = document()
    changed["channels"]["case_pressure_bar"] = [p + 1e-4 * n for p in changed["channels"]["case_pressure_bar"]]
    body = {**changed, "flight_id": f"F{n}", "started_at": at.isoformat(), "flight_hours": hours}
    answer = client.post("/api/v1/records", content=json.dumps(body), headers=JSON)
    assert answer.status_code == 201, answer.text
    return answer.json()


@pytest.mark.parametrize("lost", [datetime(2026, 4, 2, tzinfo=UTC), datetime(2006, 1, 1, tzinfo=UTC)])
@pytest.mark.parametrize("comes", ["first", "last"])
@pytest.mark.postgres_in_study
def test_a_wrong_date_in_front_of_a_history_is_found_by_those_behind_it(
    client: TestClient, lost: datetime, comes: str
) -> None:
    """A record of the history's end, by its flight hours, that bears a date before its beginning."""
    start = datetime(2026, 5, 2, 7, tzinfo=UTC)
    if comes == "first":
        sent(client, 9, lost, 320.0)
    for n in range(4):
        last = sent(client, n, start + timedelta(days=n), 300.0 + 2.0 * n)
    if comes == "last":
        body = {**document(), "flight_id": "F9", "started_at": lost.isoformat(), "flight_hours": 320.0}
        answer = client.post("/api/v1/records", content=json.dumps(body), headers=JSON)
        assert answer.status_code == 422  # those behind it are there to say so
        assert answer.json()["errors"][0]["where"] == "flight_hours"
        return
    verdict = last["verdict"]
    assert [f for f in verdict["quality"]["flags"] if "date" in f] == [
        "its date is not that of its flight, as the records behind it show: it is evidence of nothing until it is corrected "
        "(1 record)"
    ]
    alone = {**verdict["quality"], "flags": []}
    assert alone["records_used"] == 4


def test_a_cut_file_names_every_channel_that_it_lost() -> None:
    """Samples of one segment lie channel after channel: cut short, the last ones were never written."""
    whole = channels()
    names = [n for n in whole if n != "reservoir_pressure_bar"] + ["reservoir_pressure_bar"]
    file = io.BytesIO()
    with TdmsWriter(file) as writer:
        writer.write_segment([RootObject(METADATA), *(ChannelObject("g", name, whole[name]) for name in names)])
    content = file.getvalue()
    for lost in (whole["reservoir_pressure_bar"].nbytes, whole["reservoir_pressure_bar"].nbytes - 8):
        record = parsed(content[:-lost], LIMITS)
        assert any("cut short in its last segment" in flag for flag in record.flags)
        named = [flag for flag in record.flags if flag.startswith("reservoir_pressure_bar")]
        assert len(named) == 1, record.flags
