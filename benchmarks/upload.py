"""What an upload costs: beside a bare durable endpoint of the same bytes, and late in a history of 2,000 records.

``python -m benchmarks.upload`` writes ``benchmarks/results/upload.json``. Both servers run at the same time on the same
disk and are asked in turns. The bare one does what nobody can do without: it takes the body, keeps it in a file that is
synced, and commits a row. The long history is folded beforehand; then records come over HTTP at its end, some places
before it, and anywhere. A verdict that is asked for right after a record, and one asked for while it is taken, is timed too.
"""

import asyncio
import hashlib
import os
import platform
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from statistics import median
from typing import Any

import httpx2
import numpy as np
import uvicorn
from sqlalchemy import select
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse
from starlette.routing import Route

from benchmarks import keep
from benchmarks.ingest import flight
from benchmarks.refold import add, history_of, with_one_pump
from detectors.judgement.version import twin_version
from detectors.words.observation import Observation
from service.demo.flights import csv_bytes
from service.monitoring.refold import refold
from service.storage.tables import Pump
from twin.pumps import pump_type
from twin.recording import Recording

ONE_BY_ONE, AT_ONCE, EACH = 60, 8, 12
RECORDS, REPEATS, LATE_BY = 2000, 15, 20
SECONDS_OF_A_RECORD = 300
SEND = {"content-type": "text/csv"}
_YEARS_BACK = timedelta(days=7 * 365)
"""So that a history of six years has not only begun."""
_FIRST = datetime(2026, 1, 1, 6, 0, tzinfo=UTC)


def content(names: dict[str, str], at: datetime, number: int) -> bytes:
    """A record of five minutes at 1 Hz; no two have the same samples."""
    whole = flight()
    picked = {name: samples[: 10 * SECONDS_OF_A_RECORD : 10] for name, samples in whole.channels.items()}
    noise = np.random.default_rng(number).normal(0.0, 0.003, SECONDS_OF_A_RECORD)
    picked["case_pressure_bar"] = picked["case_pressure_bar"] + noise
    return csv_bytes(Recording(picked), {**names, "started_at": at.isoformat(), "flight_id": f"N{number}"})


def bare_application(folder: Path) -> Starlette:
    """Takes a body, keeps it in a synced file, commits a row."""
    held = threading.local()

    def kept(body: bytes) -> str:
        digest = hashlib.sha256(body).hexdigest()
        path = folder / digest
        with path.open("wb") as file:
            file.write(body)
            file.flush()
            os.fsync(file.fileno())
        if not hasattr(held, "connection"):
            held.connection = sqlite3.connect(folder / "bare.sqlite", timeout=30, isolation_level=None)
            held.connection.execute("PRAGMA journal_mode=WAL")
            held.connection.execute("PRAGMA synchronous=FULL")
            held.connection.execute("CREATE TABLE IF NOT EXISTS records (id TEXT PRIMARY KEY, received_at TEXT)")
        values = (digest, datetime.now(UTC).isoformat())
        held.connection.execute("INSERT OR REPLACE INTO records VALUES (?, ?)", values)
        return digest

    async def taken(request: Request) -> JSONResponse:
        body = await request.body()
        return JSONResponse({"record_id": await asyncio.to_thread(kept, body)}, 201)

    async def ready(_request: Request) -> JSONResponse:
        return JSONResponse({})

    return Starlette(routes=[Route("/records", taken, methods=["POST"]), Route("/readyz", ready)])


@contextmanager
def _running(command: Sequence[str], url: str, **settings: str) -> Iterator[str]:
    """A server in a process of its own, ready."""
    process = subprocess.Popen(command, env={**os.environ, **settings}, stdout=subprocess.DEVNULL)  # noqa: S603 - our own
    try:
        for _ in range(1200):
            if process.poll() is not None:
                raise RuntimeError(f"the server ended with code {process.returncode}")
            try:
                if httpx2.get(f"{url}/readyz").status_code == 200:
                    break
            except httpx2.TransportError:
                pass
            time.sleep(0.1)
        yield url
    finally:
        process.terminate()
        process.wait()


@contextmanager
def bare(folder: Path, port: int) -> Iterator[str]:
    """The bare endpoint; its address."""
    folder.mkdir()
    command = [sys.executable, "-m", "benchmarks.upload", "--bare", str(folder), str(port)]
    with _running(command, f"http://127.0.0.1:{port}") as url:
        yield f"{url}/records"


@contextmanager
def service(folder: Path, port: int) -> Iterator[str]:
    """The service on a data folder; the address of its records."""
    run = "from service.command_line.main import app; app()"
    settings = {"CASEDRAIN_DATA_DIR": str(folder), "CASEDRAIN_AUTH": "off"}
    with _running(
        [sys.executable, "-c", run, "serve", "--port", str(port)], f"http://127.0.0.1:{port}", **settings
    ) as url:
        # wakes the processes that read files
        for _ in range(4):
            httpx2.post(f"{url}/api/v1/records", content=b"{}", headers={"content-type": "application/json"})
        yield f"{url}/api/v1/records"


def _sent(client: httpx2.Client, url: str, body: bytes) -> float:
    """Milliseconds of one upload."""
    start = time.perf_counter()
    answer = client.post(url, content=body, headers=SEND, timeout=120.0)
    if answer.status_code != 201:
        raise RuntimeError(f"{answer.status_code}: {answer.text[:500]}")
    return 1e3 * (time.perf_counter() - start)


def beside_bare(urls: dict[str, str]) -> list[dict[str, Any]]:
    """One client at a time, then eight at once that each have a pump, then eight at once with one pump."""
    rows = []
    number = 0

    def bodies(n: int, pump: str) -> list[bytes]:
        nonlocal number
        made = []
        for i in range(n):
            number += 1
            names = {"pump_serial": pump, "aircraft": f"A-{pump}", "position": "LH"}
            made.append(content(names, _FIRST + timedelta(hours=6 * (number if pump == "one" else i)), number))
        return made

    with httpx2.Client() as client:
        for body in bodies(4, "warm"):
            for url in urls.values():
                _sent(client, url, body)
        single = bodies(ONE_BY_ONE, "single")
        found: dict[str, list[float]] = {name: [] for name in urls}
        for body in single:
            for name, url in urls.items():
                found[name].append(_sent(client, url, body))
        rows.append(_row("one at a time", {name: median(ms) for name, ms in found.items()}))
    for words, pumps in (
        ("eight at once, a pump each", [f"own-{i}" for i in range(AT_ONCE)]),
        ("eight at once, one pump", ["one"] * AT_ONCE),
    ):
        work = [bodies(EACH, pump) for pump in pumps]
        rows.append(_row(words, {name: _at_once(url, work) for name, url in urls.items()}))
    return rows


def _at_once(url: str, work: Sequence[Sequence[bytes]]) -> float:
    """Milliseconds an upload when each share of the work is sent by a client of its own at the same time."""

    def send(share: Sequence[bytes]) -> None:
        with httpx2.Client() as client:
            for body in share:
                _sent(client, url, body)

    start = time.perf_counter()
    with ThreadPoolExecutor(len(work)) as threads:
        for done in [threads.submit(send, share) for share in work]:
            done.result()
    return 1e3 * (time.perf_counter() - start) / sum(map(len, work))


def _row(words: str, ms: dict[str, float]) -> dict[str, Any]:
    rounded = {f"{name}_ms": round(value, 2) for name, value in ms.items()}
    return {"uploads": words, **rounded, "times": round(ms["service"] / ms["bare"], 2)}


def prepared(folder: Path) -> list[Observation]:
    """A data folder with one pump and a long history, folded."""
    observations = [replace(o, at=o.at - _YEARS_BACK) for o in history_of(RECORDS)]
    context, key = with_one_pump(folder)
    add(context, observations, key)
    with context.database.writing() as session:
        refold(session, session.scalars(select(Pump)).one(), context.archive)
    context.close()
    return observations


def in_a_long_history(folder: Path, port: int) -> dict[str, Any]:
    """Records at the end, late by up to ``LATE_BY`` and at random places of a long history, over HTTP."""
    held = prepared(folder)
    rng = np.random.default_rng(5)
    names = {"pump_serial": "P-1", "aircraft": held[0].aircraft, "position": held[0].position}
    ends = [held[-1].at + timedelta(hours=3 * (i + 1)) for i in range(REPEATS)]
    late = [_between(held, RECORDS - 1 - int(back)) for back in rng.integers(1, LATE_BY + 1, REPEATS)]
    anywhere = [_between(held, int(place)) for place in rng.integers(0, RECORDS - 1, REPEATS)]
    found: dict[str, Any] = {"records": RECORDS}
    with service(folder, port) as url, httpx2.Client() as client:
        verdict = url.replace("/records", "/pumps/P-1/verdict")
        _sent(client, url, content(names, ends[-1] + timedelta(hours=3), 10_000))
        waits: list[float] = []
        with _asked_all_the_time(verdict, waits):
            for start, (words, instants) in enumerate(
                (("in_order", ends), (f"late_by_up_to_{LATE_BY}", late), ("at_a_random_place", anywhere)), 1
            ):
                ms, after = [], []
                for i, at in enumerate(instants):
                    ms.append(_sent(client, url, content(names, at, 1000 * start + i)))
                    after.append(_timed(lambda: client.get(verdict, timeout=60.0)))
                found |= {f"{words}_ms": round(median(ms), 1), f"{words}_slowest_ms": round(max(ms), 1)}
                found[f"verdict_after_{words}_slowest_ms"] = round(max(after), 1)
    found["verdict_meanwhile_slowest_ms"] = round(max(waits), 1)
    for words in (f"late_by_up_to_{LATE_BY}", "at_a_random_place"):
        found[f"{words}_times"] = round(found[f"{words}_ms"] / found["in_order_ms"], 2)
    return found


def _between(held: Sequence[Observation], place: int) -> datetime:
    """An instant between two neighbours of a history."""
    return held[place].at + 0.618 * (held[place + 1].at - held[place].at)


@contextmanager
def _asked_all_the_time(url: str, waits: list[float]) -> Iterator[None]:
    """The same question four times a second while the block runs."""
    stopped = threading.Event()

    def ask() -> None:
        with httpx2.Client() as client:
            while not stopped.wait(0.25):
                waits.append(_timed(lambda: client.get(url, timeout=60.0)))

    thread = threading.Thread(target=ask)
    thread.start()
    try:
        yield
    finally:
        stopped.set()
        thread.join()


def _timed(call: Callable[[], httpx2.Response]) -> float:
    start = time.perf_counter()
    call().raise_for_status()
    return 1e3 * (time.perf_counter() - start)


def main() -> None:
    """Measure both."""
    with tempfile.TemporaryDirectory() as text, ExitStack() as running:
        folder = Path(text)
        urls = {
            "bare": running.enter_context(bare(folder / "bare", 8767)),
            "service": running.enter_context(service(folder / "data", 8766)),
        }
        load = round(os.getloadavg()[0], 1)
        size = len(content({"pump_serial": "P-1"}, _FIRST, 1))
        rows = beside_bare(urls)
    with tempfile.TemporaryDirectory() as text:
        long = in_a_long_history(Path(text), 8768)
    keep(
        "upload",
        {
            "twin": twin_version(pump_type("h225")),
            "machine": f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}",
            "clock": "wall clock; a load above 1 when it starts means company that slows it down",
            "load_at_start": load,
            "bytes": size,
            "beside_a_bare_durable_endpoint": rows,
            "in_a_long_history": long,
        },
    )


if __name__ == "__main__":
    if sys.argv[1:2] == ["--bare"]:
        uvicorn.run(bare_application(Path(sys.argv[2])), port=int(sys.argv[3]), log_level="error")
    else:
        main()
