"""Backup, destroy, restore, check: identical verdicts, audit head and bytes, made while uploads come in."""

import json
import os
import shutil
import sqlite3
import threading
import time
import zipfile
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select
from typer.testing import CliRunner

from service.command_line.main import app
from service.keeping.backup import forget_backup, make_backup
from service.keeping.check import check_backup, check_installation
from service.keeping.container import read
from service.keeping.installation import Installation, installation
from service.keeping.restore import restore
from service.settings import Settings
from service.storage.database import Database
from service.storage.raw_store import RawStore
from service.storage.tables import Backup
from tests.service.finished_job import finished
from tests.service.lent_application import lent
from tests.service.records import METADATA, body, document

API = "/api/v1"
JSON = {"content-type": "application/json"}
OTHER = {"sqlite": "postgres", "postgres": "sqlite"}
runner = CliRunner()


def flight(n: int, pump: str) -> bytes:
    return json.dumps({**document(), "flight_id": f"F{n}", "pump_serial": pump, "aircraft": f"of {pump}"}).encode()


def upload(client: TestClient, content: bytes, params: dict[str, str] | None = None) -> str:
    answer = client.post(f"{API}/records", content=content, headers=JSON, params=params)
    assert answer.status_code in (201, 202), answer.text
    return str(answer.json()["record_id"])


def fill(client: TestClient) -> None:
    """A record, an entry, thresholds, a webhook's secret, a bulk job: something in most tables, floats among them."""
    upload(client, body())
    client.post(f"{API}/pumps/P-1/maintenance", json={"at": "2026-05-01T00:00:00Z", "action": "filter_changed"})
    client.put(
        f"{API}/thresholds/fleet/default",
        json={"values": {"case_flow_limit_lpm": 1.1 + 1e-15}, "reason": "ü"},
        headers={"If-Match": "*"},
    )
    packed = BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("one.json", flight(50, "P-3"))
    job = client.post(f"{API}/records/bulk", content=packed.getvalue(), headers={"content-type": "application/zip"})
    assert finished(client, job.json()["id"])["status"] == "succeeded"


@contextmanager
def opened_at(settings: Settings) -> Iterator[Installation]:
    with installation(settings) as kept:
        yield kept


def rows_in(place: Path, of: tuple[str, ...]) -> dict[str, list[str]]:
    """Every table of a backup, line for line."""
    with read(place) as source:
        names = [n for n in source.names() if n.startswith(of) and n != "rows/backups.jsonl"]
        found = {}
        for name in names:
            with source.open(name) as file:
                found[name] = sorted(file.read().decode().splitlines())
        return found


def by_value(line: str) -> list[Any]:
    """A row with its JSON columns read: Postgres writes the same document in an order of its own."""
    return [json.loads(v) if isinstance(v, str) and v.startswith(("[", "{")) else v for v in json.loads(line)]


def kind_of(url: str) -> str:
    return "sqlite" if url.startswith("sqlite") else "postgres"


@pytest.mark.study
def test_what_was_backed_up_under_load_comes_back(
    database_url: str, new_database: Callable[[str], str], tmp_path: Path
) -> None:
    settings = Settings(database_url=database_url, data_dir=tmp_path / "data")
    place = tmp_path / ("backup.zip" if kind_of(database_url) == "sqlite" else "backup")
    acknowledged: list[str] = []
    stop = threading.Event()
    with lent(settings) as client:
        fill(client)
        verdict = client.get(f"{API}/pumps/P-1/verdict").json()

        def load() -> None:
            while not stop.is_set():
                acknowledged.append(upload(client, flight(len(acknowledged), "P-2"), {"wait": "false"}))

        loading = threading.Thread(target=load)
        loading.start()
        while len(acknowledged) < 3:
            time.sleep(0.01)
        before = list(acknowledged)
        with opened_at(settings) as kept:
            manifest = make_backup(kept, place)
        during = len(acknowledged) - len(before)
        stop.set()
        loading.join()
        assert during > 0, "nothing came in while the backup was made: it proves nothing"
    assert check_backup(place).faults == []

    # destroyed: another place, another database, of the other kind too
    for kind in (kind_of(database_url), OTHER[kind_of(database_url)]):
        fresh = Settings(database_url=new_database(kind), data_dir=tmp_path / f"restored-{kind}")
        restore(fresh, place)
        with opened_at(fresh) as kept:
            found = check_installation(kept)
            assert found.faults == []
            assert found.audit is not None
            assert found.audit.head is not None
            assert found.audit.head.to_json() == manifest["audit"]
            assert found.raw_files == manifest["raw_files"]
            make_backup(kept, tmp_path / f"again-{kind}")
        # each kind of database has an engine of its own: what it holds is the same, tables and columns are not all
        of = ("rows", "engine") if kind == kind_of(database_url) else ("rows", "engine/operation_outputs")
        back, sent = rows_in(tmp_path / f"again-{kind}", of), rows_in(place, of)
        assert set(back) == set(sent)
        for name, lines in sent.items():
            assert list(map(by_value, back[name])) == list(map(by_value, lines)), name
    with lent(fresh) as client:
        assert client.get(f"{API}/pumps/P-1/verdict").json() == verdict
        for record_id in before:
            assert client.get(f"{API}/records/{record_id}/raw").status_code == 200
        # numbers go on where they were, and so does the chain
        upload(client, flight(99, "P-4"))
    with opened_at(fresh) as kept:
        assert check_installation(kept).faults == []


@pytest.fixture
def kept(tmp_path: Path, migrated_sqlite: Path) -> Iterator[Installation]:
    """A small installation on SQLite, at rest."""
    (tmp_path / "data").mkdir()
    shutil.copyfile(migrated_sqlite, tmp_path / "data" / "casedrain.sqlite")
    settings = Settings(data_dir=tmp_path / "data")
    with lent(settings) as client:
        upload(client, body())
        upload(client, flight(2, "P-2"))
    with opened_at(settings) as found:
        yield found


def raw_files_of(kept: Installation) -> list[Path]:
    return sorted(p for p in (kept.folder / "raw").rglob("*") if p.is_file())


def test_a_used_database_is_overwritten_only_by_force(kept: Installation, tmp_path: Path) -> None:
    settings = Settings(data_dir=kept.folder)
    make_backup(kept, tmp_path / "backup")
    kept.database.close()
    with pytest.raises(ValueError, match=r"is used .* --force"):
        restore(settings, tmp_path / "backup")
    with lent(settings) as client:
        upload(client, flight(3, "P-3"))
        with pytest.raises(ValueError, match="stop it first"):
            restore(settings, tmp_path / "backup", force=True)
    missing, damaged = raw_files_of(kept)[:2]
    missing.unlink()
    damaged.write_bytes(b"x")
    restore(settings, tmp_path / "backup", force=True)
    with opened_at(settings) as again:
        found = check_installation(again)
    assert found.faults == []
    assert (found.records, found.raw_files) == (2, 2)


def test_a_check_names_every_fault_of_an_installation(kept: Installation) -> None:
    assert check_installation(kept).faults == []
    missing, damaged = raw_files_of(kept)
    missing.unlink()
    damaged.write_bytes(damaged.read_bytes()[:-1] + b"!")
    orphan = kept.folder / "raw" / "ab" / ("ab" + 62 * "0")
    young = kept.folder / "raw" / "ab" / ("ab" + 62 * "1")
    for path in (orphan, orphan.with_name(orphan.name + ".123.partial"), young):
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(b"x")
        if path != young:
            os.utime(path, (1e9, 1e9))
    with kept.database.engine.begin() as connection:
        connection.exec_driver_sql("UPDATE audit_entries SET actor = 'nobody' WHERE id = 1")
        connection.exec_driver_sql("DELETE FROM assessments WHERE pump_id = 1")
    with closing(sqlite3.connect(kept.folder / "casedrain.sqlite")) as careless:
        careless.execute("DELETE FROM pumps WHERE id = 2")
        careless.commit()
    faults = "\n".join(check_installation(kept).faults)
    for what in (
        f"{missing.name} are not in the raw store",
        f"{damaged.name} are damaged",
        f"{orphan.name} in the raw store belongs to nothing",
        ".partial in the raw store is no raw file",
        "entry 1 (link 1) was changed",
        "is analysed and has no verdict",
        "refers to a row of pumps that is not there",
    ):
        assert what in faults, what
    assert young.name not in faults, "bytes stand in the store before their row does"


@pytest.mark.parametrize("form", ["folder", "zip"])
def test_a_check_names_every_fault_of_a_backup(kept: Installation, tmp_path: Path, form: str) -> None:
    place = tmp_path / ("backup.zip" if form == "zip" else "backup")
    make_backup(kept, place)
    assert check_backup(place).faults == []
    assert place.stat().st_mode & 0o077 == 0
    unpacked = tmp_path / "unpacked"
    if form == "zip":
        zipfile.ZipFile(place).extractall(unpacked)
    else:
        shutil.copytree(place, unpacked)
    raw = sorted(p for p in (unpacked / "raw").rglob("*") if p.is_file())
    good = raw[0].read_bytes()

    def faults() -> str:
        if form == "folder":
            return "\n".join(check_backup(unpacked).faults)
        packed = tmp_path / "packed.zip"
        with zipfile.ZipFile(packed, "w") as archive:
            for path in sorted(p for p in unpacked.rglob("*") if p.is_file()):
                archive.write(path, path.relative_to(unpacked).as_posix())
        return "\n".join(check_backup(packed).faults)

    assert faults() == ""
    raw[0].write_bytes(good[:-1] + b"!")
    assert f"{raw[0].name} is damaged" in faults()
    raw[0].unlink()
    assert f"{raw[0].name} is missing" in faults()
    with pytest.raises(ValueError, match="not whole, nothing was restored"):
        restore(Settings(data_dir=tmp_path / "new"), unpacked)
    assert not (tmp_path / "new" / "casedrain.sqlite").exists()
    raw[0].write_bytes(good)
    (unpacked / "stranger").write_text("x")
    assert "stranger is no part" in faults()
    (unpacked / "stranger").unlink()
    rows = unpacked / "rows" / "records.jsonl"
    rows.write_bytes(rows.read_bytes().replace(b"F-1", b"F-7"))
    assert "rows/records.jsonl is damaged" in faults()
    manifest = unpacked / "manifest.json"
    manifest.write_text(manifest.read_text().replace('"raw_files": 2', '"raw_files": 3'))
    with pytest.raises(ValueError, match=r"manifest.json was changed"):
        faults()


def test_a_forged_backup_whose_hashes_fit_breaks_the_chain(kept: Installation, tmp_path: Path) -> None:
    place = tmp_path / "backup"
    with kept.database.engine.begin() as connection:
        connection.exec_driver_sql("UPDATE audit_entries SET actor = 'nobody' WHERE id = 1")
    make_backup(kept, place)
    assert check_backup(place).faults == ["audit log: entry 1 (link 1) was changed"]
    assert "another key" in check_backup(place, "00" * 32).faults[-1]


def test_a_backup_is_whole_or_not_at_all(kept: Installation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place, gone = tmp_path / "backup", raw_files_of(kept)[0]
    content = gone.read_bytes()
    gone.unlink()
    with pytest.raises(ValueError, match=rf"1 raw files are missing .*{gone.name} of record .*--with-gaps"):
        make_backup(kept, place)
    assert list(tmp_path.glob("backup*")) == []
    with kept.database.reading() as session:
        assert session.scalars(select(Backup)).all() == []
    manifest = make_backup(kept, place, with_gaps=True)
    assert manifest["gaps"] == [gone.name]
    assert f"{gone.name} were missing when the backup was made" in "\n".join(check_backup(place).faults)
    with pytest.raises(FileExistsError, match="exists already"):
        make_backup(kept, place)
    gone.write_bytes(content)

    def full(*_: Any) -> Iterator[bytes]:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(RawStore, "chunks", full)
        with pytest.raises(OSError, match="No space"):
            make_backup(kept, tmp_path / "other.zip")
    assert list(tmp_path.glob("other*")) == []
    # bytes that a retention takes after the state was read: another state is taken
    took = RawStore.chunks

    def expiring(store: RawStore, digest: str) -> Iterator[bytes]:
        if digest == gone.name and gone.exists():
            gone.unlink()
            with kept.database.engine.begin() as connection:
                when = "UPDATE records SET raw_removed_at = received_at WHERE content_hash = ?"
                connection.exec_driver_sql(when, (digest,))
        return took(store, digest)

    monkeypatch.setattr(RawStore, "chunks", expiring)
    manifest = make_backup(kept, tmp_path / "later")
    assert (manifest["raw_files"], manifest["gaps"]) == (1, [])
    assert check_backup(tmp_path / "later").faults == []
    forget_backup(kept, manifest["id"])
    with kept.database.reading() as session:
        assert sum(row.removed_at is None for row in session.scalars(select(Backup))) == 1


def test_the_commands(kept: Installation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept.database.close()
    monkeypatch.setenv("CASEDRAIN_DATA_DIR", str(kept.folder))
    place, proof = str(tmp_path / "b.zip"), str(tmp_path / "proof.jsonl")

    def run(*words: str, code: int = 0) -> str:
        done = runner.invoke(app, list(words))
        assert done.exit_code == code, done.output
        return done.output

    assert json.loads(run("check", "--json"))["whole"] is True
    assert "2 raw files" in run("backup", place)
    assert "exists already" in run("backup", place, code=1)
    assert "name the place" in run("backup", code=2)
    assert "Whole." in run("check", place)
    assert "is used" in run("restore", place, code=1)
    head = run("audit", "head")
    (tmp_path / "head.json").write_text(head)
    assert "Restored backup" in run("restore", place, "--force")
    assert "Whole." in run("audit", "verify", "--against", str(tmp_path / "head.json"))
    assert "links in" in run("audit", "export", proof)
    told = json.loads(run("audit", "verify", "--file", proof, "--json"))
    assert (told["whole"], told["links"]) == (True, 2)
    assert "0 entries were chained" in run("audit", "adopt", "--reason", "none there")
    Path(proof).write_text(Path(proof).read_text().replace("local", "lokal", 1))
    assert "was changed" in run("audit", "verify", "--file", proof, code=1)
    with Database(f"sqlite:///{kept.folder / 'casedrain.sqlite'}").engine.begin() as connection:
        connection.exec_driver_sql("UPDATE audit_entries SET action = 'x' WHERE id = 2")
    assert "entry 2 (link 2) was changed" in run("audit", "verify", code=1)
    assert "audit log: entry 2" in run("check", code=1)
    file = kept.folder / "casedrain.sqlite"
    content = bytearray(file.read_bytes())
    content[4096:40960] = bytes(36864)
    file.write_bytes(content)
    for words in (["check"], ["backup", str(tmp_path / "never")], ["audit", "verify"]):
        assert "database cannot be read" in run(*words, code=1)
    monkeypatch.setenv("CASEDRAIN_DATA_DIR", str(tmp_path / "nowhere"))
    for words in (["check"], ["backup", place], ["audit", "verify"], ["audit", "head"]):
        assert "no database at" in run(*words, code=1)
    assert "neither a folder nor a ZIP" in run("restore", str(tmp_path / "head.json"), code=1)
    assert METADATA["pump_serial"] == "P-1"
