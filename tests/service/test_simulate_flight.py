"""A whole flight in quasi-steady form: from standstill at -45 degC to a record whose windows the service finds."""

import json
from pathlib import Path

import numpy as np
import pytest
from fastapi.testclient import TestClient
from typer.testing import CliRunner

from service.command_line.main import app
from service.studies.simulation.scenario_file import ScenarioFaultsError, read_scenario
from tests.service.matrix import API
from twin.condition import Condition
from twin.operating_point import operating_point
from twin.pumps import circuit_parameters, pump_type
from twin.simulation.flight import quasi_steady
from twin.simulation.run import steady_run
from twin.simulation.scenario import Scenario, Schedule

runner = CliRunner()
FLIGHT = Path(__file__).resolve().parents[2] / "docs" / "examples" / "cold-flight.toml"
PUMP, BENCH = pump_type("h225").pump, circuit_parameters("shared_return")


def test_the_example_is_a_flight_that_the_service_judges(tmp_path: Path, client: TestClient) -> None:
    record = tmp_path / "flight.csv"
    made = runner.invoke(app, ["simulate", str(FLIGHT), "--output", str(record), "--sensors", "helicopter", "--json"])
    assert made.exit_code == 0, made.output
    assert json.loads(made.stdout)["complete"] is True
    lines = [line for line in record.read_text().splitlines() if not line.startswith("#")]
    assert lines[0].startswith("time_s,discharge_pressure_bar")
    assert len(lines) == 1 + 3000
    told = client.post(f"{API}/records", content=record.read_bytes(), headers={"Content-Type": "text/csv"})
    assert told.status_code == 201, told.text
    accepted = {w["kind"] for w in told.json()["windows"] if w["accepted"]}
    assert {"pump_off", "zero_flow"} <= accepted


def test_every_instant_is_an_operating_point_and_standstill_is_the_reservoir() -> None:
    speeds = Schedule((1.0, 6.0, 18.0, 20.0), (0.0, 4600.0, 4600.0, 0.0))
    flows = Schedule((8.0, 9.0, 12.0, 13.0), (0.0, 10.0, 10.0, 0.0))
    changes = {"speed_rpm": speeds, "discharge_flow_lpm": flows}
    scenario = Scenario(21.0, Condition(0.0, 50.0, 0.4), changes=changes, quasi_steady=True)
    run = list(quasi_steady(PUMP, BENCH, scenario, 10.0))[-1]
    assert run.status.ok
    record = run.recording
    still = (record.time_s < 0.95) | (record.time_s > 20.05)
    assert np.allclose(record["case_pressure_bar"][still], 0.4)
    assert np.allclose(record["discharge_pressure_bar"][still], 0.4)
    assert np.allclose(record["case_flow_lpm"][still], 0.0)
    loaded = int(np.searchsorted(record.time_s, 10.0))
    point = operating_point(PUMP, Condition(4600.0, 50.0, 0.4, 10.0), BENCH)
    for name in (
        "discharge_pressure_bar",
        "case_pressure_bar",
        "case_flow_lpm",
        "shaft_torque_nm",
        "case_temperature_degc",
    ):
        assert record[name][loaded] == pytest.approx(point.value(name)[0], rel=1e-6), name
    # the plate lets the speed rise and the pressure hold: no jump between two samples of the run-up
    rising = (record.time_s > 1.0) & (record.time_s < 6.0)
    assert np.abs(np.diff(record["discharge_pressure_bar"][rising])).max() < 85.0


def test_the_channels_are_the_transients_own() -> None:
    """The same condition in both forms: means agree, and so do torque and case temperature."""
    condition = Condition(4600.0, 60.0, 0.4, 8.0)
    transient = steady_run(PUMP, condition, BENCH)
    steady = list(quasi_steady(PUMP, BENCH, Scenario(0.1, condition, quasi_steady=True), 10.0))[-1].recording
    assert set(steady.channels) <= set(transient.recording.channels)
    assert steady["shaft_torque_nm"][0] == pytest.approx(transient.mean("shaft_torque_nm", 4), abs=0.016)
    heated = transient.recording["case_temperature_degc"][-2000:].mean()
    assert steady["case_temperature_degc"][0] == pytest.approx(heated, abs=0.5)
    assert heated > 75.0


def test_what_a_quasi_steady_form_cannot_say_is_refused_with_every_fault() -> None:
    text = FLIGHT.read_text().replace("duration_s = 1500", "duration_s = 90000\nstep_s = 1e-5")
    with pytest.raises(ScenarioFaultsError) as caught:
        read_scenario(text.replace("speed_rpm = 0\n", "speed_rpm = -5\n"), 9)
    assert len(caught.value.faults) >= 2
    assert any("43200" in fault for fault in caught.value.faults)
    assert any("step_s" in fault for fault in caught.value.faults)
    with pytest.raises(ScenarioFaultsError, match="speed_rpm"):
        read_scenario(FLIGHT.read_text().replace('form = "quasi_steady"', 'form = "transient"'), 9)
    jammed = Scenario(1.0, Condition(4600.0, 50.0), changes={"spool_jamming_force_n": 50.0}, quasi_steady=True)
    with pytest.raises(ValueError, match="no steady state"):
        next(quasi_steady(PUMP, BENCH, jammed, 10.0))


def test_a_flow_that_no_pump_delivers_ends_the_flight_with_its_instant() -> None:
    flow = Schedule((1.0, 2.0), (0.0, 60.0))
    scenario = Scenario(3.0, Condition(4600.0, 50.0), changes={"discharge_flow_lpm": flow}, quasi_steady=True)
    run = list(quasi_steady(PUMP, BENCH, scenario, 10.0))[-1]
    assert not run.status.ok
    assert 1.4 < run.status.time_s < 1.6
    assert len(run.recording) == round(run.status.time_s * 10) - 1
