"""Reading a faultless CSV beside pyarrow alone on the same bytes, in turns, in one process set up like the parser's.

``python -m benchmarks.csv_reading`` writes ``benchmarks/results/csv_reading.json``: milliseconds of each and their ratio
at 1,200 and 100,000 rows of seven columns; and seconds and peak memory of the parser for 5,000,000 rows of two columns,
faultless and with a bad cell at its end.
"""

import os
import platform
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import csv as arrow_csv

from benchmarks import keep
from service.ingest import csv_format
from service.ingest.parser_pool import ParserLimits, ParserPool
from service.ingest.raw import Limits

SIZES = {1_200: 400, 100_000: 30}
"""Rows, and how many turns are taken."""
NAMES = ("time_s", "discharge_pressure_bar", "case_pressure_bar", "shaft_speed_rpm", "fluid_temperature_degc",
         "reservoir_pressure_bar", "flight_control_activity")  # fmt: skip
LIMITS = Limits(512 << 20, 5_000_000)
THREADS = {"OMP_NUM_THREADS": "1", "ARROW_DEFAULT_MEMORY_POOL": "system"}


def document(n: int) -> bytes:
    """A record of ``n`` rows with two lines of metadata."""
    rng = np.random.default_rng(1)
    columns = [np.arange(n) / 10.0, *(rng.normal(5.0, 2.0, n) for _ in NAMES[1:])]
    rows = "\n".join(",".join(f"{column[i]:.6g}" for column in columns) for i in range(n))
    return f"# pump_serial: P-1\n# aircraft: F-1\n{','.join(NAMES)}\n{rows}\n".encode()


def side_by_side(n: int, turns: int) -> dict[str, Any]:
    """Both readers in turns on the same bytes [ms]."""
    content = document(n)
    options = arrow_csv.ReadOptions(skip_rows=2)
    alone: list[float] = []
    ours: list[float] = []
    for _ in range(turns):
        start = time.perf_counter()
        arrow_csv.read_csv(pa.BufferReader(content), read_options=options)
        middle = time.perf_counter()
        csv_format.parsed(content, LIMITS)
        alone.append(1e3 * (middle - start))
        ours.append(1e3 * (time.perf_counter() - middle))
    found = {"rows": n, "columns": len(NAMES), "turns": turns}
    found |= {"pyarrow_ms": round(median(alone), 3), "ours_ms": round(median(ours), 3)}
    return found | {"ratio": round(median(ours) / median(alone), 2), "ratio_of_best": round(min(ours) / min(alone), 2)}


def large(last: str) -> dict[str, Any]:
    """Five million rows through the parser's process: seconds, faults, and the most memory that it held [MiB]."""
    n = LIMITS.rows
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "large.csv"
        with path.open("w") as file:
            file.write("time_s,case_pressure_bar\n")
            file.writelines(f"{i * 1e-4:.4f},{5 + i % 1000 / 1000:.6f}\n" for i in range(n - 1))
            file.write(last)
        pool = ParserPool(Path(folder), ParserLimits(seconds=60.0), n_workers=1)
        start = time.perf_counter()
        read = pool.parsed(path, "text/csv", "", LIMITS)
        seconds = time.perf_counter() - start
        children = Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children").read_text().split()
        peak = max(
            int(line.split()[1]) / 1024.0
            for child in children
            for line in Path(f"/proc/{child}/status").read_text().splitlines()
            if line.startswith("VmHWM")
        )
        pool.close()
    faults = [f"{fault.where}: {fault.problem}" for fault in read.faults]
    return {"rows": n, "columns": 2, "seconds": round(seconds, 1), "peak_mib": round(peak), "faults": faults}


def main() -> None:
    """Measure and keep."""
    if os.environ.get("OMP_NUM_THREADS") != "1":  # what a library has read at its import, only a new process changes
        command = [sys.executable, "-m", "benchmarks.csv_reading"]
        raise SystemExit(subprocess.run(command, env={**os.environ, **THREADS}, check=False).returncode)  # noqa: S603 - our own
    found = {
        "machine": f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores",
        "python": platform.python_version(),
        "side_by_side": [side_by_side(n, turns) for n, turns in SIZES.items()],
        "parser": [large("500,5.5\n"), large("500,bad\n")],
    }
    keep("csv_reading", found)


if __name__ == "__main__":
    main()
