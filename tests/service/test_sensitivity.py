"""Sensitivity: indices against a linear truth, bands against the spreads, the command and its faults; notebooks' example."""

import json
import runpy
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from service.command_line.main import app
from service.studies.sensitivity import Range, Sensitivity, factors_of, sensitivity
from twin.condition import Condition
from twin.operating_point import operating_point
from twin.operating_point.operating_map import operating_map
from twin.pumps import circuit_parameters, pump_type
from twin.pumps.circuit_sets import CIRCUIT_SETS

KIND, BENCH = pump_type("h225"), CIRCUIT_SETS["shared_return"]
HERE = Condition(4600.0, 50.0)
RUN = CliRunner()
RANGES = [Range("pressure_setting_change_bar", -1.0, 1.0), Range("system_leakage_lpm", 0.0, 0.5)]


def study(method: str, samples: int) -> Sensitivity:
    factors = factors_of(KIND, BENCH, [], RANGES)
    return sensitivity(KIND, BENCH, HERE, factors, ["discharge_pressure_bar", "case_pressure_bar"], method, samples)


def test_sobol_splits_the_variance_of_two_nearly_linear_inputs() -> None:
    point = operating_point(KIND.pump, HERE, circuit_parameters("shared_return"), derivatives=True)
    found = study("sobol", 128)
    for output, indices in found.indices.items():
        # variance of a uniform input: slope^2 width^2 / 12
        parts = np.array([(point.derivative(output, r.name)[0] * (r.high - r.low)) ** 2 for r in RANGES])
        assert indices["ST"] == pytest.approx(parts / parts.sum(), abs=0.05)
        assert indices["S1"] == pytest.approx(indices["ST"], abs=0.1)
    low, median, high = found.bands["discharge_pressure_bar"]
    # 5 and 95 % of a uniform setting within 1 bar, of which 0.96 arrive
    assert (high - low) == pytest.approx(1.8 * 0.96, abs=0.06)
    assert median == pytest.approx(point.value("discharge_pressure_bar")[0], abs=0.1)
    assert (found.points, found.unsolved) == (128 * 4, 0)


def test_morris_gives_the_effect_over_the_whole_range() -> None:
    point = operating_point(KIND.pump, HERE, circuit_parameters("shared_return"), derivatives=True)
    found = study("morris", 10)
    slope = point.derivative("discharge_pressure_bar", "pressure_setting_change_bar")[0]
    assert found.indices["discharge_pressure_bar"]["mu_star"][0] == pytest.approx(2.0 * slope, rel=0.02)
    assert found.indices["discharge_pressure_bar"]["sigma"][0] < 0.02


def test_the_command_says_what_moves_the_case_flow(tmp_path: Path) -> None:
    path = tmp_path / "found.json"
    asked = ["sensitivity", "--output", "case_flow_lpm", "--samples", "32", "--json", str(path)]
    ran = RUN.invoke(app, asked)
    assert ran.exit_code == 0, ran.output
    document = json.loads(path.read_text())
    indices = dict(zip(document["factors"], document["outputs"]["case_flow_lpm"]["indices"]["ST"], strict=True))
    # leakage grows with the cube of a gap: gaps move it, friction does not
    assert max(indices, key=lambda name: indices[name]) in ("slipper.h", "port_plate.h", "compensator.d_bleed")
    assert abs(indices["drive.torque_pressure"]) < 1e-6
    band = document["outputs"]["case_flow_lpm"]["band"]
    assert band["low"] < 1.15 < band["high"]


def test_every_fault_of_a_call_is_named() -> None:
    for asked, words in (
        (["--vary", "speed_rpm"], ["is not NAME=LOW:HIGH"]),
        (["--vary", "mood=1:2", "--vary", "speed_rpm=5000:4000"], ["no input 'mood'", "does not rise"]),
        (["--at", "mood=1", "--at", "speed_rpm=x"], ["--at mood", "is not NAME=VALUE"]),
        (["--free", "slipper.x"], ["no number 'slipper.x'"]),
        (["--output", "joy", "--method", "guess", "--samples", "3"], ["no output 'joy'", "no method 'guess'"]),
    ):
        ran = RUN.invoke(app, ["sensitivity", *asked])
        assert ran.exit_code == 2
        assert all(word in ran.output for word in words), ran.output


def test_twelve_lines_make_an_operating_map(capsys: pytest.CaptureFixture[str]) -> None:
    example = Path(__file__).resolve().parents[2] / "docs" / "examples" / "operating_map.py"
    lines = [line for line in example.read_text().splitlines() if line.strip() and not line.startswith('"""')]
    assert len(lines) <= 12
    runpy.run_path(str(example))
    printed = capsys.readouterr().out.splitlines()
    assert len(printed) == 8
    most = [float(line.split()[2]) for line in printed]
    # delivery goes with the speed: swept volume 6.36 cm3
    assert most == sorted(most)
    assert most[0] == pytest.approx(0.97 * 6.36 * 2.0, abs=2.0)


def test_a_map_says_where_there_is_nothing_and_what_lies_outside() -> None:
    found = operating_map(KIND, circuit_parameters("shared_return"), [4600.0, 6000.0], [0.0, 20.0, 35.0])
    assert found["case_flow_lpm"].shape == (2, 3)
    assert np.isnan(found["case_flow_lpm"][0, 2])
    assert found.outside.tolist() == [[False, False, False], [True, True, True]]
    one = operating_point(KIND.pump, Condition(4600.0, 50.0, 0.0, 20.0), circuit_parameters("shared_return"))
    assert found["shaft_torque_nm"][0, 1] == pytest.approx(one.value("shaft_torque_nm")[0], rel=1e-9)
