"""Cost of an upload by format: a flight of 8 h at 10 Hz and a burst of 2 s at 10 kHz, through a server of its own.

``python -m benchmarks.ingest`` writes ``benchmarks/results/ingest.json``: size of the file, seconds from the request to
the verdict, and the most memory that the server and the process that reads the file held meanwhile. Every row has a
server of its own; of its uploads the quickest and the greediest count. Three times in a row: what is kept shows.
"""

import gzip
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import httpx2
import numpy as np

from benchmarks import keep
from service.demo.flights import csv_bytes
from service.ingest.decode import DecodedRecord
from service.ingest.metadata import RecordMetadata
from tests.service.test_formats import WRITERS
from twin.recording import Recording
from twin.units import STANDARD_ATMOSPHERE_BAR

PORT, ROUNDS = 8765, 3
URL = f"http://127.0.0.1:{PORT}"
FORMATS = ("parquet", "hdf5", "mdf4", "tdms", "matlab")
_MIB = 1024.0


def flight() -> Recording:
    """Eight hours at 10 Hz: pump off, run-up, two quiet minutes, then flying."""
    return _recording(np.arange(288_000) / 10.0, quiet_until=210.0, off_until=60.0)


def burst() -> Recording:
    """Two seconds at 10 kHz inside the quiet window."""
    return _recording(np.arange(20_000) / 10_000.0, quiet_until=10.0, off_until=-30.0)


def _recording(time_s: np.ndarray[Any, Any], quiet_until: float, off_until: float) -> Recording:
    rng = np.random.default_rng(4)
    n = len(time_s)
    running = np.clip((time_s - off_until) / 20.0, 0.0, 1.0)
    flying = (time_s >= quiet_until) * np.abs(np.sin(time_s / 7.0))
    noise = rng.normal(size=(5, n))
    return Recording(
        {
            "time_s": time_s,
            "discharge_pressure_bar": 1.0 + (173.0 - 0.5 * flying) * running + 0.15 * noise[0],
            "case_pressure_bar": 0.5 + (0.4 + 0.3 * flying) * running + 0.003 * noise[1],
            "shaft_speed_rpm": 4600.0 * running + 2.0 * noise[2] * (running > 0.0),
            "fluid_temperature_degc": 50.0 + 0.05 * noise[3],
            "reservoir_pressure_bar": 0.5 + 0.003 * noise[4],
            "flight_control_activity": np.clip(flying, 0.0, 1.0),
        }
    )


def written(recording: Recording, segment: str) -> dict[str, tuple[str, bytes]]:
    """Content type and bytes of a record by format."""
    names = {"pump_serial": "P-1", "aircraft": "F-1", "position": "LH", "flight_id": "F1"}
    started_at = datetime(2026, 5, 2, 7, 11, tzinfo=UTC)
    metadata = RecordMetadata(**names, started_at=started_at, segment=segment, pump_type=None, operator=None,
                              flight_hours=100.0, pressure_reference="gauge",
                              ambient_pressure_bar=STANDARD_ATMOSPHERE_BAR, foreign={})  # fmt: skip
    texts = {**names, "started_at": started_at.isoformat(), "segment": segment}
    csv = csv_bytes(recording, texts)
    document = {**texts, "channels": {n: np.round(v, 6).tolist() for n, v in recording.channels.items()}}
    found = {
        "csv": ("text/csv", csv),
        "csv, gzipped": ("application/gzip", gzip.compress(csv)),
        "json": ("application/json", json.dumps(document).encode()),
    }
    for name in FORMATS:
        content_type, write = WRITERS[name]
        found[name] = (content_type, write(DecodedRecord(metadata, recording)))
    return found


@contextmanager
def served() -> Iterator[int]:
    """A server with a database of its own; its process id."""
    with tempfile.TemporaryDirectory() as folder:
        settings = {"CASEDRAIN_DATA_DIR": folder, "CASEDRAIN_AUTH": "off", "CASEDRAIN_PARSE_WORKERS": "1"}
        command = [
            sys.executable,
            "-c",
            "from service.command_line.main import app; app()",
            "serve",
            "--port",
            str(PORT),
        ]
        process = subprocess.Popen(command, env={**os.environ, **settings}, stdout=subprocess.DEVNULL)  # noqa: S603 - our own
        try:
            await_ready(process, URL)
            # wakes the process that reads files
            httpx2.post(f"{URL}/api/v1/records", content=b"{}", headers={"content-type": "application/json"})
            yield process.pid
        finally:
            process.terminate()
            process.wait()


def await_ready(process: "subprocess.Popen[bytes]", url: str) -> None:
    """Wait for a server of ours; raises where it ends or does not come up."""
    for _ in range(1200):
        if process.poll() is not None:
            raise RuntimeError(f"the server ended with code {process.returncode}; is the port of {url} taken?")
        try:
            if httpx2.get(f"{url}/readyz").status_code == 200:
                return
        except httpx2.TransportError:
            pass
        time.sleep(0.25)
    raise RuntimeError("the server does not become ready")


def _mib(pid: int, what: str) -> float:
    """``VmHWM``, the most since the last reset, or ``VmRSS``, now [MiB]."""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith(f"{what}:"):
            return float(line.split()[1]) / _MIB
    return 0.0


def _reader(server: int) -> int:
    """Process id of the one that reads files."""
    for child in Path(f"/proc/{server}/task/{server}/children").read_text().split():
        if b"service.ingest.worker" in Path(f"/proc/{child}/cmdline").read_bytes():
            return int(child)
    for path in Path(f"/proc/{server}/task").iterdir():
        for child in (path / "children").read_text().split():
            if b"service.ingest.worker" in Path(f"/proc/{child}/cmdline").read_bytes():
                return int(child)
    raise RuntimeError("no process reads files")


def uploaded(server: int, content_type: str, content: bytes, flight_id: str) -> dict[str, float]:
    """Seconds and peak memory of one upload."""
    pids = {"server": server, "reader": _reader(server)}
    before = {}
    for name, pid in pids.items():
        Path(f"/proc/{pid}/clear_refs").write_text("5")  # the peak counts from here
        before[name] = _mib(pid, "VmRSS")
    start = time.perf_counter()
    answer = httpx2.post(
        f"{URL}/api/v1/records",
        content=content,
        headers={"content-type": content_type},
        params={"flight_id": flight_id},
        timeout=300.0,
    )
    seconds = time.perf_counter() - start
    if answer.status_code != 201:
        raise RuntimeError(f"{answer.status_code}: {answer.text[:500]}")
    found = {"seconds": seconds}
    for name, pid in pids.items():
        peak = _mib(pid, "VmHWM")
        found |= {f"{name}_peak_mib": peak, f"{name}_rise_mib": peak - before[name]}
    return found


def main() -> None:
    """Measure both records in every format."""
    records = {"flight of 8 h at 10 Hz": (flight(), ""), "burst of 2 s at 10 kHz": (burst(), "burst-1")}
    rows = []
    for name, (recording, segment) in records.items():
        for kind, (content_type, content) in written(recording, segment).items():
            with served() as server:
                runs = [uploaded(server, content_type, content, f"F{i}") for i in range(ROUNDS)]
            row = {"record": name, "format": kind, "samples": len(recording) * len(recording.channels)}
            row["file_mib"] = round(len(content) / 2**20, 2)
            row["seconds"] = round(min(run.pop("seconds") for run in runs), 2)
            rows.append(row | {key: round(max(run[key] for run in runs), 1) for key in runs[0]})
    keep(
        "ingest",
        {
            "machine": f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores",
            "python": platform.python_version(),
            "rounds": ROUNDS,
            "rows": rows,
        },
    )


if __name__ == "__main__":
    main()
