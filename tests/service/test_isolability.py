"""Isolability over the API and on the command line."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from typer.testing import CliRunner

from detectors.isolability.bounds import isolability
from detectors.isolability.plan import Plan, sensors_of
from service.command_line.main import app
from service.settings import Settings
from service.web.app import create_app
from twin.pumps import circuit_parameters, pump_type
from twin.pumps.fluids import with_fluid

URL = "/api/v1/twin/isolability"
runner = CliRunner()


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    """Nothing here reads the database: one of its own kind is enough."""
    settings = Settings(data_dir=tmp_path_factory.mktemp("data"), database_url="", auth="off")
    with TestClient(create_app(settings), base_url="http://localhost", raise_server_exceptions=False) as client:
        yield client


def test_defaults_are_the_pump_types_own_sensors(running: TestClient) -> None:
    answer = running.post(URL, json={})
    assert answer.status_code == 200
    pump = pump_type("h225")
    expected = isolability(Plan(sensors_of(pump)), pump, circuit_parameters("shared_return"))
    faults = answer.json()["faults"]
    assert list(faults) == [f.name for f in expected.faults]
    for fault in expected.faults:
        assert faults[fault.name]["smallest_detectable"] == pytest.approx(fault.smallest_detectable)
        assert len(faults[fault.name]["by_flights"]["smallest_isolable"]) == 30


def test_what_cannot_be_isolated_is_null_with_its_group(running: TestClient) -> None:
    document = running.post(URL, json={"temperature_range_degc": [50, 50]}).json()
    slippers = document["faults"]["leakage, slippers"]
    assert slippers["smallest_isolable"] is None
    assert "drain restriction" in slippers["ambiguity_group"]
    assert slippers["state"] == "pump_degradation"
    assert slippers["rivals"][0]["cosine"] > 0.999


def test_a_better_sensor_shows_less(running: TestClient) -> None:
    sizes = []
    for accuracy in (0.1, 1.0, 2.0):
        body = {"sensors": {"case_pressure_bar": {"accuracy_percent": accuracy}, "case_zero_measured": False}}
        sizes.append(running.post(URL, json=body).json()["faults"]["leakage, slippers"]["smallest_detectable"])
    assert sizes == sorted(sizes)
    assert sizes[0] < sizes[-1]


def test_without_a_reservoir_sensor(running: TestClient) -> None:
    document = running.post(URL, json={"sensors": {"reservoir_pressure_bar": None}, "burst": True}).json()
    assert "reservoir sensor" not in document["faults"]


def test_another_fluid_is_another_study(running: TestClient) -> None:
    own, thin = (running.post(URL, json={"fluid": name}).json() for name in (None, "MIL-PRF-87257"))
    assert (own["fluid"], thin["fluid"]) == (None, "MIL-PRF-87257")
    pump = with_fluid(pump_type("h225"), "MIL-PRF-87257")
    expected = isolability(Plan(sensors_of(pump)), pump, circuit_parameters("shared_return"))
    for fault in expected.faults:
        assert thin["faults"][fault.name]["smallest_detectable"] == pytest.approx(fault.smallest_detectable)
    assert thin["faults"]["leakage, mixed"] != own["faults"]["leakage, mixed"]


def test_every_fault_is_named(running: TestClient) -> None:
    body = {
        "fluid": "olive oil",
        "flights": 0,
        "temperature_range_degc": [80, 20],
        "sensors": {"case_pressure_bar": {"full_scale_bar": -1, "accuracy_percent": 90, "colour": "red"}},
        "brust": True,
    }
    answer = running.post(URL, json=body)
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"
    places = {e["where"] for e in answer.json()["errors"]}
    assert places == {
        "body.fluid",
        "body.flights",
        "body.temperature_range_degc",
        "body.sensors.case_pressure_bar.full_scale_bar",
        "body.sensors.case_pressure_bar.accuracy_percent",
        "body.sensors.case_pressure_bar.colour",
        "body.brust",
    }


def test_a_range_that_does_not_hold_the_pressure_is_refused_beside_an_unknown_type(running: TestClient) -> None:
    answer = running.post(URL, json={"pump_type": "x", "sensors": {"case_pressure_bar": {"full_scale_bar": 1.0}}})
    assert answer.status_code == 422
    places = [e["where"] for e in answer.json()["errors"]]
    assert places == ["body.pump_type", "sensors.case_pressure_bar.full_scale_bar"]


def test_command_prints_draws_and_writes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    picture, numbers = tmp_path / "a" / "picture.svg", tmp_path / "numbers.json"
    asked = ["isolability", "--temperatures", "50", "50", "--svg", str(picture), "--json", str(numbers)]
    result = runner.invoke(app, asked)
    assert result.exit_code == 0, result.output
    # a narrow terminal breaks "leakage, slippers" over two lines
    assert {"leakage,", "slippers"} <= set(result.output.split())
    assert "never" in result.output
    assert picture.read_text(encoding="utf-8").startswith("<svg")
    assert json.loads(numbers.read_text())["faults"]["leakage, slippers"]["smallest_isolable"] is None


def test_command_names_every_fault() -> None:
    result = runner.invoke(app, ["isolability", "--pump", "x", "--flights", "0", "--accuracy", "50"])
    assert result.exit_code == 2
    for words in ("pump: 'x'", "flights: 0", "sensors.case.accuracy_fs"):
        assert words in result.output
