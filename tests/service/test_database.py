"""Storage: migrations against tables, instants, a Postgres that is behind, raw bytes that are damaged."""

from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import pytest
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy import select, text

from service.errors import Unavailable
from service.running import opened
from service.settings import Settings
from service.storage.database import Database, alembic_config, pending_migration
from service.storage.raw_store import RawStore, content_hash
from service.storage.tables import Aircraft, Base, Pump, Record, StoredAssessment


def test_migrations_and_tables_agree(database_url: str) -> None:
    database = Database(database_url)
    with database.engine.connect() as connection:
        assert compare_metadata(MigrationContext.configure(connection), Base.metadata) == []
    assert pending_migration(database) is None
    database.close()


def test_instants_come_back_in_utc(database_url: str) -> None:
    database = Database(database_url)
    instant = datetime(2026, 5, 2, 9, 11, tzinfo=timezone(timedelta(hours=2)))
    with database.writing() as session:
        session.add(Pump(operator="o", serial="s", pump_type="h225", confirmed=True, created_at=instant))
    with database.reading() as session:
        back = session.scalars(select(Pump.created_at)).one()
    assert back == instant
    assert back.tzinfo is UTC
    with pytest.raises(Exception, match="needs a time zone"), database.writing() as session:
        session.add(
            Pump(operator="o", serial="t", pump_type="h225", confirmed=True, created_at=datetime(2026, 1, 1))  # noqa: DTZ001
        )
    database.close()


def test_a_failed_block_leaves_nothing(database_url: str) -> None:
    database = Database(database_url)
    now = datetime.now(UTC)

    def halfway() -> None:
        with database.writing() as session:
            session.add(Pump(operator="o", serial="s", pump_type="h225", confirmed=True, created_at=now))
            session.flush()
            raise RuntimeError("halfway")

    with pytest.raises(RuntimeError, match="halfway"):
        halfway()
    with database.reading() as session:
        assert session.scalars(select(Pump)).all() == []
    database.close()


def test_a_database_behind_is_migrated_on_sqlite_and_refused_on_postgres(database_url: str, tmp_path: Path) -> None:
    command.downgrade(alembic_config(database_url), "base")
    settings = Settings(database_url=database_url, data_dir=tmp_path)
    if database_url.startswith("sqlite"):
        opened(settings).database.close()
        database = Database(database_url)
        assert pending_migration(database) is None
        database.close()
    else:
        with pytest.raises(RuntimeError, match="casedrain db upgrade"):
            opened(settings)


def test_raw_bytes_are_kept_once_and_checked(tmp_path: Path) -> None:
    store = RawStore(str(tmp_path / "raw"))
    digest = store.put(b"abc")
    assert digest == content_hash(b"abc") == store.put(b"abc")
    assert store.get(digest) == b"abc"
    kept = [p for p in (tmp_path / "raw").rglob("*") if p.is_file()]
    assert len(kept) == 1
    kept[0].write_bytes(b"abd")
    with pytest.raises(Unavailable, match="damaged"):
        store.get(digest)
    kept[0].unlink()
    with pytest.raises(Unavailable, match="not in the raw store"):
        store.get(digest)


def test_the_registry_learns_what_records_had_said_before_it(database_url: str) -> None:
    config = alembic_config(database_url)
    command.downgrade(config, "0001")
    database = Database(database_url)
    now = "'2026-05-02 07:11:00'"
    with database.engine.begin() as connection:
        for statement in (
            f"INSERT INTO pumps VALUES (1, 'north', 'P-1', 'h225', false, {now})",
            "INSERT INTO records (id, operator, pump_id, aircraft, position, segment, status, request, attributes, "
            "content_hash, content_type, request_hash, received_at) VALUES "
            f"('r', 'north', 1, 'F-1', 'LH', '', 'analysed', '{{}}', '{{}}', 'c', 't', 'q', {now})",
            "INSERT INTO records (id, operator, pump_id, segment, status, request, attributes, content_hash, "
            "content_type, request_hash, received_at, supersedes) VALUES "
            f"('old', 'north', 1, '', 'superseded', '{{}}', '{{}}', 'c', 't', 'q', {now}, NULL), "
            "('new', 'north', 1, '', 'analysed', '{}', '{}', 'c', 't', 'q', '2026-05-03 07:11:00', 'old')",
            "INSERT INTO assessments (record_id, pump_id, at, state, trend, verdict) "
            f"VALUES ('r', 1, {now}, 'healthy', '{{}}', '{{}}')",
        ):
            connection.execute(text(statement))
    command.upgrade(config, "head")
    with database.reading() as session:
        assessment = session.scalars(select(StoredAssessment)).one()
        assert (assessment.aircraft, assessment.position) == ("F-1", "LH")
        ended = session.scalar(select(Record.ended_at).where(Record.id == "old"))
        assert ended == datetime(2026, 5, 3, 7, 11, tzinfo=UTC)
        assert session.execute(select(Aircraft.operator, Aircraft.name)).all() == [("north", "F-1")]
    database.close()
