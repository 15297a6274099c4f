"""The guide of the seven-piston pump, command by command: drawing, ground run, verdict, service."""

import json
import re
import shlex
import tomllib
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from typer.testing import CliRunner

from service.command_line.main import app

GUIDE = (Path(__file__).resolve().parents[2] / "docs" / "another-pump.md").read_text(encoding="utf-8")
RUN = CliRunner()
API = "/api/v1"


def commands(word: str) -> list[str]:
    """Arguments of the guide's only command of that name."""
    lines = re.findall(r"^\$ casedrain (.*)$", GUIDE, re.MULTILINE)
    return next(shlex.split(line) for line in lines if line.split()[0] == word)


def ran(arguments: list[str]) -> str:
    answer = RUN.invoke(app, arguments)
    assert answer.exit_code == 0, answer.output
    return answer.output


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    (tmp_path / "ground-run.toml").write_text(re.findall(r"```toml\n(.*?)```", GUIDE, re.DOTALL)[0])
    return tmp_path


def residuals(arguments: list[str]) -> dict[str, dict[str, float]]:
    answer = RUN.invoke(app, [*arguments, "--json"])
    assert answer.exit_code == 0, answer.output
    document: dict[str, Any] = json.loads(answer.stdout[answer.stdout.index("{") :])
    file = document["pumps"][0]["files"][0]
    assert file["zero_flow_s"] is not None
    found: dict[str, dict[str, float]] = file["residuals"]
    return found


@pytest.mark.study
def test_the_guide_goes_all_the_way(folder: Path, client: TestClient) -> None:
    assert "seven.toml" in ran(commands("pump"))
    text = (folder / "seven.toml").read_text()
    assert text.startswith("# 20 L/min at 140 bar and 5000 rpm, scaled from h225, 7 pistons.")
    ran(commands("simulate"))
    sound = residuals(commands("analyse"))
    assert all(abs(r["value"]) < r["standard_deviation"] for r in sound.values())
    scenario = (folder / "ground-run.toml").read_text()
    (folder / "ground-run.toml").write_text(scenario + "[health]\nslipper_leakage_scale = 1.6\n")
    ran(commands("simulate"))
    worn = residuals(commands("analyse"))
    assert worn["case_pressure_bar"]["value"] > sound["case_pressure_bar"]["value"] + 0.05
    toml = {"content-type": "application/toml"}
    made = client.post(f"{API}/pump-types", content=text.encode(), headers=toml)
    assert made.status_code == 201, made.text
    assert made.json()["nominal_speed_rpm"] == 5000
    conditions = [{"speed_rpm": 5000, "fluid_temperature_degc": 50}]
    item = client.post(f"{API}/twin/operating-point", json={"pump_type": "seven", "conditions": conditions}).json()
    assert item["items"][0]["discharge_pressure_bar"] == pytest.approx(140.0, abs=0.2)


def test_a_type_that_breaks_its_own_limits_is_not_stored(folder: Path, client: TestClient) -> None:
    ran(["pump", "new", "small", "--flow", "12", "--pressure", "103", "--speed", "4600", "--pistons", "7"])
    document = tomllib.loads((folder / "small.toml").read_text())
    for end, value in (("low", 173.0), ("high", 177.0)):
        document["limits"][f"zero_flow_pressure_{end}_bar"]["value"] = value
    refused = client.post(f"{API}/pump-types", json=document)
    assert refused.status_code == 422, refused.text
    assert [e["where"] for e in refused.json()["errors"]] == [
        "body.sensors.discharge_pressure_bar",
        "body.limits.zero_flow_pressure_low_bar",
        "body.limits.zero_flow_pressure_high_bar",
    ]
    assert client.get(f"{API}/pump-types/small").status_code == 404


def test_a_drawing_out_of_range_names_every_fault() -> None:
    asked = ["pump", "new", "x", "--flow", "90", "--pressure", "90", "--speed", "4600", "--pistons", "4"]
    answer = RUN.invoke(app, asked)
    assert answer.exit_code == 2
    for word in ("flow: 90", "pressure: 90", "pistons: 4"):
        assert word in answer.output
