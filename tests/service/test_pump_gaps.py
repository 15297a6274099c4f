"""``casedrain pump gaps``: the metamodel of a set's own slipper gap, and where it is found again."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from service.command_line.main import app
from service.pump_types.parameter_files import named_or_written, whole_toml
from service.pump_types.slipper_maps import FOLDER, beside, take_all, written_map
from twin.parameters import PumpType
from twin.pumps import pump_type
from twin.slipper_maps import gap_numbers_hash, stored_map

runner = CliRunner()
THESIS = pump_type("h225_thesis")


def balanced(ratio: float) -> PumpType:
    """A set of its own with variable gaps."""
    quantities = {**THESIS.quantities}
    quantities["slipper.balance"] = replace(quantities["slipper.balance"], value=ratio)
    pump = THESIS.pump._replace(slipper=THESIS.pump.slipper._replace(balance=ratio))
    return replace(THESIS, name="balanced", pump=pump, quantities=quantities)


def document(kind: PumpType) -> str:
    """The thesis' metamodel as if it had been fitted to another set."""
    stored = stored_map(THESIS.pump)
    assert stored is not None
    return written_map(replace(stored, fitted_to=gap_numbers_hash(kind.pump)))


def test_a_metamodel_is_found_beside_its_parameter_file_and_in_an_installation(tmp_path: Path) -> None:
    kind, other = balanced(1.0241), balanced(1.0242)
    file = tmp_path / "balanced.toml"
    file.write_text(whole_toml(kind), encoding="utf-8")
    assert stored_map(named_or_written(str(file)).pump) is None
    beside(file).write_text(document(kind), encoding="utf-8")
    assert stored_map(named_or_written(str(file)).pump) is not None
    (tmp_path / FOLDER).mkdir()
    (tmp_path / FOLDER / "other.json").write_text(document(other), encoding="utf-8")
    assert stored_map(other.pump) is None
    take_all(tmp_path)
    assert stored_map(other.pump) is not None


def test_what_is_no_metamodel_is_said_with_its_file(tmp_path: Path) -> None:
    file = tmp_path / "balanced.toml"
    file.write_text(whole_toml(balanced(1.0243)), encoding="utf-8")
    for text in ("{", "[]", '{"fitted_to": 3}', '{"nodes": [["x"]]}'):
        beside(file).write_text(text, encoding="utf-8")
        with pytest.raises(ValueError, match=r"balanced\.gaps\.json"):
            named_or_written(str(file))


def test_a_constant_gap_needs_none() -> None:
    result = runner.invoke(app, ["pump", "gaps", "h225"])
    assert result.exit_code == 2
    assert "needs no metamodel" in result.output
    result = runner.invoke(app, ["pump", "gaps", "h225_thesis", "--picture", "x.pdf"])
    assert result.exit_code == 2
    assert ".svg" in result.output


@pytest.mark.study
def test_one_command_fits_any_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A few runs only: coarse, and said to be."""
    pytest.importorskip("sklearn")
    monkeypatch.chdir(tmp_path)
    kind = balanced(1.0244)
    Path("balanced.toml").write_text(whole_toml(kind), encoding="utf-8")
    asked = ["pump", "gaps", "balanced.toml", "--nodes", "120", "--held-out", "20", "--picture", "gaps.svg", "--json"]
    result = runner.invoke(app, asked)
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    assert told["fitted_to"] == gap_numbers_hash(kind.pump)
    assert told["errors"]["case_leakage_lpm"]["rms"] < 0.4
    assert Path("gaps.svg").read_text().count("<svg") == 1
    assert stored_map(named_or_written("balanced.toml").pump) is not None
