"""Spectrum of a record: density and orders against a signal whose content is known."""

import math
from typing import Any

import numpy as np
from fastapi.testclient import TestClient

from tests.service.bursts import RATE, N, burst_document
from tests.service.test_jobs import API


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
