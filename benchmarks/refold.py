"""Cost of the n-th upload's refold, with snapshots and from the first record on, on an SQLite file, one core.

``python -m benchmarks.refold`` writes ``benchmarks/results/refold.json``. Reading and reducing the upload is not counted;
what is: gathering what is known of the pump, the fold, storing assessments and snapshots, bringing alarms in line, and
the commit.
"""

import os
import platform
import tempfile
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from statistics import median
from typing import Any

from sqlalchemy import func, select

from benchmarks import keep
from detectors.evaluation.reality import REALITIES, fleet
from detectors.evaluation.rows import LEAKS, Growing
from detectors.evaluation.sensing import Sensing, histories
from detectors.evaluation.study import seed_of
from detectors.judgement.version import twin_version
from detectors.words.observation import Observation
from service.context import Context
from service.history.analysis import analysis_key
from service.history.codec import reduction_to_json
from service.history.setting import Setting
from service.monitoring.refold import refold
from service.running import opened
from service.settings import Settings
from service.storage.database import upgrade
from service.storage.tables import ANALYSED, FoldSnapshot, Pump, Record
from service.thresholds.layers import thresholds_of
from twin.pumps import pump_type

SIZES, REPEATS, LATE_BY = (100, 1000), 5, 20


def history_of(n: int) -> list[Observation]:
    """One pump whose leakage grows: faults cost hypotheses."""
    kind, circuit, rng = pump_type("h225"), Setting().circuit_parameters, seed_of(1, "refold")
    flown = n + n // 4  # some drop out
    flights = fleet(REALITIES[0], kind, circuit, rng, 1, flown, Growing(LEAKS, 0.6).courses(1, flown, 0))
    return list(histories(flights, kind, Sensing(), rng)[0].observations)[:n]


def add(context: Context, observations: Sequence[Observation], key: str) -> None:
    """Store records of the pump, already reduced."""
    with context.database.writing() as session:
        pump = session.scalars(select(Pump)).one()
        session.add_all(
            Record(
                id=o.record_id,
                operator="default",
                pump_id=pump.id,
                aircraft=o.aircraft,
                position=o.position,
                flight_id=o.flight_id,
                segment="",
                started_at=o.at,
                status=ANALYSED,
                request={},
                attributes={},
                content_hash="",
                content_type="",
                request_hash=o.record_id,
                identity_hash=o.record_id,
                received_at=o.at,
                reduced_with=key,
                reduction=reduction_to_json(o.reduction),
            )
            for o in observations
        )


def with_one_pump(folder: Path) -> tuple[Context, str]:
    """A service on SQLite that knows a pump without records, and the key of the analyses that it takes."""
    settings = Settings(data_dir=folder, database_url="", auth="off")
    upgrade(settings.effective_database_url)
    context = opened(settings)
    with context.database.writing() as session:
        session.add(
            Pump(operator="default", serial="P-1", pump_type="h225", confirmed=True, created_at=datetime.now(UTC))
        )
        session.flush()
        return context, analysis_key(pump_type("h225"), Setting(), thresholds_of(session, "default", "P-1", "h225"))


def _refolded(context: Context, *, from_scratch: bool) -> float:
    """Milliseconds of one refold with its commit."""
    start = time.process_time()
    with context.database.writing() as session:
        refold(session, session.scalars(select(Pump)).one(), context.archive, from_scratch=from_scratch)
    return 1e3 * (time.process_time() - start)


def measured(n: int) -> dict[str, Any]:
    """The upload of record n and of the few after it, one by one; then some that come late; then all from scratch."""
    observations = history_of(n + REPEATS)
    late = [observations.pop(n - LATE_BY) for _ in range(REPEATS)] if n > 2 * LATE_BY else []
    with tempfile.TemporaryDirectory() as folder:
        context, key = with_one_pump(Path(folder))
        first, last = observations[:-REPEATS], observations[-REPEATS:]
        add(context, first, key)
        _refolded(context, from_scratch=True)
        appended, inserted = [], []
        for found, group in ((appended, last), (inserted, late)):
            for observation in group:
                add(context, [observation], key)
                found.append(_refolded(context, from_scratch=False))
        whole = [_refolded(context, from_scratch=True) for _ in range(REPEATS)]
        with context.database.reading() as session:
            kept = [len(content) for content in session.scalars(select(FoldSnapshot.content))]
            reductions = session.scalar(select(func.sum(func.length(Record.reduction))))
        context.close()
    return {
        "records": n,
        "with_snapshots_ms": round(median(appended), 1),
        f"with_snapshots_late_by_{LATE_BY}_ms": round(median(inserted), 1) if inserted else None,
        "from_the_first_record_ms": round(median(whole), 1),
        "snapshots": len(kept),
        "snapshot_bytes": int(median(kept)),
        "reductions_bytes": int(reductions or 0),
    }


def main() -> None:
    """Measure at both sizes; a small one before compiles."""
    measured(8)
    keep(
        "refold",
        {
            "twin": twin_version(pump_type("h225")),
            "machine": f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}",
            "clock": "processor time of one process; a load above 1 when it starts means company that slows it down",
            "load_at_start": round(os.getloadavg()[0], 1),
            "sizes": [measured(n) for n in SIZES],
        },
    )


if __name__ == "__main__":
    main()
