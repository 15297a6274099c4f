"""A database that release 0.1.0 has made is migrated and reduced again: what was measured is as it was, and what is judged
otherwise stands in a list with its reason.

Windows and residuals are computed anew, from the raw bytes, by other code. What may differ is the last digits: a reordered sum
moves a least-squares solution by about 1e-13 of itself, and iterations stop at residuals of 1e-10; ``RELATIVE`` is far
below any digit that a page shows. ``SMALL`` is for changes and residuals around nought, in bar.

The judge is another one since release 1.1 (docs/detection.md). ``CHANGED`` holds, pump by pump, the runs of states that it and
release 0.1.0 say, and why they differ; ``python -m tests.service.test_release_before`` does not exist on purpose: a list that
changes is read and written by hand.
"""

import itertools
import json
import math
import tarfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import Event
from typing import Any

import pytest
from alembic import command
from fastapi.testclient import TestClient
from sqlalchemy import Column, Integer, MetaData, Table, create_engine, func, inspect, select, text

from detectors.judgement.version import twin_version
from service.identity import release_number, software
from service.monitoring.precedence import made_with
from service.monitoring.renewal import Renewal
from service.settings import Settings
from service.storage.database import alembic_config, upgrade
from service.storage.raw_store import content_hash
from service.storage.tables import ANALYSED, Base, Pump, Record
from service.web.addresses import API_PREFIX as API
from tests.conftest import KINDS
from tests.postgres import create_database
from tests.service.lent_application import lent
from twin.pumps import pump_type

PACKED = Path(__file__).parent / "data" / "release-0.1.0" / "history.tar.xz"
RELATIVE, SMALL = 1e-6, 1e-9
NEW = {
    *("twin_version", "software"),
    *("fit", "blind_spots", "probability_beyond_limit", "crossing", "intermittent", "resolved_by", "missing_evidence"),
    *("case_pressure", "case_pressure_beyond", "other", "bridged", "warming_k_per_min"),
}
"""What a verdict says of the code that made it: another code, by design; and words of verdicts and windows that the release
before did not have."""
CHANGED = PACKED.parents[1] / "states-by-release.json"
GONE = ("DT-105", 4)
"""Pump, and number of its record in event order, whose raw bytes are no longer kept when the new release comes."""
FLAG = "raw bytes are no longer kept: analysed as they were before (1 record)"


@dataclass(frozen=True)
class Replayed:
    """What the release before said, and a client of the present one after its renewal."""

    said: dict[str, Any]
    client: TestClient
    raw: Path
    n_reduced: int

    def get(self, path: str) -> Any:
        answer = self.client.get(API + path)
        assert answer.status_code == 200, answer.text
        return answer.json()

    def records(self, serial: str) -> list[dict[str, Any]]:
        """What was said of a pump's records that count, in event order."""
        found = [r for r in self.said["records"].values() if r.get("pump_serial") == serial]
        return sorted(found, key=lambda r: (r["started_at"], r["record_id"]))

    @property
    def gone(self) -> str:
        """Id of the record without raw bytes."""
        record_id: str = self.records(GONE[0])[GONE[1]]["record_id"]
        return record_id


@pytest.fixture(scope="module", params=KINDS)
def replayed(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Replayed]:
    """The present release on the database of the release before, with every pump renewed."""
    folder = tmp_path_factory.mktemp("before")
    with tarfile.open(PACKED) as packed:
        packed.extractall(folder, filter="data")
    file = folder / "casedrain.sqlite"
    url = f"sqlite:///{file}"
    if request.param == "postgres":
        url = create_database(request.getfixturevalue("postgres_cluster"), "before")
        copy(file, url)
        upgrade(url)
    said = json.loads((folder / "answers.json").read_text())
    with lent(Settings(database_url=url, data_dir=folder, auth="off")) as client:
        found = Replayed(said, client, folder / "raw", 0)
        context = client.app.state.context  # type: ignore[attr-defined]
        with context.database.writing() as session:
            assert session.scalars(select(Pump.made_with)).all() == [None] * len(said["pumps"])
            row = session.get_one(Record, found.gone)
            row.raw_removed_at = row.received_at
            assert context.raw_store.remove(row.content_hash)
        n_reduced = Renewal(context.database, context.archive).run(Event())
        yield Replayed(said, client, folder / "raw", n_reduced)


def copy(file: Path, url: str) -> None:
    """Every row of an SQLite file to an empty Postgres database, at the schema that the file has.

    Of a statement for a table of now SQLAlchemy would fill in defaults of columns that the file does not have yet.
    """
    source, target = create_engine(f"sqlite:///{file}"), create_engine(url)
    with source.connect() as old:
        command.upgrade(alembic_config(url), old.scalar(text("SELECT version_num FROM alembic_version")))
        has = inspect(old)
        with target.begin() as new:
            for table in Base.metadata.sorted_tables:
                if not has.has_table(table.name):
                    continue
                names = {c["name"] for c in has.get_columns(table.name)}
                rows = old.execute(select(*(c for c in table.columns if c.name in names))).mappings().all()
                if rows:
                    new.execute(as_of_then(table, names).insert(), [dict(row) for row in rows])
                (key, *others) = table.primary_key.columns
                if rows and not others and isinstance(key.type, Integer):
                    last = func.setval(
                        func.pg_get_serial_sequence(table.name, key.name), max(r[key.name] for r in rows)
                    )
                    new.execute(select(last))
    source.dispose()
    target.dispose()


def as_of_then(table: Table, names: set[str]) -> Table:
    """A table with no other columns than these."""
    return Table(table.name, MetaData(), *(Column(c.name, c.type) for c in table.columns if c.name in names))


def differences(before: Any, after: Any, where: str = "", share: float = RELATIVE, small: float = SMALL) -> list[str]:
    """Where two JSON documents differ by more than last digits, or than a share and a small number that are given."""
    if isinstance(before, dict) and isinstance(after, dict):
        names = (before.keys() | after.keys()) - NEW
        lost = [
            f"{where}.{n}: only {'before' if n in before else 'after'}" for n in names if (n in before) != (n in after)
        ]
        both = [n for n in names if n in before and n in after]
        return lost + [d for n in both for d in differences(before[n], after[n], f"{where}.{n}", share, small)]
    if isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        pairs = enumerate(zip(before, after, strict=True))
        return [d for i, (b, a) in pairs for d in differences(b, a, f"{where}[{i}]", share, small)]
    if isinstance(before, float) and isinstance(after, float):
        return [] if math.isclose(before, after, rel_tol=share, abs_tol=small) else [f"{where}: {before} | {after}"]
    return [] if before == after else [f"{where}: {before} | {after}"]


def without_flag(document: Any) -> Any:
    """A document without the remark on bytes that are gone."""
    if isinstance(document, dict):
        return {k: without_flag(v) for k, v in document.items()}
    if isinstance(document, list):
        return [without_flag(v) for v in document if v != FLAG]
    return document


def without_none(items: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Entries without fields that the release before did not have and nobody filled."""
    return [{k: v for k, v in item.items() if k not in ("fluid", "channel") or v is not None} for item in items]


@pytest.mark.postgres_in_study
def test_every_record_shows_what_it_showed(replayed: Replayed) -> None:
    """Status, windows and residuals."""
    found = {i: replayed.get(f"/records/{i}") for i in replayed.said["records"]}
    for record_id, said in replayed.said["records"].items():
        before, after = ({**document, "verdict": None} for document in (said, found[record_id]))
        assert differences(before, without_flag(after), record_id) == []
    statuses = [r["status"] for r in replayed.said["records"].values()]
    assert {s: statuses.count(s) for s in set(statuses)} == {"analysed": 120, "superseded": 1, "withdrawn": 1}
    made_anew = [r["verdict"] for r in found.values() if r["status"] == ANALYSED]
    assert [(v["software"], v["twin_version"]) for v in made_anew] == [
        (software().to_json(), twin_version(pump_type("h225")))
    ] * len(made_anew)


def runs(states: Sequence[str]) -> list[list[Any]]:
    """States in their order as [state, number of records]."""
    return [[state, len(list(group))] for state, group in itertools.groupby(states)]


def test_what_is_judged_otherwise_stands_in_the_list(replayed: Replayed) -> None:
    """Pump by pump the runs of states of both releases, each difference with its reason."""
    listed = json.loads(CHANGED.read_text(encoding="utf-8"))
    found = {}
    for serial in sorted(replayed.said["pumps"]):
        records = [r for r in replayed.records(serial) if r["status"] == ANALYSED]
        now = [replayed.get(f"/records/{r['record_id']}")["verdict"]["state"] for r in records]
        found[serial] = {"0.1.0": runs([r["verdict"]["state"] for r in records]), "now": runs(now)}
    assert found == {serial: {k: v for k, v in entry.items() if k != "why"} for serial, entry in listed.items()}
    assert all((entry["0.1.0"] == entry["now"]) == (entry["why"] is None) for entry in listed.values())


def test_the_history_is_worth_a_replay(replayed: Replayed) -> None:
    """The truth about each pump was seen by the release before, else equal verdicts would say little."""
    truth = {
        "DT-101": "healthy",
        "DT-102": "pump_degradation",
        "DT-104": "system_leakage",
        "DT-105": "compensator_fault",
        "DT-107": "drain_restriction",
        "DT-108": "sensor_fault",
    }
    for serial, state in truth.items():
        said = [r["verdict"] for r in replayed.records(serial)]
        assert any(state in (v["state"], *v["candidates"]) for v in said)
    assert {a["acknowledged"] for a in replayed.said["alarms"]} == {True, False}
    assert any(pump["verdicts/revisions"] for pump in replayed.said["pumps"].values())


def test_entries_alarms_and_thresholds_are_kept(replayed: Replayed) -> None:
    """Installations, maintenance, findings; every alarm that somebody acknowledged; versions."""
    for serial, said in replayed.said["pumps"].items():
        for name in said.keys() - {"verdict", "verdicts", "verdicts/revisions", "trend"}:
            after = replayed.get(f"/pumps/{serial}/{name}")["items"]
            if name in ("installations", "maintenance", "findings"):
                assert differences(said[name], without_none(after), serial) == []
    kept = {a["id"]: a for a in (replayed.get(f"/alarms/{a['id']}") for a in replayed.said["alarms"])}
    for before in replayed.said["alarms"]:
        assert kept[before["id"]]["acknowledged"] or not before["acknowledged"]
    assert replayed.get("/thresholds/pump-type/h225/versions") == replayed.said["thresholds"]


def test_every_record_was_reduced_by_the_present_code(replayed: Replayed) -> None:
    """But the one whose bytes are gone: it is kept as it was, and its pump's verdicts say so from then on."""
    context = replayed.client.app.state.context  # type: ignore[attr-defined]
    with context.database.reading() as session:
        rows = list(session.scalars(select(Record).where(Record.status == ANALYSED)))
        pumps = session.execute(select(Pump.made_by, Pump.made_with)).all()
    assert {row.id for row in rows if row.reduced_by != software().to_json()} == {replayed.gone}
    assert replayed.n_reduced == len(rows) - 1
    assert set(pumps) == {(release_number(), made_with())}
    records = replayed.records(GONE[0])
    flagged = [FLAG in replayed.get(f"/records/{r['record_id']}")["verdict"]["quality"]["flags"] for r in records]
    assert flagged == [i >= GONE[1] for i in range(len(records))]


def test_raw_bytes_are_whole(replayed: Replayed) -> None:
    """What comes back is what the release before has stored, under its name."""
    for record_id in replayed.said["records"].keys() - {replayed.gone}:
        content = replayed.client.get(f"{API}/records/{record_id}/raw").content
        digest = content_hash(content)
        assert (replayed.raw / digest[:2] / digest).read_bytes() == content


def test_the_newest_migration_goes_down_and_up_with_rows(tmp_path: Path) -> None:
    """SQLite refuses to make a table anew that others refer to: empty tables would not notice."""
    with tarfile.open(PACKED) as packed:
        packed.extractall(tmp_path, filter="data")
    url = f"sqlite:///{tmp_path / 'casedrain.sqlite'}"
    upgrade(url)
    command.downgrade(alembic_config(url), "-1")
    upgrade(url)
    engine = create_engine(url)
    with engine.connect() as session:
        for table in ("alarms", "assessments"):
            n, beyond = session.execute(text(f"SELECT count(*), sum(case_pressure_beyond) FROM {table}")).one()
            assert n > 0
            assert beyond == 0
    engine.dispose()
