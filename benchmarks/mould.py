"""Servers copied from a process that has imported everything: a start costs a fifth, so that kills may come by the hundred.

``python -m benchmarks.mould`` is that process: one request a line, one answer a line. A copy is made by fork before it has opened
anything; it is a process of its own with the environment, log and arguments that it is given, and dies alone.
"""

import gc
import json
import os
import select
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

_WANTED = (
    "dbos._sys_db_postgres",
    "dbos._sys_db_sqlite",
    "fsspec.implementations.local",
    "psycopg",
    "service.command_line.main",
    "service.command_line.server",
    "service.running",
    "service.web.app",
    "sqlalchemy.dialects.postgresql.psycopg",
    "sqlalchemy.dialects.sqlite.pysqlite",
)


class Copy:
    """A copy in its own process, used as ``subprocess.Popen`` is."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        try:
            self._fd: int | None = os.pidfd_open(pid)
        except ProcessLookupError:
            self._fd = None

    def poll(self) -> int | None:
        """None as long as it lives, else 0: the mould takes its exit code."""
        return None if self._is_alive(0.0) else 0

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end; raises ``subprocess.TimeoutExpired`` where it does not come [s]."""
        if self._is_alive(timeout):
            raise subprocess.TimeoutExpired("copy", timeout or 0.0)
        return 0

    def kill(self) -> None:
        """End by SIGKILL."""
        self._signal(signal.SIGKILL)

    def terminate(self) -> None:
        """Ask it to stop."""
        self._signal(signal.SIGTERM)

    def _signal(self, number: int) -> None:
        if self._fd is not None and self._is_alive(0.0):
            signal.pidfd_send_signal(self._fd, number)

    def _is_alive(self, within_s: float | None) -> bool:
        if self._fd is None:
            return False
        if not select.select([self._fd], [], [], within_s)[0]:
            return True
        os.close(self._fd)
        self._fd = None
        return False


class Mould:
    """The process that servers are copied from."""

    def __init__(self) -> None:
        command = [sys.executable, "-m", "benchmarks.mould"]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)  # noqa: S603
        self._answer()

    def copy(self, arguments: list[str], environment: dict[str, str], log: Path) -> Copy:
        """A copy that runs ``casedrain`` with these arguments; what it says is added to ``log``."""
        if self._process.stdin is None:
            raise RuntimeError("no way to ask")
        request = {"arguments": arguments, "environment": environment, "log": str(log)}
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        return Copy(int(self._answer()))

    def close(self) -> None:
        """End it; copies live on."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()

    def _answer(self) -> str:
        line = self._process.stdout.readline() if self._process.stdout else ""
        if not line:
            raise RuntimeError("the process that servers are copied from has ended")
        return line.strip()


@contextmanager
def mould() -> Iterator[Mould]:
    """A mould for a while."""
    made = Mould()
    try:
        yield made
    finally:
        made.close()


def _warm() -> None:
    """Import what a server imports, and load the compiled kernels."""
    for name in _WANTED:
        import_module(name)
    offline, parse = import_module("service.studies.offline"), import_module("service.ingest.raw")
    records = import_module("tests.service.records")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "record.json"
        file.write_bytes(records.body())
        offline.analyse_files([file], parse.Limits(2**30, 10**7))


def _become(request: dict[str, Any]) -> None:
    """Run the command in this process, which is a copy; does not return."""
    os.setsid()
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    log = os.open(request["log"], os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    null = os.open(os.devnull, os.O_RDONLY)
    for given, place in ((null, 0), (log, 1), (log, 2)):
        os.dup2(given, place)
    os.environ.clear()
    os.environ.update(request["environment"])
    code = 1
    try:
        import_module("service.command_line.main").app(request["arguments"])
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    finally:
        sys.stderr.flush()
        os._exit(code)


def main() -> None:
    """Import, then make copies until nobody asks."""
    _warm()
    gc.freeze()
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # copies that have ended leave nothing behind
    print("ready", flush=True)
    for line in iter(sys.stdin.readline, ""):
        pid = os.fork()
        if pid == 0:
            _become(json.loads(line))
        print(pid, flush=True)


if __name__ == "__main__":
    main()
