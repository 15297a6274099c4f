"""How long it takes to make a stored fleet's reductions and verdicts again after a release has changed their code.

``python -m benchmarks.renewal [--pumps 40] [--flights 60]`` stores the demo's flights in an SQLite file, marks them as a
migration does, and renews them as a start of the service does; kept as ``benchmarks/results/renewal.json``.
"""

import argparse
import os
import platform
import resource
import tempfile
import time
from pathlib import Path
from threading import Event
from typing import Any

from sqlalchemy import update

from benchmarks import keep
from service.access.security import EVERYBODY
from service.demo.fleet import PUMPS, pump_records
from service.monitoring.acceptance import Upload
from service.monitoring.renewal import Renewal
from service.running import opened
from service.settings import Settings
from service.storage.database import upgrade
from service.storage.tables import Pump, Record, StoredAssessment


def measured(n_pumps: int, n_flights: int) -> dict[str, Any]:
    """Store, mark, renew; the time of storing is told too, it holds the same work and the keeping of bytes."""
    with tempfile.TemporaryDirectory() as folder:
        settings = Settings(data_dir=Path(folder), database_url="", auth="off", parse_workers=1)
        upgrade(settings.effective_database_url)
        context = opened(settings)
        stored, parsing = 0.0, _processor_s(resource.RUSAGE_CHILDREN)
        for i in range(n_pumps):
            for record in pump_records(PUMPS[i % len(PUMPS)], n_flights, seed=1 + i):
                began = time.perf_counter()
                with context.spool.of(record.content) as file:
                    overrides = {"pump_serial": f"P-{i}", "aircraft": f"F-{i}"}
                    context.acceptance.accept(Upload(file, "text/csv", "", overrides), EVERYBODY)
                stored += time.perf_counter() - began
        with context.database.writing() as session:
            session.execute(update(Pump).values(made_by=None, made_with=None))
            session.execute(update(Record).values(reduced_with="an older release"))
            session.execute(update(StoredAssessment).values(chain=None))
        began, cpu = time.perf_counter(), _processor_s()
        n = Renewal(context.database, context.archive).run(Event())
        wall, cpu = time.perf_counter() - began, _processor_s() - cpu
        context.close()
        # the process that reads files has read each of them twice
        cpu += 0.5 * (_processor_s(resource.RUSAGE_CHILDREN) - parsing)
    return {
        "pumps": n_pumps,
        "records": n,
        "storing_s": round(stored, 1),
        "renewing_s": round(wall, 1),
        "renewing_processor_s": round(cpu, 1),
        "records_per_second_of_processor": round(n / cpu, 1),
    }


def _processor_s(of: int = resource.RUSAGE_SELF) -> float:
    used = resource.getrusage(of)
    return used.ru_utime + used.ru_stime


def main() -> None:
    """Measure; two pumps before, for what is compiled and imported."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pumps", type=int, default=40)
    parser.add_argument("--flights", type=int, default=60)
    asked = parser.parse_args()
    measured(2, 4)
    machine = f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
    keep("renewal", {"machine": machine, **measured(asked.pumps, asked.flights)})


if __name__ == "__main__":
    main()
