"""Releases that follow each other, or run beside each other, on one database."""

import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from threading import Event
from typing import Any
from unittest import mock

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select

from detectors.judgement.version import _MODULES
from detectors.reduction.recording import reduce_recording
from detectors.words.observation import Reduction
from service import identity
from service.context import Context
from service.demo.fleet import DemoRecord
from service.errors import Unavailable
from service.history import reduced
from service.history.analysis import analysis_key
from service.history.setting import Setting
from service.identity import release_number, software
from service.monitoring import acceptance, counting, precedence, reanalysis, reduction, refold, renewal
from service.monitoring.precedence import HeldByNewerError, made_with
from service.monitoring.reduction import reduced_again
from service.monitoring.renewal import CAUSE, Renewal, due_pumps
from service.settings import Settings
from service.storage.tables import FoldSnapshot, Pump, Record, StoredAssessment, VerdictRevision
from service.thresholds.layers import Effective, thresholds_of
from service.web.app import create_app
from tests.service.test_jobs import API
from twin.parameters import PumpType, Sensor
from twin.pumps import pump_type
from twin.sources import imported_modules

NEWER = "9.0.0"


@pytest.fixture(autouse=True)
def _only_when_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("service.jobs.lookout.RENEWAL_S", 3600.0)


def send(client: TestClient, record: DemoRecord, status: int = 201) -> dict[str, Any]:
    answer = client.post(f"{API}/records", content=record.content, headers={"content-type": "text/csv"})
    assert answer.status_code == status, answer.text
    found: dict[str, Any] = answer.json()
    return found


def verdict(client: TestClient, record: DemoRecord) -> dict[str, Any]:
    found: dict[str, Any] = client.get(f"{API}/pumps/{record.pump.serial}/verdict").json()
    return found


def context_of(client: TestClient) -> Context:
    found: Context = client.app.state.context  # type: ignore[attr-defined]
    return found


def pump_of(client: TestClient) -> Pump:
    with context_of(client).database.reading() as session:
        return session.scalars(select(Pump)).one()


def held_by(client: TestClient, release: str) -> None:
    """What a process of that release leaves behind when it has folded the pump."""
    with context_of(client).database.writing() as session:
        pump = session.scalars(select(Pump)).one()
        pump.made_by, pump.made_with = release_number(release), "its code"


def rejecting(*arguments: Any) -> Reduction:
    """A reduction that finds no window good."""
    found = reduce_recording(*arguments)
    return replace(found, windows=tuple(replace(w, accepted=False, reason="none is") for w in found.windows))


@pytest.fixture
def other_code(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Put another release's reduction code in the place of ours."""

    def put() -> None:
        monkeypatch.setattr(reduced, "reduce_recording", rejecting)
        monkeypatch.setattr(reduced, "sources", lambda: "other sources")

    return put


@pytest.fixture
def as_newer(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Let this process be one of the newer release, wherever it asks."""

    def become() -> None:
        def number(release: str = NEWER) -> int:
            return release_number(release)

        asking = [
            module
            for name, module in sys.modules.items()
            if name.startswith("service.")
            and module is not identity
            and vars(module).get("release_number") is release_number
        ]
        assert {precedence, renewal, acceptance, counting, refold} <= set(asking)
        for module in asking:
            monkeypatch.setattr(module, "release_number", number)

    return become


@pytest.fixture
def fresh(client: TestClient, tmp_path: Path) -> Iterator[TestClient]:
    """Another database in the same process, without jobs: there is one engine in a process."""
    # two threads that parse sources at once may end in a SystemError: jobs of the first application find them parsed
    made_with()
    software()
    settings = Settings(database_url=f"sqlite:///{tmp_path / 'fresh.sqlite'}", data_dir=tmp_path / "fresh", auth="off")
    with (
        mock.patch("service.jobs.engine.start"),
        mock.patch("service.jobs.engine.stop"),
        TestClient(create_app(settings), base_url="http://localhost") as running,
    ):
        yield running


def test_stored_records_are_read_as_the_code_of_now_reads_them(
    client: TestClient, fresh: TestClient, worn_records: list[DemoRecord], other_code: Callable[[], None]
) -> None:
    """Three stored records and a new one say what the same four say to a fresh database."""
    for record in worn_records[:3]:
        send(client, record)
    assert verdict(client, worn_records[0])["quality"]["records_used"] == 3
    other_code()
    found = send(client, worn_records[3])["verdict"]
    for record in worn_records[:4]:
        expected = send(fresh, record)["verdict"]
    assert expected["quality"]["records_used"] == 0
    assert found == expected


def test_the_fleet_is_reduced_again_in_the_background(
    settings: Settings, worn_records: list[DemoRecord], other_code: Callable[[], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In chunks: what a process did before it was stopped need not be done again."""
    monkeypatch.setattr(reduction, "CHUNK", 2)
    with TestClient(create_app(settings), base_url="http://localhost") as client:
        for record in worn_records[:5]:
            send(client, record)
        before = verdict(client, worn_records[0])
        other_code()
        context = context_of(client)
        assert reduced_again(context.database, context.archive, pump_of(client).id, _After(1)) == 2
        pump = pump_of(client)
        assert (pump.made_by, pump.made_with) == (release_number(), None)
        assert verdict(client, worn_records[0]) == before
        assert Renewal(context.database, context.archive).run(Event()) == 3
        assert pump_of(client).made_with == made_with()
        assert verdict(client, worn_records[0])["quality"]["records_used"] == 0
        assert Renewal(context.database, context.archive).run(Event()) == 0


@pytest.mark.study
def test_a_start_takes_up_what_is_marked_old(settings: Settings, worn_records: list[DemoRecord]) -> None:
    """A migrated database says nothing of who made its rows."""
    with TestClient(create_app(settings), base_url="http://localhost") as client:
        for record in worn_records[:3]:
            send(client, record)
        before = verdict(client, worn_records[0])
        with context_of(client).database.writing() as session:
            pump = session.scalars(select(Pump)).one()
            pump.made_by = pump.made_with = None
            for row in session.scalars(select(Record)):
                row.reduced_with = "an older twin"
            for row in session.scalars(select(StoredAssessment)):
                row.chain = None
    with TestClient(create_app(settings), base_url="http://localhost") as client:
        for _ in range(600):
            if pump_of(client).made_with == made_with():
                break
            Event().wait(0.1)
        with context_of(client).database.reading() as session:
            rows = list(session.scalars(select(Record)))
            assert {row.reduced_with for row in rows} != {"an older twin"}
            assert [row.reduced_by for row in rows] == [software().to_json()] * 3
            assert session.scalars(select(VerdictRevision)).all() == []
        assert verdict(client, worn_records[0]) == before


def test_a_pump_whose_bytes_are_gone_keeps_its_verdicts(
    client: TestClient, worn_records: list[DemoRecord], other_code: Callable[[], None]
) -> None:
    send(client, worn_records[0])
    before, context = verdict(client, worn_records[0]), context_of(client)
    with context.database.reading() as session:
        assert context.raw_store.remove(session.scalars(select(Record.content_hash)).one())
    other_code()
    work = Renewal(context.database, context.archive)
    assert work.run(Event()) == 0
    with pytest.raises(Unavailable):
        reduced_again(context.database, context.archive, pump_of(client).id)
    assert verdict(client, worn_records[0]) == before


def stored_rows(client: TestClient) -> list[Any]:
    """All that a fold writes, whole."""
    columns = [
        (Record.id, Record.status, Record.reduced_with, Record.reduction, Record.residuals),
        (StoredAssessment.record_id, StoredAssessment.verdict, StoredAssessment.chain),
        (FoldSnapshot.records, FoldSnapshot.chain, FoldSnapshot.content),
    ]
    with context_of(client).database.reading() as session:
        return [tuple(row) for wanted in columns for row in session.execute(select(*wanted).order_by(wanted[0]))]


def test_an_older_process_leaves_the_pump_of_a_newer_one(
    client: TestClient,
    worn_records: list[DemoRecord],
    other_code: Callable[[], None],
    as_newer: Callable[[], None],
) -> None:
    """It stores and says so; whatever else it is told it notes, and a newer process folds it in."""
    for record in worn_records[:2]:
        send(client, record)
    held_by(client, NEWER)
    other_code()  # of the older process, so that anything it wrote would show
    before, context, pump = stored_rows(client), context_of(client), pump_of(client)
    answer = send(client, worn_records[2], 202)
    assert (answer["status"], answer["waits_for_release"]) == ("stored", NEWER)
    assert send(client, worn_records[2], 200)["status"] == "stored"
    later = client.post(
        f"{API}/records",
        content=worn_records[3].content,
        params={"wait": "false"},
        headers={"content-type": "text/csv"},
    )
    assert later.status_code == 202
    assert client.get(f"{API}/records/{later.json()['record_id']}").json()["status"] == "stored"
    event = {"at": "2026-03-03T00:00:00Z", "action": "filter_changed"}
    entered = client.post(f"{API}/pumps/{pump.serial}/maintenance", json=event)
    assert entered.status_code == 201
    assert pump_of(client).made_with is None
    with pytest.raises(HeldByNewerError, match=NEWER):
        reanalysis.reprocessed(context.database, context.archive, pump.id)
    assert Renewal(context.database, context.archive).run(Event()) == 0
    assert [row for row in stored_rows(client) if row in before] == before
    assert pump_of(client).made_by == release_number(NEWER)
    assert context.acceptance.left() == context.acceptance.pending() == []

    as_newer()
    assert len(context.acceptance.left()) == 2
    for record_id in context.acceptance.left():
        context.acceptance.process(record_id)
    found = client.get(f"{API}/records/{answer['record_id']}").json()
    assert (found["status"], "waits_for_release" in found) == ("analysed", False)
    pump = pump_of(client)
    assert (pump.made_by, pump.made_with) == (release_number(NEWER), made_with())
    with context.database.reading() as session:
        assert len(session.scalars(select(StoredAssessment)).all()) == 4


def test_a_newer_process_takes_over_what_an_older_one_made(
    client: TestClient, worn_records: list[DemoRecord], as_newer: Callable[[], None]
) -> None:
    for record in worn_records[:2]:
        send(client, record)
    before, context = verdict(client, worn_records[0]), context_of(client)
    held_by(client, "0.9.12")
    as_newer()
    with context.database.reading() as session:
        assert due_pumps(session, own_release=False) == [pump_of(client).id]
    Renewal(context.database, context.archive).run(Event())
    pump = pump_of(client)
    assert (pump.made_by, pump.made_with) == (release_number(NEWER), made_with())
    assert verdict(client, worn_records[0]) == before


def test_two_builds_of_one_release_do_not_take_turns(client: TestClient, worn_records: list[DemoRecord]) -> None:
    send(client, worn_records[0])
    with context_of(client).database.writing() as session:
        session.scalars(select(Pump)).one().made_with = "another build of this release"
    with context_of(client).database.reading() as session:
        assert due_pumps(session, own_release=True) == [pump_of(client).id]
        assert due_pumps(session, own_release=False) == []


def key(kind: PumpType, setting: Setting | None = None, **values: float) -> str:
    return analysis_key(kind, setting or Setting(), Effective({"window_x": 1.0, "alarm": 1.0, **values}, {}, 0))


def test_the_key_names_all_that_a_reduction_depends_on(monkeypatch: pytest.MonkeyPatch) -> None:
    kind = pump_type("h225")
    fluid = next(name for name in ("MIL-PRF-5606", "MIL-PRF-83282") if Setting(fluid=name).unknown_fluid is None)
    others = [
        key(replace(kind, sensors={**kind.sensors, "case_pressure_bar": Sensor(6.0, 0.01, 0.001)})),
        key(replace(kind, nominal_speed_rpm=4601.0)),
        key(replace(kind, nominal_reservoir_pressure_bar=1.0)),
        key(kind, Setting(circuit="separate_drain")),
        key(kind, Setting(fluid=fluid)),
        key(kind, window_x=2.0),
        key(pump_type("h225_thesis")),
    ]
    monkeypatch.setattr(reduced, "sources", lambda: "other sources")
    others.append(key(kind))
    monkeypatch.undo()
    assert len({key(kind), *others}) == len(others) + 1
    assert key(kind, alarm=2.0) == key(kind)


def test_the_code_of_a_reduction_holds_what_it_needs_and_no_release() -> None:
    """Else a mended word of the judge, or a new version number, would have a fleet reduced again."""
    made = set(imported_modules(reduced.__name__))
    parts = ("recording", "windows", "zero", "statistics", "spectrum", "load_steps", "behaviour")
    others = {"detectors.expectation.residuals", "service.history.codec", "twin.operating_point"}
    assert {f"detectors.reduction.{part}" for part in parts} | others <= made
    assert not made & {"service", "service.identity", "detectors.judgement.assessment", "detectors.judgement.wording"}
    judged = set(imported_modules(*(module.__name__ for module in _MODULES)))
    assert {
        "detectors.judgement.assessment",
        "detectors.expectation.components",
        "detectors.reduction.zero",
        "twin.pumps.fluids",
    } <= judged
    assert not any(name.startswith("service") for name in judged)


@pytest.mark.postgres_in_study
def test_a_renewal_notes_its_cause(
    worn_client: TestClient, worn_records: list[DemoRecord], other_code: Callable[[], None]
) -> None:
    other_code()
    context = context_of(worn_client)
    Renewal(context.database, context.archive).run(Event())
    with context.database.reading() as session:
        causes = {(row.cause, row.cause_id) for row in session.scalars(select(VerdictRevision))}
        assert causes >= {(CAUSE.kind, software().release)}
        assert thresholds_of(session, "default", worn_records[0].pump.serial, "h225").version == 0


class _After(Event):
    """Set once it was asked a number of times."""

    def __init__(self, times: int) -> None:
        super().__init__()
        self._left = times

    def is_set(self) -> bool:
        self._left -= 1
        return self._left < 0
