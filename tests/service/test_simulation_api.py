"""The transient twin behind the API."""

import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient

from service.settings import Settings
from service.studies.simulation import requested
from service.web.app import create_app
from twin.condition import Condition
from twin.operating_point import operating_point
from twin.pumps import circuit_parameters, pump_type
from twin.pumps.fluids import with_fluid
from twin.recording import OPTIONAL_CHANNELS, REQUIRED_CHANNELS

URL = "/api/v1/twin/simulation"


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    """Nothing here reads the database: one of its own kind is enough."""
    settings = Settings(data_dir=tmp_path_factory.mktemp("data"), database_url="", auth="off")
    with TestClient(create_app(settings), base_url="http://localhost", raise_server_exceptions=False) as client:
        yield client


def simulated(client: TestClient, **body: Any) -> dict[str, np.ndarray]:
    answer = client.post(URL, json={"duration_s": 0.2, "sample_rate_hz": 2000, **body})
    assert answer.status_code == 200, answer.text
    return {name: np.array(values) for name, values in answer.json()["channels"].items()}


def test_channels_settle_at_the_operating_point(running: TestClient) -> None:
    channels = simulated(running, schedule={"speed_rpm": 4600, "fluid_temperature_degc": 60})
    assert set(REQUIRED_CHANNELS) <= set(channels)
    assert {*OPTIONAL_CHANNELS[:3], "suction_flow_lpm", "slipper_leakage_lpm"} <= set(channels)
    assert {len(v) for v in channels.values()} == {400}
    point = operating_point(pump_type("h225").pump, Condition(4600.0, 60.0), circuit_parameters("shared_return"))
    for name in ("discharge_pressure_bar", "case_pressure_bar", "case_flow_lpm"):
        assert channels[name][200:].mean() == pytest.approx(float(point.value(name)[0]), rel=0.01), name


def test_schedule_and_health_change_on_the_way(running: TestClient) -> None:
    channels = simulated(
        running,
        schedule={"time_s": [0.05, 0.05], "discharge_flow_lpm": [0.0, 5.0]},
        health={"pump_leakage_scale": {"time_s": [0.0, 0.2], "value": [1.0, 3.0]}, "slipper_gap_scale[2]": 1.2},
    )
    time, flow = channels["time_s"], channels["discharge_flow_lpm"]
    assert flow[time < 0.05] == pytest.approx(0.0, abs=1e-6)
    assert flow[time > 0.06] == pytest.approx(5.0, abs=0.2)
    assert channels["case_flow_lpm"][-100:].mean() > channels["case_flow_lpm"][:100].mean() + 0.2


def test_a_thinner_fluid_leaks_more(running: TestClient) -> None:
    own, thin = (simulated(running, fluid=name)["case_flow_lpm"][200:].mean() for name in (None, "MIL-PRF-87257"))
    kind = with_fluid(pump_type("h225"), "MIL-PRF-87257")
    point = operating_point(kind.pump, Condition(4600.0, 50.0), circuit_parameters("shared_return"))
    assert thin == pytest.approx(float(point.value("case_flow_lpm")[0]), rel=0.01)
    assert thin > own + 0.1


def test_every_fault_is_named(running: TestClient) -> None:
    body = {
        "pump_type": "x",
        "circuit": "y",
        "fluid": "olive oil",
        "duration_s": 100,
        "sample_rate_hz": 1,
        "schedule": {"time_s": [0, 1], "discharge_flow_lpm": [0], "speed_rpm": 99999, "mood": 2},
        "health": {"pump_leakage_scale": -3, "slipper_gap_scale[12]": 1.5, "luck": 1},
    }
    answer = running.post(URL, json=body)
    assert answer.status_code == 422
    assert {e["where"] for e in answer.json()["errors"]} == {
        "pump_type",
        "circuit",
        "fluid",
        "duration_s",
        "schedule.discharge_flow_lpm",
        "schedule.mood",
        "schedule.speed_rpm",
        "health.pump_leakage_scale",
        "health.slipper_gap_scale[12]",
        "health.luck",
    }


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({"duration_s": 11, "sample_rate_hz": 100}, "above 0 to 10 s"),
        ({"duration_s": 4, "sample_rate_hz": 10_000}, "at most 30000"),
        ({"duration_s": 1, "schedule": {"time_s": [0.001 * i for i in range(1001)]}}, "at most 1000"),
    ],
)
def test_too_long_a_run_is_refused_with_the_limit(running: TestClient, body: dict[str, Any], words: str) -> None:
    answer = running.post(URL, json=body)
    assert answer.status_code == 422
    assert words in answer.json()["errors"][0]["problem"]


def test_a_list_needs_its_instants(running: TestClient) -> None:
    answer = running.post(URL, json={"duration_s": 0.1, "schedule": {"discharge_flow_lpm": [0, 1]}})
    assert answer.json()["errors"] == [
        {"where": "schedule.discharge_flow_lpm", "problem": "is a list without schedule.time_s"}
    ]


def test_more_flow_than_the_pump_delivers_says_what_to_do(running: TestClient) -> None:
    answer = running.post(URL, json={"duration_s": 0.1, "schedule": {"discharge_flow_lpm": 90}})
    assert answer.status_code == 422
    assert "less flow" in answer.json()["detail"]


def test_the_service_answers_while_a_simulation_runs(running: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    """The run is held until the other request has come back: were it on the event loop, both would wait for ever."""
    begun, may_end = threading.Event(), threading.Event()
    simulate = requested.simulate

    def held(*args: Any, **options: Any) -> Any:
        begun.set()
        assert may_end.wait(60)
        return simulate(*args, **options)

    monkeypatch.setattr(requested, "simulate", held)
    statuses = []
    body = {"duration_s": 0.01}
    runner = threading.Thread(target=lambda: statuses.append(running.post(URL, json=body).status_code))
    runner.start()
    assert begun.wait(60)
    assert running.get("/healthz").status_code == 200
    may_end.set()
    runner.join(60)
    assert statuses == [200]


def test_slippers_by_their_metamodel_are_asked_for_by_name(running: TestClient) -> None:
    """A type with variable gaps runs by it; one with constant gaps has none, and says so."""
    body = {"duration_s": 0.1, "sample_rate_hz": 1000, "slipper_gaps": "metamodel"}
    answer = running.post(URL, json={**body, "pump_type": "h225_thesis", "schedule": {"discharge_flow_lpm": 20.0}})
    assert answer.status_code == 200, answer.text
    assert "outside" not in answer.json()
    flow = np.array(answer.json()["channels"]["case_flow_lpm"][50:]).mean()
    point = operating_point(
        pump_type("h225_thesis").pump, Condition(4600, 50, 0, 20), circuit_parameters("shared_return")
    )
    assert flow == pytest.approx(point.value("case_flow_lpm")[0], abs=0.01)
    far = running.post(URL, json={**body, "pump_type": "h225_thesis", "health": {"slipper_leakage_scale": 20.0}})
    assert far.json()["outside"] == ["slipper.metamodel"]
    refused = running.post(URL, json=body)
    assert refused.status_code == 422
    assert [e["where"].removeprefix("body.") for e in refused.json()["errors"]] == ["slipper_gaps"]
    assert "constant" in refused.json()["errors"][0]["problem"]
    assert running.post(URL, json={**body, "slipper_gaps": "guessed"}).status_code == 422
