"""A day's folder of mixed files by ``casedrain watch``, killed at random moments: each record stored once.

``python -m benchmarks.watch`` writes ``benchmarks/results/watch.json``: files, kills (SIGKILL, a new process each time), how
many records the service has afterwards, how often each, what lies in done/ and refused/, and the seconds that it took.
"""

import contextlib
import gzip
import json
import os
import platform
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import keep
from benchmarks.ingest import served
from service.client import Client
from service.ingest.decode import DecodedRecord, Limits, decode
from tests.service.records import document
from tests.service.test_formats import WRITERS

N_FILES, N_PUMPS = 500, 50
_LIMITS = Limits(50_000_000, 100_000)
_SUFFIXES = {"parquet": ".parquet", "hdf5": ".h5", "mdf4": ".mf4", "tdms": ".tdms", "matlab": ".mat"}


def _csv(found: dict[str, Any]) -> bytes:
    channels = found["channels"]
    lines = [f"# {name}: {value}" for name, value in found.items() if name != "channels"]
    lines.append(",".join(channels))
    lines += [",".join(f"{value:.6g}" for value in row) for row in zip(*channels.values(), strict=True)]
    return ("\n".join(lines) + "\n").encode()


def mixed_files(folder: Path, n_files: int, n_pumps: int) -> dict[str, bool]:
    """Write records of all formats in turn, every tenth of them one to be refused; whether each is good, by name."""
    writers: dict[str, Callable[[dict[str, Any]], bytes]] = {
        ".csv": _csv,
        ".csv.gz": lambda found: gzip.compress(_csv(found), mtime=0),
        ".json": lambda found: json.dumps(found).encode(),
    }
    for kind, suffix in _SUFFIXES.items():
        writers[suffix] = lambda found, write=WRITERS[kind][1]: write(_decoded(found))  # type: ignore[misc]
    is_good = {}
    rng = np.random.default_rng(5)
    for i in range(n_files):
        suffix = list(writers)[i % len(writers)]
        found = document()
        noise = rng.normal(0.0, 0.001, len(found["channels"]["time_s"]))
        found["channels"]["case_pressure_bar"] = list(np.asarray(found["channels"]["case_pressure_bar"]) + noise)
        day, pump = divmod(i, n_pumps)
        found |= {
            "pump_serial": f"P-{pump}",
            "aircraft": f"F-{pump}",
            "flight_id": f"D{day}",
            "flight_hours": 100.0 + day,
        }
        found["started_at"] = f"2026-05-{day + 1:02d}T07:11:00Z"
        name = f"day-{day + 1:02d}/pump-{pump}{suffix}"
        content = writers[suffix](found)
        is_good[name] = i % 10 != 9
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if is_good[name] else b"this is no record of pump %d" % pump)
    return is_good


def _decoded(found: dict[str, Any]) -> DecodedRecord:
    return decode(json.dumps(found).encode(), "application/json", "", {}, _LIMITS)


def watched(folder: Path, url: str, longest_s: float, most_kills: int, seed: int) -> int:
    """Run ``casedrain watch --once`` again and again; how often it was killed before it ended by itself.

    The moment of a kill is random: up to ``longest_s`` after the first file was told of, or, one time in four, while the
    process still begins.
    """
    rng = random.Random(seed)  # noqa: S311 - moments of a kill
    command = [
        sys.executable,
        "-m",
        "service.command_line",
        "watch",
        str(folder),
        "--url",
        url,
        "--once",
        "--interval",
        "0.1",
    ]
    for n_kills in range(most_kills + 1):
        process = subprocess.Popen(  # noqa: S603 - our own
            [*command, "--json"], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=os.environ
        )
        if n_kills < most_kills:
            if rng.random() < 0.75 and process.stdout is not None:
                process.stdout.readline()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.communicate(timeout=rng.uniform(0.0, longest_s))
                return n_kills
            process.send_signal(signal.SIGKILL)
        process.communicate()
    return most_kills


def outcome(folder: Path, url: str) -> dict[str, Any]:
    """What the service holds, and what lies in the folder."""
    with Client(url) as client:
        records = list(client.records())
    n_of = Counter((r["pump_serial"], r["flight_id"]) for r in records if r["status"] == "analysed")
    files = [p for p in folder.rglob("*") if p.is_file() and ".casedrain" not in p.parts]
    names = [str(p.relative_to(folder)) for p in files]
    refused = [n for n in names if n.startswith("refused/")]
    return {
        "records": sum(n_of.values()),
        "more_than_once": sum(n > 1 for n in n_of.values()),
        "records_not_analysed": sum(r["status"] != "analysed" for r in records),
        "done": sum(n.startswith("done/") for n in names),
        "refused": sum(not n.endswith(".problem.json") for n in refused),
        "problems": sum(n.endswith(".problem.json") for n in refused),
        "left": sum(not n.startswith(("done/", "refused/")) for n in names),
    }


def main() -> None:
    """Send a day's folder and keep what happened."""
    with tempfile.TemporaryDirectory() as name, served():
        folder = Path(name)
        is_good = mixed_files(folder, N_FILES, N_PUMPS)
        url = "http://127.0.0.1:8765"
        start = time.monotonic()
        n_kills = watched(folder, url, 3.0, most_kills=200, seed=1)
        seconds = time.monotonic() - start
        found = outcome(folder, url)
    keep(
        "watch",
        {
            "machine": f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores",
            "files": len(is_good),
            "good": sum(is_good.values()),
            "kills": n_kills,
            "seconds": round(seconds, 1),
            **found,
        },
    )


if __name__ == "__main__":
    main()
