"""The command line: light help, foreign text as it stands, lines in a pipe, one document with ``--json``."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from service.command_line.console import say, shown
from service.command_line.main import app

ROOT = Path(__file__).resolve().parent.parent.parent
HEAVY: tuple[str, ...] = (
    "numba",
    "numpy",
    "scipy",
    "pint",
    "twin",
    "detectors",
    "sqlalchemy",
    "fastapi",
    "httpx2",
    "structlog",
)
HEAVY += ("rich", "matplotlib", "pydantic_settings", "uvicorn")
COMMANDS: tuple[str, ...] = (
    "demo",
    "serve",
    "upload",
    "reprocess",
    "analyse",
    "simulate",
    "identify",
    "learn-priors",
    "validate",
)
COMMANDS += ("isolability", "evaluate", "keys create", "users create", "db upgrade")
NASTY = ("d[/].csv", "x[red]y.csv", "[link=http:a]z.csv", "a:warning:b.csv", "[parquet].csv", "n" * 200 + ".csv")


def _loaded(*words: str, among: tuple[str, ...] = HEAVY) -> list[str]:
    code = (
        "import sys\n"
        "from service.command_line.main import app\n"
        f"try:\n    app({list(words)!r})\n"
        f"finally:\n    print(sorted(set(sys.modules) & set({among!r})), file=sys.stderr)\n"
    )
    ran = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    return list(ast.literal_eval(ran.stderr.strip().splitlines()[-1]))


@pytest.mark.parametrize("words", ["--version", "--help", *(f"{c} --help" for c in COMMANDS)])
def test_help_loads_nothing_heavy(words: str) -> None:
    assert _loaded(*words.split()) == []


@pytest.mark.parametrize("words", ["--version", "--help"])
def test_what_is_asked_most_loads_no_pydantic(words: str) -> None:
    """It is half of the time that ``--version`` took: typer loads it to read options."""
    assert _loaded(words, among=("pydantic",)) == []


@pytest.mark.parametrize("name", NASTY)
def test_a_name_is_shown_as_it_stands_on_one_line(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "40")
    file = tmp_path / name
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("not a record")
    except OSError as error:
        pytest.skip(f"this file system takes no such name: {error}")
    ran = CliRunner().invoke(app, ["analyse", str(file)])
    assert ran.exit_code == 1
    assert f"refused {file}: " in ran.output


def test_analyse_with_json_prints_one_document(tmp_path: Path) -> None:
    file = tmp_path / "bad[parquet].csv"
    file.write_text("not a record")
    ran = CliRunner().invoke(app, ["analyse", str(file), "--json"])
    assert ran.exit_code == 1
    document = json.loads(ran.stdout)
    assert document["pumps"] == []
    assert [r["file"] for r in document["refused"]] == [str(file)]
    assert "refused" in ran.stderr


def test_no_control_character_and_no_half_text_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    say("a\x1b[31mb\udcffc")
    assert capsys.readouterr().out == f"{shown(chr(97) + chr(27))}[31mb?c\n"


def test_no_source_of_the_command_line_prints_with_markup() -> None:
    for file in sorted((ROOT / "service" / "command_line").glob("*.py")):
        for call in (n for n in ast.walk(ast.parse(file.read_text())) if isinstance(n, ast.Call)):
            name = ast.unparse(call.func)
            if name.endswith(("console().print", "complaints().print")):
                pytest.fail(f"{file.name}:{call.lineno} prints past `say`")
            marked = [k for k in call.keywords if k.arg == "markup"]
            assert all(ast.unparse(k.value) == "False" for k in marked), f"{file.name}:{call.lineno}"
