"""Every answering command with ``--json`` prints one document of the shape that its help states; any name is only shown."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import accumulate
from pathlib import Path
from typing import Any

import httpx2
import pytest
from click.testing import Result
from fastapi.testclient import TestClient
from typer.testing import CliRunner

from service.client import Client
from service.client.testing import MemoryService
from service.command_line.main import app
from service.demo.fleet import DemoRecord
from service.settings import Settings
from tests.service.lent_application import lent

ROOT = Path(__file__).resolve().parents[2]
SCENARIO = "duration_s = 0.01\n[condition]\nspeed_rpm = 4600\nfluid_temperature_degc = 50\n"
NASTY = (
    "d[/].csv",
    "x[bold].csv",
    "a\x1b[31mb.csv",
    "a\rrefused b.csv",
    "a\nanalysed b.csv",
    "a\u202egnp.csv",
    "a\udcffb.csv",
    ":warning: b.csv",
)
UNPRINTABLE = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\u2028-\u202e\udc80-\udcff]")


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CASEDRAIN_DATA_DIR", str(tmp_path / "data"))
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def own_database(new_database: Callable[[str], str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CASEDRAIN_DATABASE_URL", new_database("sqlite"))


def connect(monkeypatch: pytest.MonkeyPatch, transport: httpx2.BaseTransport) -> None:
    """Let the commands' client speak to a service without a network."""
    monkeypatch.setattr("service.client.Client", partial(Client, retries=0, transport=transport))


@pytest.fixture
def service(new_settings: Callable[..., Settings], monkeypatch: pytest.MonkeyPatch) -> Iterator[TestClient]:
    """A real service that the commands reach: what they print of it is looked at, so one kind of database is enough."""
    with lent(new_settings("sqlite")) as running:

        def answer(request: httpx2.Request) -> httpx2.Response:
            given = running.request(
                request.method, request.url.raw_path.decode(), content=request.content, headers=dict(request.headers)
            )
            kind = {"content-type": given.headers.get("content-type", "")}
            return httpx2.Response(given.status_code, content=given.content, headers=kind)

        connect(monkeypatch, httpx2.MockTransport(answer))
        yield running


def run(*words: str, code: int = 0, **options: Any) -> Result:
    ran = CliRunner().invoke(app, list(words), **options)
    assert ran.exception is None or isinstance(ran.exception, SystemExit), ran.exc_info
    assert ran.exit_code == code, ran.output
    return ran


def document(*words: str, code: int = 0) -> Any:
    """The one document on standard output, which has the shape that the command's help states."""
    ran = run(*words, code=code)
    found = json.loads(ran.stdout, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    command = [w for w in words[:2] if w[0] != "-" and w.replace("-", "").isalpha()]
    stated = stated_shape(run(*command, "--help").stdout)
    if stated is not None:
        assert_shape(found, stated)
    return found


def stated_shape(text: str) -> Any:
    """The shape after ``With --json:`` or ``The JSON:``; a name without a shape of its own stands for anything."""
    words = " ".join(text.split())
    start = re.search(r"(?:With --json|The JSON): ?(?=[{\[])", words)
    if start is None:
        return None
    rest = words[start.end() :]
    depths = accumulate((c in "{[") - (c in "]}") for c in rest)
    shape = rest[: next(i for i, depth in enumerate(depths) if depth == 0) + 1]
    shape = re.sub(r'(?<!: )("\w+")(?=\s*[,}])', r"\1: null", shape)
    return json.loads(re.sub(r"\[\w+\]", "null", shape))


def assert_shape(found: Any, stated: Any) -> None:
    if isinstance(stated, dict):
        assert set(found) == set(stated)
        for name, shape in stated.items():
            assert_shape(found[name], shape)
    elif isinstance(stated, list):
        for item in found:
            assert_shape(item, stated[0])


def written(folder: Path, records: Sequence[DemoRecord]) -> list[str]:
    files = [folder / f"flight-{i}.csv" for i in range(len(records))]
    for file, record in zip(files, records, strict=True):
        file.write_bytes(record.content)
    return list(map(str, files))


def test_the_stated_shape_is_read_as_it_is_meant() -> None:
    words = 'Words.\n\n With --json: {"a", "b": [{"c", "d"}],\n "e": [name]}; a may be null.'
    assert stated_shape(words) == {"a": None, "b": [{"c": None, "d": None}], "e": None}
    assert stated_shape("no shape here") is None


def test_version() -> None:
    assert set(json.loads(run("--version", "--json").stdout)) == {"release", "commit", "sources"}


def test_analyse(tmp_path: Path, healthy_records: list[DemoRecord]) -> None:
    files = written(tmp_path, healthy_records[:2])
    (pump,) = document("analyse", *files, "--json")["pumps"]
    assert [f["file"] for f in pump["files"]] == files
    assert Path(pump["picture"]).read_text(encoding="utf-8").startswith("<svg")
    assert sum(pump["verdict"]["probabilities"].values()) == pytest.approx(1.0)
    assert {"fit", "blind_spots", "crossing", "missing_evidence", "case_pressure"} <= pump["verdict"].keys()


def test_upload_and_reprocess(tmp_path: Path, healthy_records: list[DemoRecord], service: TestClient) -> None:
    good, bad = written(tmp_path, healthy_records[:1])[0], tmp_path / "bad.csv"
    bad.write_text("not a record")
    first, second = document("upload", good, str(bad), "--json", code=1)["files"]
    assert (first["file"], first["answer"]["status"], first["refusal"]) == (good, "analysed", None)
    assert (second["file"], second["answer"]) == (str(bad), None)
    assert second["refusal"]
    answer = document("reprocess", "--dry-run", "--json")
    assert answer["job"]["status"] == "succeeded"
    assert [item["pump"] for item in answer["items"]] == [healthy_records[0].pump.serial]


@pytest.mark.usefixtures("own_database")
def test_keys_users_and_the_database(monkeypatch: pytest.MonkeyPatch) -> None:
    assert document("db", "upgrade", "--json") == {"status": "up_to_date"}
    key = document("keys", "create", "--role", "viewer", "--expires", "2030-01-01", "--json")
    assert (key["role"], key["operator"], key["expires"]) == ("viewer", None, "2030-01-01T00:00:00+00:00")
    assert key["key"].startswith("cd_")
    monkeypatch.setenv("CASEDRAIN_NEW_PASSWORD", "long enough, and nobody's")
    user = document("users", "create", "ada", "--role", "analyst", "--operator", "north", "--json")
    assert user == {"name": "ada", "role": "analyst", "operator": "north", "email": None, "mail": False}


def test_simulate(tmp_path: Path) -> None:
    (tmp_path / "short.toml").write_text(SCENARIO)
    answer = document("simulate", "short.toml", "--output", "short.csv", "--json")
    assert (answer["output"], answer["complete"], answer["advice"]) == ("short.csv", True, None)
    lines = Path("short.csv").read_text().splitlines()
    assert answer["rows"] == sum(not line.startswith(("#", "time_s")) for line in lines)


def test_isolability() -> None:
    answer = document("isolability", "--flights", "2", "--baseline-flights", "2", "--json", "-")
    assert "leakage, slippers" in answer["faults"]


def test_validate() -> None:
    rows = document("validate", "--only", "erosion", "--json", "-")
    assert {row["evidence"] for row in rows} == {"figure 2-21", "table 2-8"}


def test_demo_files(tmp_path: Path) -> None:
    answer = json.loads(run("demo", "--flights", "12", "--files", str(tmp_path / "fleet"), "--json").stdout)
    assert answer["files"] == len(list((tmp_path / "fleet").rglob("*.csv")))


@pytest.mark.parametrize("name", NASTY)
def test_upload_and_analyse_show_any_name_on_one_line(
    name: str, tmp_path: Path, healthy_records: list[DemoRecord], monkeypatch: pytest.MonkeyPatch
) -> None:
    good, bad = tmp_path / name, tmp_path / f"bad {name}"
    good.parent.mkdir(parents=True, exist_ok=True)
    bad.parent.mkdir(parents=True, exist_ok=True)
    good.write_bytes(healthy_records[0].content)
    bad.write_text("not a record")
    memory = MemoryService()
    connect(monkeypatch, memory.transport)
    for command, answers in (("upload", ("analysed ", "refused ")), ("analyse", ("refused ",))):
        ran = run(command, str(good), str(bad), code=1)
        assert UNPRINTABLE.search(ran.output) is None
        for word in answers:
            assert sum(line.startswith(word) for line in ran.output.splitlines()) == 1
        files = run(command, str(good), str(bad), "--json", code=1)
        listed = json.loads(files.stdout)["files" if command == "upload" else "refused"]
        assert listed[-1]["file"] == str(bad)


def test_a_pump_of_any_name_is_reprocessed_on_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    state = {"status": "succeeded", "problem": None, "progress": {"done": 2, "total": 2}}
    alarm = {"verdict_state": "s[/]", "priority": "high", "raised_at": "2026-05-02"}
    done = {"status": "done", "operator": "o[/]", "changed": 1, "records": 1, "state_before": "a", "state_after": "b"}
    items = [done | {"pump": name, "alarms": {"gained": [alarm], "lost": []}} for name in NASTY]
    failed = {"status": "failed", "problem": {"detail": "why[/]\nnot"}}
    items += [{"pump": name, "operator": "o"} | failed for name in NASTY]

    def answer(request: httpx2.Request) -> httpx2.Response:
        listed = {"items": items, "next": None}
        body = json.dumps(listed if request.url.path.endswith("items") else {"id": "j"} | state)
        return httpx2.Response(200, content=body, headers={"content-type": "application/json"})

    connect(monkeypatch, httpx2.MockTransport(answer))
    ran = run("reprocess")
    assert len(ran.stdout.splitlines()) == 2 * len(NASTY)
    assert sum(": left as it was, why[/]" in line for line in ran.stderr.splitlines()) == len(NASTY)
    assert UNPRINTABLE.search(ran.stdout) is None
    assert json.loads(run("reprocess", "--json").stdout)["items"] == items


@pytest.mark.parametrize("name", [n for n in NASTY if "/" not in n])
def test_files_of_any_name_are_read_and_written(name: str, tmp_path: Path) -> None:
    scenario = tmp_path / f"{name}.toml"
    scenario.write_text("colour = 1\n")
    wrong = run("simulate", str(scenario), "--output", name, code=2)
    assert UNPRINTABLE.search(wrong.output) is None
    assert all(line.startswith(("error: ", "  ")) for line in wrong.output.splitlines())
    points = tmp_path / name
    points.write_text("mood\n1\n")
    wrong = run("identify", str(points), "--id", "x", "--output", "x.toml", code=2)
    assert UNPRINTABLE.search(wrong.output) is None
    assert all(line.startswith(("error: ", "  ")) for line in wrong.output.splitlines())


@pytest.mark.usefixtures("own_database")
def test_a_user_of_any_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CASEDRAIN_NEW_PASSWORD", "long enough, and nobody's")
    for name in ("a[/]b", "x[bold]"):
        assert f"User {name} can sign in now." in run("users", "create", name, "--role", "viewer").output
    wrong = CliRunner().invoke(app, ["users", "create", "a\x1b[31m\nUser b", "--role", "viewer"])
    assert UNPRINTABLE.search(wrong.output) is None
    assert not any(line.startswith("User b") for line in wrong.output.splitlines())


def test_a_folder_that_cannot_be_written_is_said(tmp_path: Path, healthy_records: list[DemoRecord]) -> None:
    (file,) = written(tmp_path, healthy_records[:1])
    said = run("analyse", file, "--output", f"{file}/below", code=1)
    assert "Not a directory" in said.stderr


@pytest.mark.parametrize("words", ["--help", "--version", "--version --json", "analyse --help"])
def test_nothing_is_asked_of_a_home_that_cannot_be_written(words: str, tmp_path: Path) -> None:
    home = tmp_path / "home"
    home.mkdir(mode=0o500)
    rights = (
        ["setpriv", "--bounding-set=-all", "--inh-caps=-all"] if os.geteuid() == 0 and shutil.which("setpriv") else []
    )
    kept = {k: v for k, v in os.environ.items() if not k.startswith(("CASEDRAIN_", "XDG_"))}
    environment = kept | {"HOME": str(home), "PYTHONPATH": str(ROOT)}
    command = [*rights, sys.executable, "-B", "-m", "service.command_line", *words.split()]
    ran = subprocess.run(command, cwd=home, env=environment, capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stderr) == (0, "")
    assert ran.stdout
    assert list(home.iterdir()) == []
