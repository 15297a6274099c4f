"""Which software made an answer: named everywhere, and no part of two answers being equal."""

import json
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select
from typer.testing import CliRunner

from service import __version__, identity
from service.command_line.main import app
from service.demo.fleet import DemoRecord
from service.history import analysis
from service.history.codec import same_verdict
from service.identity import Software, commit, release_number, release_of, software
from service.monitoring import folded as folding
from service.reports.content import Period
from service.reports.page import report_html
from service.storage.tables import StoredAssessment, VerdictRevision
from service.studies.validation.report import report_html as validation_html
from tests.service.histories import day
from tests.service.test_exports import rows, table
from tests.service.test_jobs import API
from tests.service.test_reprocess import reprocess
from twin.sources import package_hash

OTHER = Software("7.0.0", None, "0" * 16)
ROOT = Path(identity.__file__).resolve().parent.parent


@pytest.fixture
def loaded(client: TestClient, worn_records: list[DemoRecord]) -> TestClient:
    for record in worn_records[:3]:
        answer = client.post(f"{API}/records", content=record.content, headers={"content-type": "text/csv"})
        assert answer.status_code == 201
    return client


@pytest.fixture
def asked_again() -> Iterator[None]:
    commit.cache_clear()
    yield
    commit.cache_clear()


def test_it_is_the_release_the_commit_and_the_sources(asked_again: None, monkeypatch: pytest.MonkeyPatch) -> None:
    found = software()
    assert (found.release, found.sources) == (__version__, package_hash("twin", "detectors"))
    commit.cache_clear()
    monkeypatch.setenv(identity.COMMIT_VARIABLE, " 0a1b2c \n")
    assert commit() == "0a1b2c"
    monkeypatch.delenv(identity.COMMIT_VARIABLE)
    commit.cache_clear()
    head = subprocess.run(["git", "-C", str(ROOT), "rev-parse", "HEAD"], capture_output=True, text=True, check=False)
    assert commit() == (head.stdout.strip() or None)
    commit.cache_clear()
    monkeypatch.setattr(identity, "_ROOT", ROOT / "nowhere")
    assert commit() is None


def test_releases_sort_as_semantic_versions_do() -> None:
    ordered = ["0.9.12", "0.10.0", "1.0.0", "1.0.1", "1.2.0", "1.10.0", "2.0.0", "10.0.0"]
    numbers = [release_number(release) for release in ordered]
    assert numbers == sorted(set(numbers))
    assert [release_of(n) for n in numbers] == ordered
    assert release_number("1.1.0rc1") == release_number("1.1.0")
    assert max(numbers) < release_number("999.999.999") < 2**31  # an integer column of either database
    for wrong in ("1.0", "v1.0.0", "1.0.1000", ""):
        with pytest.raises(ValueError, match="no release"):
            release_number(wrong)


def test_the_command_line_says_it() -> None:
    runner = CliRunner()
    assert runner.invoke(app, ["--version"]).output.startswith(f"casedrain {__version__}")
    for words in (["--version", "--json"], ["--json", "--version"]):
        said = runner.invoke(app, words)
        assert said.exit_code == 0
        assert json.loads(said.output) == software().to_json()


def test_readiness_and_every_verdict_say_it(loaded: TestClient) -> None:
    expected = software().to_json()
    assert set(expected) == {"release", "commit", "sources"}
    assert loaded.get("/readyz").json()["software"] == expected
    record = loaded.get(f"{API}/records").json()["items"][0]
    serial = record["pump_serial"]
    verdicts = [
        loaded.get(f"{API}/pumps/{serial}/verdict").json(),
        loaded.get(f"{API}/pumps/{serial}/verdict", params={"known_at": "2030-01-01T00:00:00Z"}).json(),
        loaded.get(f"{API}/pumps/{serial}/verdict", params={"at": "2000-01-01T00:00:00Z"}).json(),
        loaded.get(f"{API}/records/{record['record_id']}").json()["verdict"],
    ]
    assert [v["software"] for v in verdicts] == [expected] * 4


def test_every_export_says_it(loaded: TestClient) -> None:
    expected = {f"software_{name}": value or "" for name, value in software().to_json().items()}
    twin = rows(loaded, "verdicts")[0]["twin_version"]
    for name in ("trends", "verdicts", "windows"):
        for row in rows(loaded, name):
            assert {key: row[key] for key in expected} == expected
            assert row["twin_version"] == twin
        binary = table(loaded, name)
        assert binary
        assert all(row["software_sources"] == software().sources for row in binary)


def test_an_answer_keeps_the_name_of_who_made_it(loaded: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    """Other software of the same sources changes no stored verdict, makes no revision, and finds nothing changed."""
    serial = loaded.get(f"{API}/pumps").json()["items"][0]["serial"]
    before: dict[str, Any] = loaded.get(f"{API}/pumps/{serial}/verdict").json()
    for module in (folding, analysis):
        monkeypatch.setattr(module, "software", lambda: OTHER)
    found = reprocess(loaded, only="verdicts")[serial]
    assert found["status"] == "unchanged"
    folded = loaded.get(f"{API}/pumps/{serial}/verdict").json()
    assert folded["software"] == OTHER.to_json()  # reprocessing trusts nothing that is stored
    assert folded != before
    assert same_verdict(folded, before)
    assert not same_verdict({**folded, "state": "other"}, before)
    monkeypatch.undo()
    event = {"at": "2030-01-01T00:00:00Z", "action": "filter_changed"}
    assert loaded.post(f"{API}/pumps/{serial}/maintenance", json=event).status_code == 201
    after = loaded.get(f"{API}/pumps/{serial}/verdict").json()
    assert after["software"] == OTHER.to_json()  # it still holds and was not made again
    then = loaded.get(f"{API}/pumps/{serial}/verdict", params={"known_at": "2031-01-01T00:00:00Z"}).json()
    assert same_verdict(then, after)
    with loaded.app.state.context.database.reading() as session:  # type: ignore[attr-defined]
        assert session.scalars(select(VerdictRevision)).all() == []
        chains = list(session.scalars(select(StoredAssessment.chain)))
    assert None not in chains


def test_printed_reports_say_it() -> None:
    whole = {"ranking": [], "by_state": {}, "silent": [], "alarms": [], "findings": {"count": 0}}
    sentence = identity.sentence()
    assert software().sources in sentence
    assert sentence in report_html("fleet", Period(day(0), day(1)), whole, [], "head of north")
    assert sentence in validation_html({})
