"""``casedrain identify``: from a bench's CSV to a parameter set that other commands and the API take."""

import json
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from service.command_line.main import app
from service.pump_types.parameter_files import named_or_written, whole_toml
from tests.twin.test_identification import BENCH, DEVIATIONS, FACTORS, measured
from twin.pumps import pump_type
from twin.pumps.written import pump_type_from

RUN = CliRunner()


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    names = list(DEVIATIONS)
    header = ["speed_rpm", "fluid_temperature_degc", "reservoir_pressure_bar", "discharge_flow_lpm"]
    lines = ["# bench 3", ",".join([*header, *(c for n in names for c in (n, f"{n}_sd"))])]
    for c, point in zip(BENCH, measured(BENCH, 5), strict=True):
        condition = (c.speed_rpm, c.fluid_temperature_degc, c.reservoir_pressure_bar, c.discharge_flow_lpm)
        lines.append(",".join(f"{v:.9g}" for v in (*condition, *(v for n in names for v in point.measured[n]))))
    path = tmp_path / "bench.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_bench_run_becomes_a_pump_type(bench: Path, tmp_path: Path) -> None:
    written, numbers = tmp_path / "mine.toml", tmp_path / "mine.json"
    ran = RUN.invoke(app, ["identify", str(bench), "--id", "mine", "--output", str(written), "--json", str(numbers)])
    assert ran.exit_code == 0, ran.output
    assert "piston.b is not determined" in ran.output
    kind = pump_type_from(tomllib.loads(written.read_text()))
    assert kind.name == "mine"
    assert kind == named_or_written(str(written))
    gap = kind.quantities["slipper.h"]
    assert gap.value == pytest.approx(FACTORS["slipper.h"] * 8.74348, rel=0.05)
    assert gap.source.startswith("identified from bench.csv on ")
    assert kind.quantities["piston.b"].source.endswith("decided by the prior, not by the points")
    document = json.loads(numbers.read_text())
    assert len(document["residuals"]) == len(BENCH) * len(DEVIATIONS)
    assert len(document["covariance"]) == len(document["estimates"])
    scenario = tmp_path / "short.toml"
    scenario.write_text("duration_s = 0.01\n[condition]\nspeed_rpm = 4600\nfluid_temperature_degc = 50\n")
    record = tmp_path / "record.csv"
    ran = RUN.invoke(app, ["simulate", str(scenario), "--output", str(record), "--pump", str(written)])
    assert ran.exit_code == 0, ran.output
    assert "# pump_type: mine" in record.read_text()


def test_every_fault_of_the_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(
        "speed_rpm,case_flow_lpm,case_flow_lpm_sd,shaft_torque_nm,mood\n"
        "4600,one,0.01,2.4,good\n4600,1.2,,2.4,1\n4600,1.2\n"
    )
    ran = RUN.invoke(app, ["identify", str(path), "--id", "x", "--output", str(tmp_path / "x.toml")])
    assert ran.exit_code == 2
    for words in (
        "column 'mood' is not known",
        "column 'fluid_temperature_degc' is missing",
        "column shaft_torque_nm_sd is missing",
        "line 2: case_flow_lpm is 'one'",
        "line 3: case_flow_lpm_sd is missing",
        "line 4: has 2 cells",
    ):
        assert words in ran.output
    assert not (tmp_path / "x.toml").exists()


def test_a_misfit_is_an_error_and_leaves_no_file(bench: Path, tmp_path: Path) -> None:
    lines = bench.read_text().splitlines()
    cells = lines[4].split(",")
    cells[lines[1].split(",").index("case_flow_lpm")] = "3.5"
    bench.write_text("\n".join([*lines[:4], ",".join(cells), *lines[5:]]) + "\n")
    written = tmp_path / "mine.toml"
    asked = ["identify", str(bench), "--id", "mine", "--output", str(written)]
    ran = RUN.invoke(app, asked)
    assert ran.exit_code == 1
    assert "no pump of this type explains the points" in ran.output
    assert not written.exists()
    ran = RUN.invoke(app, [*asked, "--keep-misfit"])
    assert ran.exit_code == 0, ran.output
    assert "p = " in written.read_text()


def test_a_parameter_file_is_a_start_as_well(bench: Path, tmp_path: Path) -> None:
    start, written = tmp_path / "start.toml", tmp_path / "mine.toml"
    start.write_text(whole_toml(replace(pump_type("h225"), name="rebuilt"), ("from drawing",)))
    asked = ["identify", str(bench), "--id", "mine", "--output", str(written), "--pump", str(start)]
    ran = RUN.invoke(app, asked)
    assert ran.exit_code == 0, ran.output
    # whole, because nobody else has its base
    kind = named_or_written(str(written))
    assert kind.name == "mine"
    assert kind.quantities["slipper.h"].value == pytest.approx(FACTORS["slipper.h"] * 8.74348, rel=0.05)
