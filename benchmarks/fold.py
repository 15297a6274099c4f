"""Time of the fold: from reduced records to verdicts, one core, histories of a fleet in bulk.

``python -m benchmarks.fold`` writes ``benchmarks/results/fold.json``. Simulating and reducing the records is not
counted; every record's verdict is.
"""

import os
import platform
import time
from typing import Any

import numpy as np

from benchmarks import keep
from detectors.evaluation.reality import REALITIES, fleet
from detectors.evaluation.rows import LEAKS, Growing
from detectors.evaluation.sensing import Sensing, histories
from detectors.evaluation.study import seed_of
from detectors.judgement.assessment import assess
from detectors.judgement.version import twin_version
from detectors.words.thresholds import effective
from twin.pumps import circuit_parameters, pump_type

N_PUMPS, N_FLIGHTS, SEED = 100, 200, 1
LIMIT_MS = 0.3
"""Our own target for one pump's update in bulk."""


def measured(*, burst: bool, n_pumps: int = N_PUMPS, n_flights: int = N_FLIGHTS) -> dict[str, Any]:
    """Milliseconds a record on one core: median over pumps, the slowest pump, and the whole fleet.

    Half of the pumps stay healthy, half have leakage that grows: faults cost hypotheses.
    """
    pump, circuit, thresholds = pump_type("h225"), circuit_parameters("shared_return"), effective({})
    per_pump, records = [], 0
    for half, faults in enumerate((None, Growing(LEAKS, 0.6))):
        rng = seed_of(SEED, "fold", half, int(burst))
        n = n_pumps // 2
        courses = () if faults is None else faults.courses(n, n_flights, 0)
        flights = fleet(REALITIES[0], pump, circuit, rng, n, n_flights, courses)
        fleet_histories = histories(flights, pump, Sensing(burst=burst), rng)
        assess(fleet_histories[0], pump, circuit, thresholds)  # compiles
        for history in fleet_histories:
            start = time.process_time()
            found = assess(history, pump, circuit, thresholds)
            per_pump.append((time.process_time() - start) / len(found))
            records += len(found)
    ms = 1.0e3 * np.array(per_pump)
    return {
        "records": records,
        "ms_per_record": round(float(ms.mean()), 4),
        "ms_per_record_median_pump": round(float(np.median(ms)), 4),
        "ms_per_record_slowest_pump": round(float(ms.max()), 4),
        "met": bool(ms.mean() <= LIMIT_MS),
    }


def main() -> None:
    """Measure with and without bursts."""
    keep(
        "fold",
        {
            "pumps": N_PUMPS,
            "flights": N_FLIGHTS,
            "limit_ms": LIMIT_MS,
            "twin": twin_version(pump_type("h225")),
            "machine": f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}",
            "clock": "processor time of one process; a load above 1 when it starts means company that slows it down",
            "load_at_start": round(os.getloadavg()[0], 1),
            "windows": measured(burst=False),
            "with_bursts": measured(burst=True),
        },
    )


if __name__ == "__main__":
    main()
