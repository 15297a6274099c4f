"""What the studies of outages and kills share: a database that can be stopped, servers that can be killed, a load, a look.

A load is one round of work of three kinds on pumps of its own: an archive, uploads that nobody waits for (202), uploads that
their client waits for (201). Clients come again after 503 and lost connections, as ``casedrain upload`` does. All rounds are
alike but for the pumps' names, so that one undisturbed round says what every verdict must be.
"""

import io
import json
import os
import pwd
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import zipfile
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import httpx2
import numpy as np

from benchmarks.mould import Copy, Mould
from service.storage.database import upgrade
from tests.postgres import binary
from tests.service.records import document

API = "/api/v1"
JSON = {"content-type": "application/json"}
PUMPS = 3
"""Pumps of a round: one is sent in an archive, one without waiting, one with waiting."""
ARCHIVE = 24
"""Records of an archive: more than one part of a job, where workers share it."""
_SETTLED_S = 0.25


class StoppablePostgres:
    """A cluster that is stopped and started while others use it."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="cd-out-"))
        self._prefix: list[str] = []
        if os.geteuid() == 0:
            user = pwd.getpwnam("nobody")
            os.chown(self.folder, user.pw_uid, -1)
            self._prefix = ["setpriv", f"--reuid={user.pw_uid}", f"--regid={user.pw_gid}", "--clear-groups"]
        self._run("initdb", "-U", "casedrain", "-A", "trust", "-E", "UTF8", "--locale=C")
        self.start()
        self._run("createdb", "-h", str(self.folder), "-U", "casedrain", "casedrain", data=False)
        self.url = f"postgresql+psycopg://casedrain@/casedrain?host={self.folder}"
        upgrade(self.url)

    def start(self) -> None:
        """Start, and wait until it answers."""
        options = f"-k {self.folder} -c listen_addresses= -c max_connections=100"
        self._run("pg_ctl", "-w", "-o", options, "-l", str(self.folder / "log"), "start")

    def stop(self, mode: str = "immediate") -> None:
        """Stop as a crash does."""
        self._run("pg_ctl", "-m", mode, "stop")

    def kill(self) -> None:
        """End the postmaster by SIGKILL; its children follow by themselves."""
        os.kill(int((self.folder / "data" / "postmaster.pid").read_text().split()[0]), signal.SIGKILL)
        for _ in range(100):  # what is left of it must be gone before the next start
            time.sleep(0.1)
            with suppress(subprocess.CalledProcessError):
                self.start()
                return
        raise RuntimeError("the database does not start again")

    def log_all(self) -> None:
        """Have every statement logged from now on."""
        for command in ("ALTER SYSTEM SET log_statement = 'all'", "SELECT pg_reload_conf()"):
            self._run("psql", "-h", str(self.folder), "-U", "casedrain", "-c", command, "casedrain", data=False)

    def close(self) -> None:
        """End it for good."""
        with suppress(subprocess.CalledProcessError):
            self.stop()
        shutil.rmtree(self.folder, ignore_errors=True)

    def _run(self, name: str, *arguments: str, data: bool = True) -> None:
        where = ["-D", str(self.folder / "data")] if data else []
        command = [*self._prefix, str(binary(name)), *where, *arguments]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        subprocess.run(command, check=True, cwd=self.folder, **quiet)  # type: ignore[call-overload]  # noqa: S603 - our own


class Server:
    """``casedrain serve`` in a process of its own, on a database and a raw store that others may share."""

    def __init__(
        self, folder: Path, database_url: str, name: str = "server", mould: Mould | None = None, **settings: str
    ) -> None:
        self.folder, self._mould = folder, mould
        with socket.socket() as found:
            found.bind(("127.0.0.1", 0))
            self.port = found.getsockname()[1]
        self.url = f"http://127.0.0.1:{self.port}"
        self._environment = {
            **os.environ,
            "CASEDRAIN_DATABASE_URL": database_url,
            "CASEDRAIN_DATA_DIR": str(folder / name),
            "CASEDRAIN_RAW_STORE_URL": str(folder / "raw"),
            "CASEDRAIN_AUDIT_KEY": settings.pop("audit_key", "ab" * 32),
            "CASEDRAIN_AUTH": "off",
            "CASEDRAIN_PARSE_WORKERS": "1",
            **{f"CASEDRAIN_{key.upper()}": value for key, value in settings.items()},
        }
        self.log = folder / f"{name}.log"
        self.process: subprocess.Popen[bytes] | Copy | None = None

    def start(self) -> None:
        """Start without waiting."""
        if self._mould is not None:
            self.process = self._mould.copy(["serve", "--port", str(self.port)], self._environment, self.log)
            return
        command = [sys.executable, "-c", "from service.command_line.main import app; app()", "serve"]
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(  # noqa: S603 - our own
                [*command, "--port", str(self.port)], env=self._environment, stdout=log, stderr=log
            )

    def await_ready(self, within_s: float = 120.0) -> None:
        """Wait until it can do its work."""
        end = time.monotonic() + within_s
        while time.monotonic() < end:
            if self.process is None or self.process.poll() is not None:
                raise RuntimeError(f"the server has ended: {self.log.read_text()[-3000:]}")
            with suppress(httpx2.TransportError):
                if httpx2.get(f"{self.url}/readyz", timeout=5.0).status_code == 200:
                    return
            time.sleep(0.1)
        raise RuntimeError("the server does not become ready")

    def kill(self) -> None:
        """End by SIGKILL."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()

    def kill_parser(self) -> int:
        """End a process that parses for it by SIGKILL; how many there were to end, 0 or 1."""
        if self.process is None:
            return 0
        for task in Path(f"/proc/{self.process.pid}/task").glob("*/children"):
            with suppress(OSError):  # a thread or a child that ends meanwhile
                for child in task.read_text().split():
                    if b"service.ingest.worker" in Path(f"/proc/{child}/cmdline").read_bytes():
                        os.kill(int(child), signal.SIGKILL)
                        return 1
        return 0

    def close(self) -> None:
        """Stop in good order."""
        if self.process is not None:
            self.process.terminate()
            try:
                self.process.wait(timeout=40.0)
            except subprocess.TimeoutExpired:
                self.process.kill()


@contextmanager
def installation(
    kind: str, n_servers: int = 1, mould: Mould | None = None, **settings: str
) -> Iterator[tuple[list[Server], StoppablePostgres | None]]:
    """Running servers on a database of a kind, ``sqlite`` or ``postgres``; copies of ``mould`` where there is one."""
    postgres = StoppablePostgres() if kind == "postgres" else None
    folder = Path(tempfile.mkdtemp(prefix="cd-run-"))
    url = postgres.url if postgres else f"sqlite:///{folder / 'casedrain.sqlite'}"
    key = secrets.token_hex(32)
    servers = [Server(folder, url, f"server-{i}", mould, audit_key=key, **settings) for i in range(n_servers)]
    try:
        for server in servers:
            server.start()
            server.await_ready()
        yield servers, postgres
    finally:
        for server in servers:
            server.close()
        if postgres:
            postgres.close()
        shutil.rmtree(folder, ignore_errors=True)


def flight(pump: str, number: int) -> bytes:
    """A record, the same for every pump but for its name."""
    rng = np.random.default_rng(number)
    found = document()
    noise = rng.normal(0.0, 0.002, len(found["channels"]["time_s"])) + 0.01 * number
    found["channels"]["case_pressure_bar"] = list(np.asarray(found["channels"]["case_pressure_bar"]) + noise)
    day = f"2026-05-{1 + number:02d}T07:11:00Z"
    names = {"pump_serial": pump, "aircraft": pump, "flight_id": f"F{number}", "started_at": day}
    return json.dumps({**found, **names}).encode()


class Round:
    """One round of work, and what became of it.

    Attributes
    ----------
    answers
        How often each status was answered, 0 for a connection that was lost.
    acknowledged
        Records that somebody was told are safe.
    """

    def __init__(self, name: str, n: int) -> None:
        self.pumps = [f"{name}-{i}" for i in range(PUMPS)]
        self.n = n
        self.answers: Counter[int] = Counter()
        self.acknowledged: set[str] = set()
        self.job: str | None = None
        self.wrong: list[str] = []
        self._lock = threading.Lock()

    def work(self, urls: list[str], pool: ThreadPoolExecutor) -> list[Any]:
        """Send everything, to the servers in turn; the futures."""
        out = io.BytesIO()
        with zipfile.ZipFile(out, "w") as file:
            for i in range(ARCHIVE):
                file.writestr(f"{i:03d}.json", flight(self.pumps[0], i))
        found = [pool.submit(self._bulk, urls, out.getvalue())]
        for i in range(self.n):
            found.append(pool.submit(self._upload, urls, flight(self.pumps[1], i), False))
            found.append(pool.submit(self._upload, urls, flight(self.pumps[2], i), True))
        return found

    def _bulk(self, urls: list[str], content: bytes) -> None:
        self.job = self._sent(urls, f"{API}/records/bulk", content, {"content-type": "application/zip"})["id"]

    def _upload(self, urls: list[str], content: bytes, wait: bool) -> None:
        answer = self._sent(urls, f"{API}/records?wait={str(wait).lower()}", content, JSON)
        with self._lock:
            self.acknowledged.add(answer["record_id"])

    def _sent(self, urls: list[str], path: str, content: bytes, headers: dict[str, str]) -> Any:
        for attempt in range(2000):
            status = 0
            with suppress(httpx2.TransportError):
                url = urls[(attempt + len(path)) % len(urls)]
                answer = httpx2.post(f"{url}{path}", content=content, headers=headers, timeout=90.0)
                status = answer.status_code
            with self._lock:
                self.answers[status] += 1
            if status in (200, 201, 202):
                return answer.json()
            if status not in (0, 503):
                with self._lock:
                    self.wrong.append(f"{status} {answer.text[:300]}")
                if status < 500:
                    raise RuntimeError(f"{path}: {status} {answer.text[:300]}")
            time.sleep(0.3)
        raise RuntimeError("nobody takes it")

    def settled(self, url: str, within_s: float) -> float | None:
        """Seconds until all that was acknowledged is done; None when it is not within so long."""
        began = time.monotonic()
        while time.monotonic() - began < within_s:
            with suppress(httpx2.TransportError, _NotYetError):
                self._look(url)
                return time.monotonic() - began
            time.sleep(_SETTLED_S)
        return None

    def _look(self, url: str) -> None:
        job = _asked(url, f"/jobs/{self.job}")
        if job["status"] in ("queued", "running"):
            raise _NotYetError
        for pump, n in zip(self.pumps, (ARCHIVE, self.n, self.n), strict=True):
            rows = _asked(url, f"/records?pump={pump}&limit=500")["items"]
            if len(rows) < n or any(row["status"] == "stored" for row in rows):
                raise _NotYetError

    def faults(self, url: str, expected: list[Any] | None) -> list[str]:
        """What is lost, doubled or other than it would have been."""
        job = _asked(url, f"/jobs/{self.job}")
        items = _asked(url, f"/jobs/{self.job}/items?limit=500")["items"]
        found = list(self.wrong)
        if job["status"] != "succeeded" or [i["position"] for i in items] != list(range(ARCHIVE)):
            found.append(f"job {job['status']} with {len(items)} items: {job['problem']}")
        found += [f"item {i['name']} is {i['status']}" for i in items if i["status"] not in ("analysed", "known")]
        rows = [row for pump in self.pumps for row in _asked(url, f"/records?pump={pump}&limit=500")["items"]]
        states = Counter(row["status"] for row in rows)
        if states != {"analysed": ARCHIVE + 2 * self.n}:
            found.append(f"records are {dict(states)}")
        lost = self.acknowledged - {row["record_id"] for row in rows}
        if lost:
            found.append(f"{len(lost)} acknowledged records are lost")
        if expected is not None and verdicts(url, self.pumps) != expected:
            found.append("verdicts are not those of an undisturbed round")
        return found


class _NotYetError(Exception):
    """Work is under way."""


def verdicts(url: str, pumps: list[str]) -> list[Any]:
    """Everything that was ever said of some pumps, by record, without names."""
    found = []
    for pump in pumps:
        now = _asked(url, f"/pumps/{pump}/verdict")
        trend = _asked(url, f"/pumps/{pump}/trend?metric=case_residual_bar&points=500")["items"]
        now.pop("software", None)
        # rounds are alike on purpose: how many of their records others have too says when they came
        now["quality"]["flags"] = [f for f in now["quality"]["flags"] if not f.startswith("another pump has a record")]
        found.append([now, [(i["at"], i["value"], i["low"], i["high"]) for i in trend]])
    return found


def undisturbed(url: str, n: int) -> list[Any]:
    """Verdicts of a round that nothing happens to."""
    with ThreadPoolExecutor(4) as pool:
        quiet = Round("Q", n)
        for future in quiet.work([url], pool):
            future.result()
    if quiet.settled(url, 300.0) is None or quiet.faults(url, None):
        raise RuntimeError(f"an undisturbed round fails: {quiet.faults(url, None)}")
    return verdicts(url, quiet.pumps)


def _asked(url: str, path: str) -> Any:
    answer = httpx2.get(f"{url}{API}{path}", timeout=60.0)
    if answer.status_code != 200:
        raise _NotYetError
    return answer.json()
