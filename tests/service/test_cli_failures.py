"""What keeps a command from beginning is one sentence that names the setting, with exit code 2 and no traceback."""

import socket
from pathlib import Path

import pytest
from typer.testing import CliRunner

from service.command_line.main import app

WRONG: list[tuple[dict[str, str], list[str], str]] = [
    ({"CASEDRAIN_AUTH": "maybe"}, ["serve"], "CASEDRAIN_AUTH: input should be 'on' or 'off', not 'maybe'"),
    ({"CASEDRAIN_MAX_ROWS": "few"}, ["keys", "create", "--role", "admin"], "CASEDRAIN_MAX_ROWS: "),
    ({"CASEDRAIN_DATABASE_URL": "mysql://x/y"}, ["db", "upgrade"], "CASEDRAIN_DATABASE_URL: mysql is not supported"),
    ({"CASEDRAIN_DATABASE_URL": "nonsense"}, ["serve"], "CASEDRAIN_DATABASE_URL: is no SQLAlchemy URL"),
    ({"CASEDRAIN_TRUSTED_PROXIES": "10.0.0.1, me"}, ["serve"], "CASEDRAIN_TRUSTED_PROXIES: 'me' is no address"),
    ({"CASEDRAIN_DATABASE_URL": "postgresql://x@127.0.0.1:9/y"}, ["db", "upgrade"], "of CASEDRAIN_DATABASE_URL"),
    ({"CASEDRAIN_DATABASE_URL": "postgresql://x@127.0.0.1:9/y"}, ["serve"], "of CASEDRAIN_DATABASE_URL"),
    ({"CASEDRAIN_DATA_DIR": "/proc/none"}, ["serve"], "CASEDRAIN_DATA_DIR: /proc/none cannot be made"),
    ({"CASEDRAIN_RAW_STORE_URL": "foo://x"}, ["serve"], "CASEDRAIN_RAW_STORE_URL: the store cannot be opened"),
]


@pytest.mark.parametrize(("environment", "words", "sentence"), WRONG)
def test_a_wrong_setting_is_named(
    environment: dict[str, str], words: list[str], sentence: str, tmp_path: Path, free_port: int
) -> None:
    folder = {"CASEDRAIN_DATA_DIR": str(tmp_path / "data")}
    port = ["--port", str(free_port)] if words == ["serve"] else []
    answer = CliRunner().invoke(app, [*words, *port], env=folder | environment)
    assert answer.exit_code == 2, answer.output
    assert answer.exception is None or isinstance(answer.exception, SystemExit)
    said = answer.stderr.strip()
    assert said.startswith("error: ")
    assert sentence in said
    assert said.count("\n") == 0
    assert "secret" not in said


def test_a_port_that_cannot_be_had_is_noticed_before_anything_starts(tmp_path: Path) -> None:
    folder = {"CASEDRAIN_DATA_DIR": str(tmp_path / "data")}
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        answer = CliRunner().invoke(app, ["serve", "--port", str(port)], env=folder)
    assert (answer.exit_code, f"--port {port} cannot be listened on" in answer.stderr) == (2, True)
    assert not (tmp_path / "data").exists()
    assert CliRunner().invoke(app, ["serve", "--port", "80000"], env=folder).exit_code == 2


@pytest.fixture
def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as found:
        return int(found.getsockname()[1])
