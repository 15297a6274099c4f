"""Overload: one operator offers ten times what the server can take, and worse, while another one reads.

``python -m benchmarks.overload [seconds] [sqlite|postgres]`` adds to ``benchmarks/results/overload.json``. Capacity is what
four connections get through; normal is half of it. Beside ten times as many uploads the misbehaving operator sends files
that are slow to refuse, broken archives and reads without end. Reads of the other are open-loop, ten a second: latency
counts from the moment that a read was due. Everything that was answered 201 must be there, once, analysed.
"""

import asyncio
import json
import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import RESULTS, keep
from service.access.security import new_key
from service.settings import Settings
from service.storage.database import Database, upgrade
from tests.postgres import cluster, create_database
from tests.service.records import document

PORT = 8811
API = "/api/v1"
READS_PER_S, UPLOADS_OF_THE_OTHER_PER_S = 10.0, 0.5
_START = datetime(2026, 1, 1, tzinfo=UTC)
_N_PUMPS = 20
_SLOW = b"time_s,case_pressure_bar\n" + b"".join(b"%d,x\n" % i for i in range(200_000))
READS = (
    f"{API}/pumps",
    f"{API}/pumps/S-1/verdict",
    f"{API}/records",
    f"{API}/fleet/summary",
    f"{API}/pumps/S-1/trend?metric=pump_leakage_change_lpm",
)


class Flights:
    """Records that differ, one after another."""

    def __init__(self, prefix: str) -> None:
        self._prefix, self._n = prefix, 0
        self._document = document()

    def next(self) -> bytes:
        """A flight later than all before it."""
        self._n += 1
        named = {
            "pump_serial": f"{self._prefix}-{self._n % _N_PUMPS if self._prefix == 'N' else 1}",
            "aircraft": f"{self._prefix}-A{self._n % _N_PUMPS if self._prefix == 'N' else 1}",
            "flight_id": f"F{self._n}",
            "started_at": (_START + timedelta(hours=self._n)).isoformat(),
        }
        return json.dumps({**self._document, **named}).encode()


class Client:
    """HTTP over connections that are kept, as cheap as Python makes it."""

    def __init__(self, key: str, most: int) -> None:
        self._key, self._free = key, asyncio.Semaphore(most)
        self._idle: list[tuple[asyncio.StreamReader, asyncio.StreamWriter]] = []

    async def ask(self, method: str, path: str, body: bytes = b"", kind: str = "application/json") -> tuple[int, bytes]:
        """Status and body of an answer; 0 where the connection broke twice."""
        head = (
            f"{method} {path} HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {self._key}\r\n"
            f"Content-Type: {kind}\r\nContent-Length: {len(body)}\r\n\r\n"
        ).encode()
        async with self._free:
            for _ in range(2):
                try:
                    return await self._sent(head + body)
                except (OSError, asyncio.IncompleteReadError, ValueError, IndexError):
                    while self._idle:  # all of them may have been closed since
                        self._idle.pop()[1].close()
        return 0, b""

    async def _sent(self, content: bytes) -> tuple[int, bytes]:
        reader, writer = self._idle.pop() if self._idle else await asyncio.open_connection("127.0.0.1", PORT)
        try:
            writer.write(content)
            head = await reader.readuntil(b"\r\n\r\n")
            lines = head.decode().lower().split("\r\n")
            fields = dict(line.split(": ", 1) for line in lines[1:] if ": " in line)
            body = await reader.readexactly(int(fields.get("content-length", 0)))
        except BaseException:
            writer.close()
            raise
        if fields.get("connection") == "close":
            writer.close()
        else:
            self._idle.append((reader, writer))
        return int(lines[0].split(" ")[1]), body


async def _paced(per_s: float, seconds: float, act: Any) -> None:
    """Call ``act`` at an even pace, whatever becomes of the calls before."""
    tasks, began = [], time.monotonic()
    for i in range(int(per_s * seconds)):
        await asyncio.sleep(max(0.0, began + i / per_s - time.monotonic()))
        tasks.append(asyncio.create_task(act(i)))
    await asyncio.gather(*tasks)


class Reader:
    """The other operator: reads on time, and an upload now and then."""

    def __init__(self, key: str, flights: Flights) -> None:
        self._client, self._flights = Client(key, 200), flights
        self.waits_s: list[float] = []
        self.statuses: Counter[int] = Counter()
        self.uploads: Counter[int] = Counter()

    async def run(self, seconds: float) -> None:
        """Read for a while."""
        self.waits_s.clear()

        async def read(i: int) -> None:
            due = time.monotonic()
            status, _ = await self._client.ask("GET", READS[i % len(READS)])
            self.waits_s.append(time.monotonic() - due)
            self.statuses[status] += 1

        async def upload(_i: int) -> None:
            status, _ = await self._client.ask("POST", f"{API}/records", self._flights.next())
            self.uploads[status] += 1

        await asyncio.gather(_paced(READS_PER_S, seconds, read), _paced(UPLOADS_OF_THE_OTHER_PER_S, seconds, upload))

    def told(self) -> dict[str, Any]:
        """What its reads took [ms], and how they were answered."""
        taken = 1000.0 * np.array(self.waits_s)
        return {
            "reads": len(taken),
            **{f"p{q}_ms": round(float(np.percentile(taken, q)), 1) for q in (50, 95, 99)},
            "statuses": {str(s): n for s, n in sorted(self.statuses.items())},
            "uploads": {str(s): n for s, n in sorted(self.uploads.items())},
        }


async def _capacity(client: Client, flights: Flights, seconds: float) -> float:
    """Uploads a second that four connections get through."""
    ends, n = time.monotonic() + seconds, 0

    async def sends() -> None:
        nonlocal n
        while time.monotonic() < ends:
            status, _ = await client.ask("POST", f"{API}/records", flights.next())
            n += status == 201

    await asyncio.gather(*(sends() for _ in range(4)))
    return n / seconds


async def _misbehaving(key: str, flights: Flights, per_s: float, seconds: float) -> Counter[str]:
    """Ten times the capacity in uploads, a tenth of it in files that cost, and reads without end."""
    found: Counter[str] = Counter()
    client, slow, reads = Client(key, 400), Client(key, 60), Client(key, 20)
    ends = time.monotonic() + seconds

    async def upload(_i: int) -> None:
        status, _ = await client.ask("POST", f"{API}/records", flights.next())
        found[f"upload {status}"] += 1

    async def bad(i: int) -> None:
        path, content, kind = (
            (f"{API}/records", _SLOW, "text/csv")
            if i % 2
            else (f"{API}/records/bulk", b"PK\x03\x04x", "application/zip")
        )
        status, _ = await slow.ask("POST", path, content, kind)
        found[f"bad file {status}"] += 1

    async def reading() -> None:
        while time.monotonic() < ends:
            status, _ = await reads.ask("GET", f"{API}/fleet/ranking")
            found[f"read {status}"] += 1

    await asyncio.gather(
        _paced(per_s, seconds, upload), _paced(per_s / 10.0, seconds, bad), *(reading() for _ in range(20))
    )
    return found


@contextmanager
def server(url: str, folder: Path, port: int = PORT, **more: str) -> Iterator[subprocess.Popen[bytes]]:
    """A server on a database, in a process of its own; ``more`` are its further variables."""
    environment = {**os.environ, "CASEDRAIN_AUTH": "on", "CASEDRAIN_DATABASE_URL": url, **more}
    environment["CASEDRAIN_DATA_DIR"] = str(folder / "data")
    with (folder / "log").open("wb") as log:
        command = [sys.executable, "-m", "service.command_line", "serve", "--port", str(port)]
        process = subprocess.Popen(command, env=environment, stdout=log, stderr=log)  # noqa: S603
        try:
            yield process
        finally:
            process.terminate()
            process.wait(30)


async def _ready() -> None:
    client = Client("x", 1)
    while (await client.ask("GET", "/readyz"))[0] != 200:
        await asyncio.sleep(0.3)


async def _run(keys: tuple[str, str], seconds: float, url: str) -> dict[str, Any]:
    await _ready()
    noisy, quiet = keys
    ours, theirs = Flights("N"), Flights("S")
    reader = Reader(quiet, theirs)
    for _ in range(5):
        await reader._client.ask("POST", f"{API}/records", theirs.next())
    capacity = await _capacity(Client(noisy, 4), ours, min(10.0, seconds))

    normal_client = Client(noisy, 20)

    async def upload(_i: int) -> None:
        await normal_client.ask("POST", f"{API}/records", ours.next())

    await asyncio.gather(reader.run(seconds), _paced(0.5 * capacity, seconds, upload))
    normal = reader.told()
    before = ours._n
    reader.statuses.clear()
    reader.uploads.clear()
    _, found = await asyncio.gather(reader.run(seconds), _misbehaving(noisy, ours, 10.0 * capacity, seconds))
    over = reader.told()
    with Database(url).reading() as session:
        rows = session.connection().exec_driver_sql(
            "SELECT operator, flight_id, count(*) FROM records WHERE status = 'analysed' GROUP BY 1, 2"
        )
        analysed = list(rows)
    kept = sum(operator == "north" and int(flight[1:]) > before for operator, flight, _ in analysed)
    return {
        "capacity_uploads_per_s": round(capacity, 1),
        "normal": normal,
        "overload": over,
        "misbehaving": dict(sorted(found.items())),
        "accepted": found["upload 201"],
        "accepted_and_analysed": kept,
        "twice": sum(n > 1 for _, _, n in analysed),
        "p99_over_normal": round(over["p99_ms"] / normal["p99_ms"], 2),
    }


def main() -> None:
    """Run and add to the results."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    kind = sys.argv[2] if len(sys.argv) > 2 else "sqlite"
    with cluster() if kind == "postgres" else nullcontext("") as base, tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        url = create_database(base, "overload") if base else f"sqlite:///{folder / 'c.sqlite'}"
        upgrade(url)
        with Database(url).writing() as session:
            keys = tuple(new_key(session, f"{o} office", "analyst", o, None)[1] for o in ("north", "south"))
        with server(url, folder):
            result = asyncio.run(_run((keys[0], keys[1]), seconds, url))
    settings = Settings(_env_file=None)  # type: ignore[call-arg]
    result["seconds"], result["upload_workers"] = seconds, settings.upload_workers
    before = RESULTS / "overload.json"
    rows = json.loads(before.read_text())["runs"] if before.exists() else {}
    keep("overload", {"runs": {**rows, kind: result}})


if __name__ == "__main__":
    main()
