"""The tutorial's commands do what it says, in order, beside a running service."""

import re
import shlex
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from service.client import Client
from service.command_line.main import app
from service.demo.run import served
from service.ingest.mapping import ChannelMapping, ChannelRule, TimeRule
from service.ingest.mapping_files import mapping_of_file
from service.settings import Settings
from tests.service.exports import FOLDER

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "your-own-export.md").read_text(encoding="utf-8")


@pytest.mark.study
def test_the_commands_of_the_tutorial_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(FOLDER, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setenv("CASEDRAIN_DATA_DIR", str(tmp_path / "data"))
    monkeypatch.setenv("CASEDRAIN_URL", "http://127.0.0.1:8736")
    blocks = re.findall(r"```sh\n(.*?)```", PAGE, flags=re.DOTALL)
    commands = [shlex.split(line)[1:] for block in blocks for line in block.splitlines()]
    assert len(commands) == 5
    said = []
    with served(Settings(auth="off"), "127.0.0.1", 8736) as address:
        for command in commands:
            result = CliRunner().invoke(app, command)
            assert result.exit_code == 0, f"{command}: {result.output}"
            said.append(result.output)
        by_name = CliRunner().invoke(app, ["upload", "german.csv", "--mapping", "german"])
        assert by_name.exit_code == 0, by_name.output
        other = tmp_path / "other.json"
        other.write_text('{"name": "german", "defaults": {"position": "RH"}}')
        differs = CliRunner().invoke(app, ["upload", "german.csv", "--mapping", "other.json"])
        assert differs.exit_code == 1
        assert "says something else" in differs.output
        with Client(address) as client:
            flights = {record["flight_id"]: record["status"] for record in client.records()}
            assert {mapping["name"] for mapping in client.mappings()} == {"german", "spreadsheet"}
    assert "could not tell" in said[0]
    proposed, completed = (
        mapping_of_file(tmp_path / "proposed.json").mapping,
        mapping_of_file(tmp_path / "german.mapping.json"),
    )
    assert {(r.source, r.channel) for r in proposed.channels} == {
        (r.source, r.channel) for r in completed.mapping.channels
    }
    assert "insufficient_data" in said[1]
    assert flights == {"317": "analysed", "318": "analysed", "320": "analysed"}
    again = CliRunner().invoke(app, ["map", "german.csv", "--output", "proposed.json"])
    assert again.exit_code == 1
    assert "exists already" in again.output


def test_every_word_of_the_language_is_on_the_page() -> None:
    for model in (ChannelMapping, ChannelRule, TimeRule):
        missing = [name for name in model.model_fields if f"`{name}`" not in PAGE and name != "csv"]
        assert not missing
    from service.ingest.csv_rule import CsvRule

    assert not [name for name in CsvRule.model_fields if f"`{name}`" not in PAGE]


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (["analyse", "german.csv", "--set", "colour=red"], "--set colour=red"),
        (["analyse", "german.csv", "--set", "position"], "write key=value"),
        (["analyse", "german.csv", "--set", "position=a", "--set", "position=b"], "twice"),
        (["analyse", "german.csv", "--name-pattern", "{colour}"], "colour cannot be read"),
        (["analyse", "german.csv", "--mapping", "nowhere"], "is no file"),
        (["analyse", "german.csv", "--mapping", "bad.json"], "did you mean psi"),
        (["map", "plain-record.csv", "--output", "nowhere/x.json"], "cannot be written"),
    ],
)
def test_what_is_asked_wrongly_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: list[str], words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("CASEDRAIN_DATA_DIR", str(tmp_path / "data"))
    for name in ("german.csv", "plain-record.csv"):
        shutil.copy(FOLDER / name, tmp_path)
    rules = '[{"source": "a", "channel": "case_pressure_bar", "unit": "pis"}, {"channel": "time_s"}]'
    (tmp_path / "bad.json").write_text(f'{{"channels": {rules}}}')
    result = CliRunner().invoke(app, command)
    assert result.exit_code in (1, 2)
    assert words in result.output
