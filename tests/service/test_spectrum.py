"""Spectrum of a record: density and orders against a signal whose content is known."""

import math
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient

from service.reading.channel_spectrum import channel_spectrum
from tests.service.bursts import RATE, N, burst_document
from tests.service.test_jobs import API
from twin.pumps import pump_type
from twin.recording import Recording


def burst(client: TestClient, rate: float = RATE, n: int = N, **changes: Any) -> str:
    """Upload a burst: the record's id."""
    answer = client.post(f"{API}/records", json=burst_document(rate, n, **changes))
    assert answer.status_code == 201, answer.text
    return str(answer.json()["record_id"])


def test_orders_and_density_are_those_of_the_signal(client: TestClient) -> None:
    record_id = burst(client)
    url = f"{API}/records/{record_id}/spectrum"
    found = client.get(url, params={"channel": "discharge_pressure_bar", "start_s": 0}).json()
    first, ninth, eighteenth = found["orders"]
    assert [line["order"] for line in found["orders"]] == [1, 9, 18]
    assert abs(first["amplitude"] - 0.3) < 4 * first["standard_error"]
    assert abs(first["phase_deg"] - 40.0) < 4 * math.degrees(first["standard_error"] / 0.3)
    assert abs(ninth["amplitude"] - 1.2) < 4 * ninth["standard_error"]
    assert eighteenth["amplitude"] < 4 * eighteenth["standard_error"]
    assert abs(first["standard_error"] / (0.1 * math.sqrt(2 / N)) - 1) < 0.1
    density = found["density"]
    assert density["unit"] == "bar^2/Hz"
    frequency, value = np.array(density["frequency_hz"]), np.array(density["value"])
    assert abs(frequency[np.argmax(value)] - 9 * found["shaft_speed_rpm"] / 60.0) < 5.0
    quiet = (frequency > 1000) & (frequency < 1900)
    # white noise of 0.1 bar spreads evenly up to half the sampling rate
    assert abs(value[quiet].mean() / (0.01 / (RATE / 2)) - 1) < 0.1


@pytest.mark.parametrize(
    "what", ["a fifth of the rows", "a fifth of the samples", "speed every 100 ms", "jitter of 20 us"]
)
def test_what_a_recorder_loses_moves_no_line(what: str) -> None:
    """Straight from the recording: every record of the API is conditioned in the same way."""
    channels = {k: np.array(v, dtype=float) for k, v in burst_document(RATE, N)["channels"].items()}
    rng = np.random.default_rng(2)
    if what == "a fifth of the rows":
        kept = rng.random(N) > 0.2
        channels = {name: samples[kept] for name, samples in channels.items()}
    elif what == "a fifth of the samples":
        channels = {n: x if n == "time_s" else np.where(rng.random(N) < 0.2, np.nan, x) for n, x in channels.items()}
    elif what == "speed every 100 ms":
        slow = np.full(N, np.nan)
        slow[:: int(0.1 * RATE)] = channels["shaft_speed_rpm"][:: int(0.1 * RATE)]
        channels["shaft_speed_rpm"] = slow
    else:
        channels["time_s"] = channels["time_s"] + rng.uniform(-2e-5, 2e-5, N)
    found = channel_spectrum(Recording(channels), "discharge_pressure_bar", pump_type("h225"), -1.0, 1e9)
    first, ninth, _ = found["orders"]
    assert first["amplitude"] == pytest.approx(0.3, rel=0.04)
    assert ninth["amplitude"] == pytest.approx(1.2, rel=0.04)


def test_a_slow_record_says_what_would_do(client: TestClient) -> None:
    rng = np.random.default_rng(5)
    slow = burst(client, rate=10.0, n=400, discharge_pressure_bar=175.0 + rng.normal(0, 0.1, 400))
    answer = client.get(f"{API}/records/{slow}/spectrum", params={"channel": "discharge_pressure_bar", "start_s": 0})
    assert answer.status_code == 422
    assert "at least 170 Hz" in answer.json()["detail"]
    middling = client.get(f"{API}/records/{slow}/spectrum", params={"channel": "none"})
    assert middling.status_code == 422
    assert "case_pressure_bar" in middling.json()["errors"][0]["problem"]
    assert client.get(f"{API}/records/none/spectrum", params={"channel": "x"}).status_code == 404


def test_orders_beyond_the_sampling_say_so(client: TestClient) -> None:
    record_id = burst(client, rate=400.0, n=2000)
    params: dict[str, Any] = {"channel": "discharge_pressure_bar", "start_s": 0}
    found = client.get(f"{API}/records/{record_id}/spectrum", params=params).json()
    assert found["orders"][0]["amplitude"] is not None
    assert found["orders"][1]["amplitude"] is None
    assert "too slow" in found["orders"][1]["reason"]
    empty = {**params, "start_s": 3, "end_s": 2}
    assert client.get(f"{API}/records/{record_id}/spectrum", params=empty).status_code == 422
