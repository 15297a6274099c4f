"""What pages and the dashboard's calls cost: time, statements and bytes on the wire, over a large fleet and a long history.

``python -m benchmarks.pages`` writes ``benchmarks/results/pages.json``. One history is uploaded and folded by the service
on Postgres; its rows are then copied to many pumps and, moved in time, to one pump of many records, so that documents have
their true sizes. A long record is uploaded as it is. Each request is made twice beforehand: what a process keeps of pumps whose
history has not changed is warm, as on a page of the day.

Times are wall clock of one process that also carries the client, on whatever else the machine does. Copies are alike: a fleet's
bytes compress better here than a real fleet's do. Statements of background threads are counted with those of the request.
"""

import json
import statistics
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from fastapi.testclient import TestClient
from sqlalchemy import text

from benchmarks import keep
from service.settings import Settings
from service.storage.database import upgrade
from service.web.app import create_app
from tests.detectors.fleet import history
from tests.postgres import cluster, create_database
from tests.service.records import document
from tests.service.stored_records import store
from tests.service.test_statements import statements

N_RECORDS, FLEETS, LIVES = 100, (300, 1500), (1_230, 10_000)
_REPEATS = 15
_COPIES = """
insert into pumps select (p).* from (
  select jsonb_populate_record(pumps, jsonb_build_object('id', 1000 + k, 'serial', 'C-' || k)) as p
  from pumps, generate_series({first}, {last}) k where serial = 'P-0') copied;
insert into records select (r).* from (
  select jsonb_populate_record(records, jsonb_build_object(
    'id', md5(id || k), 'pump_id', 1000 + k, 'request_hash', md5(request_hash || k),
    'identity_hash', md5(identity_hash || k))) as r
  from records, generate_series({first}, {last}) k where pump_id = {pump}) copied;
insert into assessments select (a).* from (
  select jsonb_populate_record(assessments, jsonb_build_object('record_id', md5(record_id || k), 'pump_id', 1000 + k)) as a
  from assessments, generate_series({first}, {last}) k where pump_id = {pump}) copied;
"""
_LIFE = """
insert into pumps select (p).* from (
  select jsonb_populate_record(pumps, jsonb_build_object('id', {id}, 'serial', '{serial}')) as p
  from pumps where serial = 'P-0') copied;
insert into records select (r).* from (
  select jsonb_populate_record(records, jsonb_build_object(
    'id', md5(id || '{serial}' || k), 'pump_id', {id}, 'request_hash', md5(request_hash || '{serial}' || k),
    'identity_hash', md5(identity_hash || '{serial}' || k), 'flight_id', flight_id || '-' || k,
    'started_at', started_at - k * {span}, 'flight_hours', 20000 + flight_hours - {hours} * k)) as r
  from records, generate_series(0, {n} / {records}) k where pump_id = {pump}) copied;
insert into assessments select (a).* from (
  select jsonb_populate_record(assessments, jsonb_build_object(
    'record_id', md5(record_id || '{serial}' || k), 'pump_id', {id}, 'at', at - k * {span})) as a
  from assessments, generate_series(0, {n} / {records}) k where pump_id = {pump}) copied;
"""


def _cost(client: TestClient, url: str, repeats: int = _REPEATS) -> dict[str, float]:
    """Median and 95 % quantile of the time [ms], statements, and bytes on the wire [kB] of one request."""
    for _ in range(2):
        assert client.get(url).status_code == 200, (url, client.get(url).text[:300])
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        with statements() as asked, client.stream("GET", url) as answer:
            wire = sum(len(part) for part in answer.iter_raw())
        times.append(1.0e3 * (time.perf_counter() - start))
    return {
        "median_ms": round(statistics.median(times), 1),
        "p95_ms": round(float(np.quantile(times, 0.95)), 1),
        "statements": len(asked),
        "wire_kb": round(wire / 1000.0, 1),
    }


def _fleet_calls() -> dict[str, str]:
    return {
        "fleet page": "/",
        "ranking": "/api/v1/fleet/ranking",
        "summary": "/api/v1/fleet/summary",
        "trend": "/api/v1/fleet/trend?metric=case_flow_at_reference_lpm",
        "alarms page": "/alarms",
    }


def _long_record() -> bytes:
    """Three hours at 10 Hz with noise, seven channels."""
    record = document()
    time_s, rng = np.array(record["channels"]["time_s"]), np.random.default_rng(1)
    dense = np.arange(0.0, 10_800.0, 0.1)
    channels = {
        name: np.round(np.interp(dense, time_s, values) + 0.002 * rng.normal(size=len(dense)), 4).tolist()
        for name, values in record["channels"].items()
    }
    channels["time_s"] = np.round(dense, 1).tolist()
    return json.dumps({**record, "pump_serial": "LONG", "channels": channels}).encode()


def measured() -> dict[str, Any]:
    """Costs, kept after every step: fleets of ``FLEETS`` pumps, pumps of ``LIVES`` records, a long record."""
    found: dict[str, Any] = {}
    with cluster() as server, TemporaryDirectory() as folder:
        url = create_database(server, "fleet")
        upgrade(url)
        settings = Settings(database_url=url, data_dir=Path(folder))
        with TestClient(create_app(settings), base_url="http://localhost") as client:
            context = client.app.state.context  # type: ignore[attr-defined]

            def run(script: str) -> None:
                with context.database.writing() as session:
                    session.execute(text("set local statement_timeout = 0"))
                    for statement in filter(str.strip, script.split(";\n")):
                        session.execute(text(statement))
                with context.database.engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
                    connection.execute(text("vacuum analyze"))

            pump = store(context, history(1, N_RECORDS).observations, "P-0", "north")
            made = client.post("/api/v1/records", content=_long_record(), headers={"content-type": "application/json"})
            assert made.status_code == 201, made.text
            record = made.json()["record_id"]
            found["record page, 10 Hz for 3 h"] = _cost(client, f"/records/{record}")
            with context.database.reading() as session:
                own = f"where pump_id = {pump.id}"
                hours = session.scalar(text(f"select max(flight_hours) from records {own}"))  # noqa: S608
            days = f"(select max(at) - min(at) + interval '1 day' from assessments {own})"  # noqa: S608
            run(_COPIES.format(first=1, last=FLEETS[0] - 2, pump=pump.id))
            _ask_fleet(client, found, FLEETS[0])
            for k, n in enumerate(LIVES):
                held = {"id": 900 + k, "serial": f"L-{n}", "n": n - 1, "records": N_RECORDS, "pump": pump.id}
                run(_LIFE.format(**held, span=days, hours=hours or 1.0))
                for name, query in (("", ""), (", all", "&range=all"), (", beside the fleet", "&compare=both")):
                    call = f"/pumps/L-{n}?operator=north{query}"
                    found[f"pump page, {n} records{name}"] = _cost(client, call, 5)
                found[f"curve picture, {n} records, kept"] = _cost(client, f"/pumps/L-{n}/curve.svg?operator=north", 5)
                keep("pages", found)
            run(_COPIES.format(first=FLEETS[0] - 1, last=FLEETS[1] - 4, pump=pump.id))
            _ask_fleet(client, found, FLEETS[1])
    return found


def _ask_fleet(client: TestClient, found: dict[str, Any], n: int) -> None:
    for name, call in _fleet_calls().items():
        found[f"{name}, {n} pumps of {N_RECORDS} records"] = _cost(client, call)
    keep("pages", found)


def main() -> None:
    """Measure and keep."""
    measured()


if __name__ == "__main__":
    main()
