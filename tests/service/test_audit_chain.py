"""The audit log as a chain: what was changed, removed, inserted, reordered or cut is found, whoever did it where."""

import copy
import json
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from alembic import command
from sqlalchemy import delete, func, insert, select, text

from service.access import audit
from service.access.audit_proof import Findings, stored_proof, verify, verify_database
from service.access.security import EVERYBODY
from service.running import opened
from service.settings import Settings
from service.storage.audit_anchor import ANCHOR_FILE, Anchor, read_anchor
from service.storage.audit_chain import append, content_hash, content_of, first_link
from service.storage.audit_key import KEY_FILE, AuditKey, is_signed
from service.storage.database import Database, alembic_config, upgrade
from service.storage.tables import AuditEntry, AuditHead, AuditLink, Backup
from tests.service.guarded import guarded_client, key
from tests.service.records import body, document

JSON = {"content-type": "application/json"}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "data"


@pytest.fixture
def database(database_url: str, folder: Path) -> Iterator[Database]:
    """A log of nine entries of two operators and of nobody."""
    context = opened(Settings(database_url=database_url, data_dir=folder))
    for i in range(9):
        noted(context.database, ("north", "south", None)[i % 3], i)
    yield context.database
    context.close()


def noted(database: Database, operator: str | None, i: int) -> None:
    with database.writing() as session:
        details = {"number": i, "size": 2.0, "small": 1e-9, "large": 1e22, "words": ["é", None, {"z": 1, "a": -0.0}]}
        audit.note(session, EVERYBODY, "alarm.close", f"alarm/{i}", operator, details)


def verified(database: Database, folder: Path) -> Findings:
    anchor = read_anchor(folder)
    return verify_database(database, AuditKey("", folder).public, [anchor] if anchor else [])


def execute(database: Database, statement: str) -> None:
    with database.engine.begin() as connection:
        changed = connection.execute(text(statement))
        assert changed.rowcount != 0


def test_a_log_that_nobody_touched_is_whole(database: Database, folder: Path) -> None:
    found = verified(database, folder)
    assert found.faults == []
    assert (found.links, found.erased) == (9, 0)
    assert (folder / KEY_FILE).stat().st_mode & 0o077 == 0


SWAPPED = "CASE {0} WHEN 3 THEN 4 ELSE 3 END"
TAMPERED = {
    "one byte of a subject": ("UPDATE audit_entries SET subject = 'alarm/9' WHERE id = 5", "entry 5 .* was changed"),
    "one byte of an instant": ("UPDATE audit_entries SET at = '2026-01-01 00:00:00' WHERE id = 5", "entry 5 .* changed"),
    "a detail": ("""UPDATE audit_entries SET details = '{"number": 5}' WHERE id = 5""", "entry 5 .* was changed"),
    "an operator": ("UPDATE audit_entries SET operator = NULL WHERE id = 5", "entry 5 .* was changed"),
    "a salt": ("UPDATE audit_entries SET salt = NULL WHERE id = 5", "entry 5 .* was changed"),
    "an entry removed": ("DELETE FROM audit_entries WHERE id = 5", "entry of link 5 was removed"),
    "an entry inserted": (
        "INSERT INTO audit_entries (id, at, actor, role, action, subject, details, salt) "
        "SELECT 99, at, actor, role, action, subject, details, salt FROM audit_entries WHERE id = 1",
        "entry 99 is not in the chain",
    ),
    "a link removed": ("DELETE FROM audit_links WHERE position = 5", "links 5 to 5 were removed"),
    "a link's hash": ("UPDATE audit_links SET content_hash = 'f' || substr(content_hash, 2) || 'f' WHERE position = 5", "link 5 "),
    "a cut end": ("DELETE FROM audit_links WHERE position > 7", "its end was cut"),
    "another count": ("UPDATE audit_heads SET count = 8", "its end was cut or added to"),
    "no signature": ("UPDATE audit_heads SET signature = ''", "head is not signed"),
    "no head": ("DELETE FROM audit_heads", "no proof of an audit log, or its head"),
}  # fmt: skip


@contextmanager
def untouched_afterwards(database: Database) -> Iterator[None]:
    tables = [table.__table__ for table in (AuditEntry, AuditLink, AuditHead)]
    with database.engine.connect() as connection:
        kept = [[dict(row) for row in connection.execute(select(table)).mappings()] for table in tables]
    yield
    with database.engine.begin() as connection:
        for table, rows in zip(tables, kept, strict=True):
            connection.execute(delete(table))
            connection.execute(insert(table), rows)


def test_what_was_changed_is_found(database: Database, folder: Path) -> None:
    for what, (statement, fault) in TAMPERED.items():
        with untouched_afterwards(database):
            execute(database, statement)
            found = verified(database, folder)
            assert any(re.search(fault, f) for f in found.faults), (what, found.faults)
            assert len(found.faults) <= 3, what
    assert verified(database, folder).faults == []


def test_what_was_reordered_is_found(database: Database, folder: Path) -> None:
    for column in ("subject", "salt", "details", "operator"):
        with untouched_afterwards(database):
            swapped = f"(SELECT b.{column} FROM audit_entries b WHERE b.id = 7 - audit_entries.id)"
            execute(database, f"UPDATE audit_entries SET {column} = {swapped} WHERE id IN (3, 4)")
            assert verified(database, folder).faults != [], column
    for before, after in ((3, 103), (4, 3), (103, 4)):
        execute(database, f"UPDATE audit_links SET position = {after} WHERE position = {before}")
    assert "link 3 does not follow" in verified(database, folder).faults[0]


def test_an_entry_that_was_changed_with_its_hash_breaks_the_links(database: Database, folder: Path) -> None:
    with database.writing() as session:
        entry = session.get_one(AuditEntry, 5)
        entry.actor = "nobody"
        link = session.scalars(select(AuditLink).where(AuditLink.entry_id == 5)).one()
        link.content_hash = content_hash(entry.salt or "", content_of(entry))
    assert verified(database, folder).faults == [
        "link 5 does not follow from the one before: it was changed or reordered"
    ]


def rewritten(database: Database, hacker: AuditKey | None) -> None:
    """What somebody does who knows this code and owns the database, but not the key: a chain without entry 5."""
    with database.writing() as session:
        kept = list(session.scalars(select(AuditEntry).where(AuditEntry.id != 5).order_by(AuditEntry.id)))
        for link in session.scalars(select(AuditLink)):
            session.delete(link)
        session.delete(session.get_one(AuditEntry, 5))
        session.flush()
        head = session.get_one(AuditHead, 1)
        head.count, head.link = 0, first_link(head.chain_id)
        append(session, kept, hacker)


def test_a_chain_that_is_consistent_but_not_ours_is_found(database: Database, folder: Path, tmp_path: Path) -> None:
    rewritten(database, AuditKey("", tmp_path / "elsewhere"))
    assert "signed with another key" in verified(database, folder).faults[-1]
    execute(database, "UPDATE audit_heads SET signature = ''")
    opened(Settings(database_url=database.url, data_dir=folder)).close()  # a start signs what nobody has signed …
    noted(database, None, 20)
    assert verified(database, folder).faults == []  # … so that the anchor, which this short log lacks, must tell
    execute(database, "UPDATE audit_heads SET signature = ''")


def test_a_log_put_back_to_an_older_state_misses_its_anchor(database: Database, folder: Path) -> None:
    with database.reading() as session:
        old = session.get_one(AuditHead, 1)
    noted(database, "north", 10)
    opened(Settings(database_url=database.url, data_dir=folder)).close()
    anchor = read_anchor(folder)
    assert anchor is not None
    assert anchor.count == 10
    execute(database, "DELETE FROM audit_links WHERE position = 10")
    execute(database, "DELETE FROM audit_entries WHERE id = 10")
    execute(database, f"UPDATE audit_heads SET count = 9, link = '{old.link}', signature = '{old.signature}'")
    assert verify_database(database, None, []).faults == []  # rightly signed once: only who remembers can tell
    assert "ends before link 10" in verified(database, folder).faults[0]
    opened(Settings(database_url=database.url, data_dir=folder)).close()
    assert read_anchor(folder) == anchor, "a start must not bless what was put back"
    assert "begun anew" in verify_database(database, None, [Anchor("other", 3, "x")]).faults[0]


def test_writers_at_once_keep_one_chain(database: Database, folder: Path) -> None:
    def write(operator: str) -> None:
        for i in range(10):
            noted(database, operator, i)

    threads = [threading.Thread(target=write, args=(f"o{n}",)) for n in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    found = verified(database, folder)
    assert found.faults == []
    assert found.links == 69


def test_a_transaction_that_fails_leaves_no_link(database: Database, folder: Path) -> None:
    def halfway() -> None:
        with database.writing() as session:
            audit.note(session, EVERYBODY, "a.b", "x", None)
            raise RuntimeError("halfway")

    with pytest.raises(RuntimeError):
        halfway()
    found = verified(database, folder)
    assert (found.faults, found.links) == ([], 9)


def test_what_a_release_before_the_chain_wrote_is_adopted(database: Database, folder: Path) -> None:
    execute(
        database,
        "INSERT INTO audit_entries (id, at, actor, role, action, subject, details) "
        "SELECT 50, at, actor, role, action, subject, details FROM audit_entries WHERE id = 1",
    )
    assert "adopt" in verified(database, folder).faults[0]
    with database.writing() as session:
        assert audit.adopt(session, EVERYBODY, "an old replica ran beside") == 1
    found = verified(database, folder)
    assert (found.faults, found.links) == ([], 11)


class TestProof:
    def lines(self, database: Database, operator: str | None = None) -> list[dict[str, Any]]:
        with database.snapshot() as session:
            return [json.loads(json.dumps(line)) for line in stored_proof(session, operator)]

    def test_a_file_proves_itself(self, database: Database, folder: Path) -> None:
        found = verify(self.lines(database), AuditKey("", folder).public)
        assert (found.faults, found.links, found.withheld) == ([], 9, 0)
        assert "another key" in verify(self.lines(database), "00" * 32).faults[0]

    def test_an_operator_proves_its_own_entries_and_sees_no_others(self, database: Database, folder: Path) -> None:
        lines = self.lines(database, "north")
        found = verify(lines, AuditKey("", folder).public)
        assert (found.faults, found.links, found.withheld) == ([], 9, 6)
        assert {line["content"]["operator"] for line in lines[1:] if line["content"]} == {"north"}
        assert not any(line["salt"] for line in lines[1:] if not line["content"])

    def test_a_file_that_was_changed_does_not(self, database: Database) -> None:
        changes: list[Callable[[list[dict[str, Any]]], Any]] = [
            lambda lines: lines[3]["content"].update(actor="somebody else"),
            lambda lines: lines.pop(3),
            lambda lines: lines.pop(),
            lambda lines: lines.insert(3, lines[3]),
            lambda lines: lines.insert(3, lines.pop(4)),
            lambda lines: lines[3].update(content=None),
            lambda lines: lines[0]["head"].update(count=8),
            lambda lines: lines[0].pop("head"),
            lambda lines: lines[3].pop("link"),
            lambda lines: lines.clear(),
        ]
        whole = self.lines(database)
        for number, change in enumerate(changes):
            lines = copy.deepcopy(whole)
            change(lines)
            assert verify(lines, None).faults != [], number


def test_a_deleted_operator_leaves_hashes_and_one_receipt(database_url: str, tmp_path: Path) -> None:
    with guarded_client(database_url, tmp_path) as client:
        context = client.app.state.context  # type: ignore[attr-defined]
        root = key(client, "admin", owner="root")
        for operator in ("north", "south"):
            sent = body(document(reservoir_pressure_bar=[0.5 if operator == "north" else 0.6] * 160))
            headers = {**JSON, **key(client, "analyst", operator, owner=f"ann of {operator}")}
            assert client.post("/api/v1/records", content=sent, headers=headers).status_code == 201
        with context.database.writing() as session:
            begun = datetime.now(UTC) - timedelta(days=3)
            session.add(Backup(id="b1", started_at=begun, finished_at=begun, removed_at=None, place="x"))
            gone = Backup(id="b0", started_at=begun, finished_at=begun, removed_at=datetime.now(UTC), place="x")
            session.add(gone)
        place = "/api/v1/operators/north?confirm=north&reason=left"
        receipt = client.delete(place, headers=root).json()["receipt"]
        assert receipt["audit_links_erased"] == [[1, 1]]
        assert [(b["id"], b["age_days"]) for b in receipt["backups"]] == [("b1", 3.0)]
        found = verified(context.database, tmp_path / "data")
        assert (found.faults, found.links, found.erased) == ([], 3, 1)
        with context.database.snapshot() as session:
            proof = json.dumps(list(stored_proof(session)))
        assert "ann of north" not in proof
        assert "ann of south" in proof
        # the number of what was erased is given to nobody else, even if it was the last
        assert client.delete("/api/v1/operators/south?confirm=south&reason=left", headers=root).status_code == 200
        noted(context.database, None, 1)
        found = verified(context.database, tmp_path / "data")
        assert (found.faults, found.links, found.erased) == ([], 5, 2)
        # without its receipt an erased entry is a removed one
        execute(context.database, "DELETE FROM audit_entries WHERE action = 'operator.delete'")
        assert len(verified(context.database, tmp_path / "data").faults) == 4


def test_entries_from_before_are_chained_by_the_migration(database_url: str, tmp_path: Path) -> None:
    command.downgrade(alembic_config(database_url), "0012")
    before = Database(database_url)
    now = "'2026-05-02 07:11:00.123456'"
    with before.engine.begin() as connection:
        for i in (3, 7):
            values = f"({i}, {now}, 'ann', 'admin', 'key.make', 'key/{i}', '{{\"owner\": \"o\", \"n\": 2.0}}')"
            columns = "(id, at, actor, role, action, subject, details)"
            connection.execute(text(f"INSERT INTO audit_entries {columns} VALUES {values}"))
    before.close()
    upgrade(database_url)
    context = opened(Settings(database_url=database_url, data_dir=tmp_path))
    found = verified(context.database, tmp_path)
    assert (found.faults, found.links) == ([], 2)
    with context.database.reading() as session:
        assert session.scalar(select(func.count()).select_from(AuditEntry).where(AuditEntry.salt.is_(None))) == 0
    context.close()


def test_the_key_of_the_environment_wins_and_a_wrong_one_is_one_sentence(tmp_path: Path) -> None:
    given = AuditKey("11" * 32, tmp_path)
    assert given.file is None
    assert is_signed(b"x", given.sign(b"x"), given.public)
    assert not is_signed(b"y", given.sign(b"x"), given.public)
    assert not is_signed(b"x", "zz", given.public)
    with pytest.raises(RuntimeError, match="CASEDRAIN_AUDIT_KEY is 64 hexadecimal digits"):
        opened(Settings(data_dir=tmp_path, audit_key="short"))
    assert not (tmp_path / KEY_FILE).exists()
    assert not (tmp_path / ANCHOR_FILE).exists()
