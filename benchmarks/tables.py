"""How Postgres answers for a large fleet: size of rows, time of the queries that pages and folds live on.

``python -m benchmarks.tables`` writes ``benchmarks/results/tables.json``. One history is uploaded and folded by the
service; its rows are then copied to many pumps, so that documents have their true sizes. Every query is timed on a
pump that was not asked for before, with the tables far larger than Postgres' own memory.
"""

import statistics
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from fastapi.testclient import TestClient
from sqlalchemy import select, text

from benchmarks import keep
from service.access.security import Principal
from service.reading import queries
from service.reading.fleet import pump_documents
from service.reading.trend import trend_of
from service.settings import Settings
from service.storage.database import Database, upgrade
from service.storage.tables import Pump
from service.web.app import create_app
from tests.detectors.fleet import history
from tests.postgres import cluster, create_database
from tests.service.stored_records import store

N_RECORDS, N_PUMPS = 200, 1500
"""Of one pump, and pumps: 300,000 records."""
_COPIES = """
insert into pumps select (p).* from (
  select jsonb_populate_record(pumps, jsonb_build_object('id', 1000 + k, 'serial', 'C-' || k)) as p
  from pumps, generate_series(1, {n}) k where serial = 'P-0') copied;
insert into records select (r).* from (
  select jsonb_populate_record(records, jsonb_build_object(
    'id', md5(id || k), 'pump_id', 1000 + k, 'request_hash', md5(request_hash || k),
    'identity_hash', md5(identity_hash || k))) as r
  from records, generate_series(1, {n}) k where pump_id = {pump}) copied;
insert into assessments select (a).* from (
  select jsonb_populate_record(assessments, jsonb_build_object('record_id', md5(record_id || k), 'pump_id', 1000 + k)) as a
  from assessments, generate_series(1, {n}) k where pump_id = {pump}) copied;
"""


def measured() -> dict[str, Any]:
    """Sizes and times at ``N_RECORDS * N_PUMPS`` records."""
    with cluster() as server, TemporaryDirectory() as folder:
        url = create_database(server, "fleet")
        upgrade(url)
        settings = Settings(database_url=url, data_dir=Path(folder))
        with TestClient(create_app(settings), base_url="http://localhost") as client:
            context = client.app.state.context  # type: ignore[attr-defined]
            pump = store(context, history(1, N_RECORDS).observations, "P-0", "north")
            with context.database.writing() as session:
                for statement in _COPIES.format(n=N_PUMPS, pump=pump.id).split(";\n"):
                    if statement.strip():
                        session.execute(text(statement))
            with context.database.engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
                connection.execute(text("vacuum analyze"))
            return {
                "records": N_RECORDS * N_PUMPS,
                "pumps": N_PUMPS,
                **_sizes(context.database),
                **_times(context.database),
            }


def _sizes(database: Database) -> dict[str, Any]:
    found = {}
    with database.reading() as session:
        for table in ("records", "assessments"):
            whole = int(session.scalar(text(f"select pg_total_relation_size('{table}')")) or 0)
            indexes = int(session.scalar(text(f"select pg_indexes_size('{table}')")) or 0)
            rows = int(session.scalar(text(f"select count(*) from {table}")) or 1)  # noqa: S608
            found[f"{table}_bytes_per_row"] = round(whole / rows)
            found[f"{table}_index_share"] = round(indexes / whole, 3)
    return found


def _times(database: Database) -> dict[str, Any]:
    principal = Principal("benchmark", "viewer", "north")

    def of_pumps(ask: Callable[[Any, Pump], Any], n: int = 40) -> float:
        times = []
        for serial in (f"C-{k}" for k in range(7, N_PUMPS, N_PUMPS // n)):
            with database.reading() as session:
                pump = session.scalars(select(Pump).where(Pump.serial == serial)).one()
                start = time.perf_counter()
                ask(session, pump)
                times.append(time.perf_counter() - start)
        return round(1.0e3 * statistics.median(times), 2)

    now = datetime.now(UTC)
    return {
        "one_pump_trend_ms": of_pumps(lambda s, p: trend_of(s, p, "case_flow_at_reference_lpm", None, None, 400)),
        "one_pump_verdict_ms": of_pumps(queries.verdict),
        "one_pump_verdict_at_ms": of_pumps(lambda s, p: queries.verdict(s, p, now)),
        "newest_records_of_an_operator_ms": of_pumps(
            lambda s, _: s.scalars(queries.records(principal).limit(100)).all()
        ),
        "list_of_all_pumps_ms": of_pumps(lambda s, _: pump_documents(s, list(s.scalars(select(Pump)))), n=5),
        "their_last_assessments_ms": of_pumps(
            lambda s, _: queries.last_assessments(s, list(s.scalars(select(Pump.id))))
        ),
        "how_many_records_they_have_ms": of_pumps(lambda s, _: queries.n_records(s, list(s.scalars(select(Pump.id))))),
    }


def main() -> None:
    """Measure and keep."""
    keep("tables", measured())


if __name__ == "__main__":
    main()
