"""The command line as a user meets it."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from service.access.security import principal_of
from service.command_line.main import app
from service.demo.fleet import DemoRecord
from service.demo.run import served
from service.settings import Settings
from service.storage.database import Database

runner = CliRunner()


@pytest.fixture(autouse=True)
def _own_data_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CASEDRAIN_DATA_DIR", str(tmp_path / "data"))
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def files(tmp_path: Path, worn_records: list[DemoRecord]) -> list[str]:
    paths = []
    for i, record in enumerate(worn_records):
        path = tmp_path / f"flight-{i:02d}.csv"
        path.write_bytes(record.content)
        paths.append(str(path))
    return paths


def test_version_and_help() -> None:
    assert runner.invoke(app, ["--version"]).output.startswith("casedrain ")
    commands = runner.invoke(app, ["--help"]).output
    assert all(name in commands for name in ("demo", "serve", "upload", "analyse", "keys", "db"))


def test_analyse_gives_verdict_and_picture_without_a_server(files: list[str], tmp_path: Path) -> None:
    result = runner.invoke(app, ["analyse", *files, "--output", "pictures"])
    assert result.exit_code == 0, result.output
    assert "pump_degradation" in result.output
    picture = tmp_path / "pictures" / "DT-102-damage-identification-curve.svg"
    assert picture.read_text(encoding="utf-8").startswith("<svg")
    assert not (tmp_path / "data").exists()


def test_analyse_names_every_fault_and_keeps_the_good_files(files: list[str], tmp_path: Path) -> None:
    bad = tmp_path / "bad.csv"
    bad.write_text("# pump_serial: X\ntime_s,case_pressure_bar\n1,abc\n0,1\n")
    result = runner.invoke(app, ["analyse", str(bad), *files[:2]])
    assert result.exit_code == 1
    assert "line 3, case_pressure_bar: 'abc' is not a number" in result.output
    assert "channels.shaft_speed_rpm: is missing" in result.output
    assert "Pump DT-102" in result.output


def test_upload_through_a_running_server(files: list[str], tmp_path: Path) -> None:
    bad = tmp_path / "bad.csv"
    bad.write_text("not a record")
    with served(Settings(auth="off"), "127.0.0.1", 8731) as address:
        good = runner.invoke(app, ["upload", *files[:3], "--url", address])
        assert good.exit_code == 0, good.output
        assert good.output.count("analysed") == 3
        mixed = runner.invoke(app, ["upload", str(bad), files[0], "--url", address])
        assert mixed.exit_code == 1
        assert "refused" in mixed.output
        assert "analysed" in mixed.output


@pytest.mark.study
def test_upload_takes_folders_and_patterns_and_goes_on(files: list[str], tmp_path: Path) -> None:
    folder = tmp_path / "day"
    (folder / "deeper").mkdir(parents=True)
    for i, file in enumerate(files[:3]):
        (folder / ("deeper" if i else "") / f"{i}.csv").write_bytes(Path(file).read_bytes())
    (folder / "notes.txt").write_text("not a record")
    with served(Settings(auth="off"), "127.0.0.1", 8733) as address:
        first = runner.invoke(app, ["upload", str(folder), "--url", address])
        assert first.exit_code == 0, first.output
        assert first.output.count("analysed") == 3
        again = runner.invoke(app, ["upload", f"{folder}/**/*.csv", str(folder), files[3], "--url", address])
        assert again.exit_code == 0, again.output
        assert again.output.count("analysed") == 4
        nothing = runner.invoke(app, ["upload", str(folder / "*.pdf"), files[4], "--url", address])
        assert nothing.exit_code == 2
        unmapped = runner.invoke(app, ["upload", files[5], "--mapping", "none", "--url", address])
        assert unmapped.exit_code == 1
        assert "no channel mapping none" in unmapped.output
        dry = runner.invoke(app, ["reprocess", "--dry-run", "--url", address])
        assert dry.exit_code == 0, dry.output
        assert "DT-102 (default): 0 of 4 verdicts differ" in dry.output
        versions = ["--threshold-version", "0", "--only-verdicts", "--dry-run"]
        earlier = runner.invoke(app, ["reprocess", *versions, "--url", address])
        assert earlier.exit_code == 0, earlier.output
        other = runner.invoke(app, ["reprocess", "--twin-version", "h225-0-0", "--url", address])
        assert other.exit_code == 1
        assert "this installation can run h225-" in other.output
        wrong = runner.invoke(app, ["reprocess", "--pump", "none", "--url", address])
        assert wrong.exit_code == 1
        assert "no pump none" in wrong.output


def test_upload_without_a_server_says_what_to_do(files: list[str]) -> None:
    result = runner.invoke(app, ["upload", files[0], "--url", "http://127.0.0.1:9"])
    assert result.exit_code == 1
    assert "casedrain serve" in result.output


def test_keys_create_prints_a_key_that_works(tmp_path: Path) -> None:
    result = runner.invoke(app, ["keys", "create", "--role", "analyst", "--operator", "north"])
    assert result.exit_code == 0, result.output
    key = result.output.strip()
    database = Database(Settings().effective_database_url)
    with database.reading() as session:
        found, _ = principal_of(session, key)
    database.close()
    assert (found.role, found.operator) == ("analyst", "north")
    wrong = runner.invoke(app, ["keys", "create", "--role", "king"])
    assert wrong.exit_code == 1
    assert "viewer, analyst, engineer, admin" in wrong.output


def test_db_upgrade_is_repeatable() -> None:
    for _ in range(2):
        assert runner.invoke(app, ["db", "upgrade"]).exit_code == 0


def test_serve_refuses_an_open_address_without_keys() -> None:
    result = runner.invoke(app, ["serve", "--host", "0.0.0.0"])
    assert result.exit_code == 1
    assert "loopback only" in result.output
