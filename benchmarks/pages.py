"""What pages and the dashboard's calls cost: time, statements and bytes on the wire, over a large fleet and a long history.

``python -m benchmarks.pages`` writes ``benchmarks/results/pages.json``; parts of it by name: ``fleets``, ``lives``, ``records``.
One history is uploaded and folded by the service on Postgres; its rows are then copied to many pumps, two in each aircraft, and, moved
in time, to pumps of many records, so that documents have their true sizes (``records`` leaves out the documents of all but the
newest hundred of each pump). A long record is uploaded as it is. Each request is made twice beforehand: what a process keeps of
pumps whose history has not changed is warm, as on a page of the day; ``first_ms`` is the one that found nothing.

Times are wall clock of one process that also carries the client, on whatever else the machine does: ``processor_ms`` is what the
process itself computed in the median, without Postgres. Copies are alike: a fleet's bytes compress better here than a real
fleet's do. Statements of background threads are counted with those of the request, but for those of the jobs' own engine.
"""

import json
import statistics
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from fastapi.testclient import TestClient
from sqlalchemy import text

from benchmarks import RESULTS, keep
from service.monitoring.precedence import is_ours
from service.reading.standing import keep_standings
from service.settings import Settings
from service.storage.database import upgrade
from service.web.app import create_app
from tests.detectors.fleet import history
from tests.postgres import cluster, create_database
from tests.service.records import document
from tests.service.stored_records import store
from tests.service.test_statements import statements

N_RECORDS, FLEETS, LIVES, RECORDS = 100, (300, 1500), (1_230, 10_000), (100_000, 1_000_000)
_REPEATS = 15
_COPIES = """
insert into pumps select (p).* from (
  select jsonb_populate_record(pumps, jsonb_build_object('id', 1000 + k, 'serial', 'C-' || k, 'standing_at', null)) as p
  from pumps, generate_series({first}, {last}) k where serial = 'P-0') copied;
insert into records select (r).* from (
  select jsonb_populate_record(records, jsonb_build_object(
    'id', md5(id || k), 'pump_id', 1000 + k, 'request_hash', md5(request_hash || k),
    'aircraft', 'A-' || k / 2, 'position', (array['LH', 'RH'])[1 + k % 2],
    'identity_hash', md5(identity_hash || k))) as r
  from records, generate_series({first}, {last}) k where pump_id = {pump}) copied;
insert into assessments select (a).* from (
  select jsonb_populate_record(assessments, jsonb_build_object(
    'record_id', md5(record_id || k), 'pump_id', 1000 + k,
    'aircraft', 'A-' || k / 2, 'position', (array['LH', 'RH'])[1 + k % 2])) as a
  from assessments, generate_series({first}, {last}) k where pump_id = {pump}) copied;
"""
_LIFE = """
insert into pumps select (p).* from (
  select jsonb_populate_record(pumps, jsonb_build_object('id', {id}, 'serial', '{serial}', 'standing_at', null)) as p
  from pumps where serial = 'P-0') copied;
insert into records select (r).* from (
  select jsonb_populate_record(records, jsonb_build_object(
    'id', md5(id || '{serial}' || k), 'pump_id', {id}, 'aircraft', 'L', 'position', '{position}',
    'request_hash', md5(request_hash || '{serial}' || k),
    'identity_hash', md5(identity_hash || '{serial}' || k), 'flight_id', flight_id || '-' || k,
    'started_at', started_at - k * {span}, 'flight_hours', 20000 + flight_hours - {hours} * k)) as r
  from records, generate_series(0, {n} / {records}) k where pump_id = {pump}) copied;
insert into assessments select (a).* from (
  select jsonb_populate_record(assessments, jsonb_build_object(
    'record_id', md5(record_id || '{serial}' || k), 'pump_id', {id}, 'aircraft', 'L', 'position', '{position}', 'at', at - k * {span})) as a
  from assessments, generate_series(0, {n} / {records}) k where pump_id = {pump}) copied;
"""
_EARLIER = """
insert into records select (r).* from (
  select jsonb_populate_record(records, jsonb_build_object(
    'id', md5(id || 'e' || k), 'request_hash', md5(request_hash || 'e' || k), 'identity_hash', md5(identity_hash || 'e' || k),
    'flight_id', flight_id || '-e' || k, 'started_at', started_at - k * {span},
    'reduction', null, 'residuals', null)) as r
  from records, generate_series({first}, {last}) k where pump_id between 1001 and 1298
    and id in (select record_id from assessments where chain is not null)) copied;
insert into assessments select (a).* from (
  select jsonb_populate_record(assessments, jsonb_build_object(
    'record_id', md5(record_id || 'e' || k), 'at', at - k * {span}, 'verdict', '{{}}'::jsonb, 'chain', null)) as a
  from assessments, generate_series({first}, {last}) k where pump_id between 1001 and 1298 and chain is not null) copied;
update pumps set standing_at = null;
"""
"""More of the past for a fleet of ``FLEETS[0]``: that many hundreds of records for each pump."""


def _cost(client: TestClient, url: str, repeats: int = _REPEATS) -> dict[str, float]:
    """Median and 95 % quantile of the time [ms], statements, and bytes on the wire [kB] of one request."""
    start = time.perf_counter()
    answer = client.get(url)
    first = 1.0e3 * (time.perf_counter() - start)
    assert answer.status_code == 200, (url, answer.text[:300])
    client.get(url)
    times, computed = [], []
    for _ in range(repeats):
        start, began = time.perf_counter(), time.process_time()
        with statements() as asked, client.stream("GET", url) as answer:
            wire = sum(len(part) for part in answer.iter_raw())
        times.append(1.0e3 * (time.perf_counter() - start))
        computed.append(1.0e3 * (time.process_time() - began))
    return {
        "median_ms": round(statistics.median(times), 1),
        "p95_ms": round(float(np.quantile(times, 0.95)), 1),
        "processor_ms": round(statistics.median(computed), 1),
        "first_ms": round(first, 1),
        "statements": sum("dbos" not in statement for statement in asked),
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


class _Service:
    """A service over one pump's history, its rows to be copied."""

    def __init__(self, client: TestClient) -> None:
        self.client = client
        self.context = client.app.state.context  # type: ignore[attr-defined]
        self.pump = store(self.context, history(1, N_RECORDS).observations, "P-0", "north")
        with self.context.database.reading() as session:
            own = f"where pump_id = {self.pump.id}"
            self.hours = session.scalar(text(f"select max(flight_hours) from records {own}")) or 1.0  # noqa: S608
        self.span = f"(select max(at) - min(at) + interval '1 day' from assessments {own})"  # noqa: S608

    def run(self, script: str) -> None:
        """Run statements, and keep the standing of the pumps that they have made or changed."""
        database = self.context.database
        with database.writing() as session:
            session.execute(text("set local statement_timeout = 0"))
            for statement in filter(str.strip, script.split(";\n")):
                session.execute(text(statement))
        with database.engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
            connection.execute(text("set statement_timeout = 0"))
            connection.execute(text("vacuum analyze"))
        keep_standings(database, is_ours())


@contextmanager
def _service() -> Iterator[_Service]:
    with cluster() as server, TemporaryDirectory() as folder:
        url = create_database(server, "fleet")
        upgrade(url)
        settings = Settings(database_url=url, data_dir=Path(folder))
        with TestClient(create_app(settings), base_url="http://localhost") as client:
            yield _Service(client)


def fleets(found: dict[str, Any]) -> None:
    """Fleets of ``FLEETS`` pumps."""
    with _service() as service:
        service.run(_COPIES.format(first=1, last=FLEETS[0] - 1, pump=service.pump.id))
        _ask_fleet(service.client, found, f"{FLEETS[0]} pumps of {N_RECORDS} records")
        service.run(_COPIES.format(first=FLEETS[0], last=FLEETS[1] - 1, pump=service.pump.id))
        _ask_fleet(service.client, found, f"{FLEETS[1]} pumps of {N_RECORDS} records")


def lives(found: dict[str, Any]) -> None:
    """A long record, and the pages of pumps of ``LIVES`` records in a fleet."""
    with _service() as service:
        client, json_type = service.client, {"content-type": "application/json"}
        made = client.post("/api/v1/records", content=_long_record(), headers=json_type)
        assert made.status_code == 201, made.text
        found["record page, 10 Hz for 3 h"] = _cost(client, f"/records/{made.json()['record_id']}")
        service.run(_COPIES.format(first=1, last=FLEETS[0] - 4, pump=service.pump.id))
        for k, n in enumerate(LIVES):
            held = {"id": 900 + k, "serial": f"L-{n}", "n": n - 1, "records": N_RECORDS, "pump": service.pump.id}
            service.run(_LIFE.format(**held, position=("LH", "RH")[k], span=service.span, hours=service.hours))
        for n in LIVES:
            for name, query in (("", ""), (", all", "&range=all"), (", beside the fleet", "&compare=both")):
                call = f"/pumps/L-{n}?operator=north{query}"
                found[f"pump page, {n} records{name}"] = _cost(client, call)
            found[f"curve picture, {n} records, kept"] = _cost(client, f"/pumps/L-{n}/curve.svg?operator=north", 5)
            keep("pages", found)


def records(found: dict[str, Any]) -> None:
    """The fleet's calls over ``RECORDS`` stored records of ``FLEETS[0]`` pumps."""
    with _service() as service:
        service.run(_COPIES.format(first=1, last=FLEETS[0] - 1, pump=service.pump.id))
        first = 1
        for n in RECORDS:
            last = n // (N_RECORDS * FLEETS[0]) - 1
            service.run(_EARLIER.format(first=first, last=last, span=service.span))
            first = last + 1
            _ask_fleet(service.client, found, f"{FLEETS[0]} pumps, {n} records")


def measured(parts: Sequence[str] = ()) -> dict[str, Any]:
    """Costs by what was asked, kept after every step; those of parts that are not named stay as they are."""
    path = RESULTS / "pages.json"
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if parts and path.exists() else {}
    for part in (fleets, lives, records):
        if not parts or part.__name__ in parts:
            part(found)
    return found


def _ask_fleet(client: TestClient, found: dict[str, Any], words: str) -> None:
    for name, call in _fleet_calls().items():
        found[f"{name}, {words}"] = _cost(client, call)
    keep("pages", found)


def main() -> None:
    """Measure and keep."""
    measured(sys.argv[1:])


if __name__ == "__main__":
    main()
