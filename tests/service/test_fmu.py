"""The exported FMU, run by a foreign simulator, beside the operating point that it was made from."""

import subprocess
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fmpy import read_model_description, simulate_fmu
from fmpy.validation import validate_fmu
from typer.testing import CliRunner

from service.command_line.main import app
from service.studies.fmu.export import INPUTS, output_name
from service.studies.fmu.table import LEAKAGES, SHARES, SPEEDS
from twin.condition import OUTPUTS, Condition, Health
from twin.operating_point import operating_point
from twin.operating_point.validity import geometric_delivery
from twin.pumps import circuit_parameters, pump_type

KIND, BENCH = pump_type("h225"), circuit_parameters("shared_return")
NAMES = [output_name(name) for name in OUTPUTS]
RUN = CliRunner()


@pytest.fixture(scope="module", params=["2.0", "3.0"])
def fmu(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("fmu") / "pump.fmu"
    ran = RUN.invoke(app, ["export-fmu", str(path), "--fmi", request.param])
    assert ran.exit_code == 0, ran.output
    return path


def last(fmu: Path, values: dict[str, float]) -> dict[str, float]:
    found = simulate_fmu(str(fmu), stop_time=0.2, output_interval=0.1, start_values=values, output=[*NAMES, "status"])
    return {name: float(found[name][-1]) for name in (*NAMES, "status")}


def solved(values: dict[str, float]) -> dict[str, float]:
    condition = Condition(**{name: values[name] for name in INPUTS[:4]})
    health = Health(**{name: values[name] for name in INPUTS[4:]})
    point = operating_point(KIND.pump, condition, BENCH, health)
    return {output_name(name): float(point.value(name)[0]) for name in OUTPUTS}


def asked(speed: float, temperature: float, flow: float, leakage: float = 1.0, **more: float) -> dict[str, float]:
    usual = dict(zip(INPUTS, (speed, temperature, flow, 0.0, leakage, 0.0, 0.0, 1.0), strict=True))
    return usual | more


def test_description_is_valid_and_names_the_twins_quantities(fmu: Path) -> None:
    assert validate_fmu(str(fmu)) == []
    described = {v.name: v.causality for v in read_model_description(str(fmu)).modelVariables}
    assert {n for n, role in described.items() if role == "parameter"} == set(INPUTS[4:])
    assert {n for n, role in described.items() if role == "output"} == {*NAMES, "status"}
    with zipfile.ZipFile(fmu) as archive:
        assert any(name.startswith("binaries/") for name in archive.namelist())
        assert "python" not in archive.read("sources/model.c").decode().lower()


def test_at_a_node_of_the_table_it_is_the_operating_point(fmu: Path) -> None:
    swept = geometric_delivery(KIND.pump, 1.0)
    for speed, T, share, leakage in ((SPEEDS[4], 50.0, 0.0, 1.0), (SPEEDS[2], 80.0, SHARES[6], LEAKAGES[3])):
        n = speed * KIND.nominal_speed_rpm
        values = asked(n, T, share * n * swept, leakage)
        found, truth = last(fmu, values), solved(values)
        assert found["status"] == 0
        assert [found[name] for name in NAMES] == pytest.approx([truth[name] for name in NAMES], rel=1e-6, abs=1e-6)


def test_between_nodes_it_stays_close(fmu: Path) -> None:
    rng = np.random.default_rng(5)
    swept = geometric_delivery(KIND.pump, 1.0)
    for _ in range(12):
        speed = rng.uniform(2000.0, 5500.0)
        values = asked(
            speed,
            rng.uniform(20.0, 100.0),
            rng.uniform(0.0, 0.85) * speed * swept,
            rng.uniform(0.6, 3.0),
            reservoir_pressure_bar=rng.uniform(0.0, 1.0),
            system_leakage_lpm=rng.uniform(0.0, 0.5),
            pressure_setting_change_bar=rng.uniform(-2.0, 2.0),
            drain_resistance_scale=rng.uniform(0.8, 1.2),
        )
        found, truth = last(fmu, values), solved(values)
        assert found["discharge_pressure_bar"] == pytest.approx(truth["discharge_pressure_bar"], abs=0.3)
        assert found["case_pressure_bar"] == pytest.approx(truth["case_pressure_bar"], abs=0.03)
        assert found["case_flow_lpm"] == pytest.approx(truth["case_flow_lpm"], rel=0.02)
        assert found["shaft_torque_nm"] == pytest.approx(truth["shaft_torque_nm"], rel=0.02)


def test_beyond_the_table_it_says_so(fmu: Path) -> None:
    assert last(fmu, asked(9000.0, 50.0, 0.0))["status"] == 1
    swept = geometric_delivery(KIND.pump, 1.0)
    assert last(fmu, asked(4600.0, 50.0, 1.0 * 4600.0 * swept))["status"] == 2


def test_sources_build_by_themselves(fmu: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(tmp_path)
    built = ["cc", "-std=c99", "-shared", "-fPIC", "model.c", "-o", "model.so", "-lm"]
    assert subprocess.run(built, cwd=tmp_path / "sources", capture_output=True, check=False).returncode == 0


def test_what_cannot_be_exported_is_said(tmp_path: Path) -> None:
    for words, told in ((["x.zip"], "ends not in .fmu"), (["x.fmu", "--fmi", "1.0"], "is not one of 2.0, 3.0")):
        ran = RUN.invoke(app, ["export-fmu", *words])
        assert ran.exit_code == 2
        assert told in ran.output
