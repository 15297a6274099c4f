"""Parsing in processes of its own: bytes from outside cost at most the time, memory and rows of the limits."""

import json
import os
import queue
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from opentelemetry import trace
from prometheus_client import Histogram

from service import errors
from service.access.account import current_account
from service.access.turns import Gate
from service.errors import Fault, Problem, TooLarge, Undecodable
from service.ingest.archive import INDEX, Archive, indexed_archive
from service.ingest.raw import Limits, RawFile, Samples, Table, TextDialect

_PACKAGE_ROOT = str(Path(__file__).resolve().parent.parent.parent)
_QUIET = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "2"}
_ARROW = {"ARROW_DEFAULT_MEMORY_POOL": "system", "ARROW_NUM_THREADS": "1"}
"""Threads and arenas reserve address space that they never use, which the memory limit would count."""
_START_TIMEOUT_S = 60.0
_FILE = ("decoding the file", "split the record into segments")
_ARCHIVE = ("looking through the upload", "split it into several")
_tracer = trace.get_tracer("casedrain")
_SECONDS = Histogram("casedrain_parse_seconds", "Time that the parser took for a file")


@dataclass(frozen=True, slots=True)
class ParserLimits:
    """What one file may cost the parser."""

    seconds: float = 60.0
    memory_bytes: int = 2 * 2**30


class ParserPool:
    """Worker processes, started when first needed, used again, replaced after a crash, killed when too slow.

    Parameters
    ----------
    folder
        Where workers leave decoded channels; they are removed as soon as they are read.
    limits
        Time and memory for one file.
    n_workers
        How many files are parsed at the same time; further requests wait, tenants in turn (``service.access.turns``).
    most_waiting, patience_s
        How many may wait while somebody waits for their answer, and how long [s].
    """

    def __init__(
        self,
        folder: Path,
        limits: ParserLimits | None = None,
        n_workers: int = 2,
        most_waiting: int = 64,
        patience_s: float = 60.0,
    ) -> None:
        self._folder = folder
        self._limits = limits or ParserLimits()
        self._gate = Gate(n_workers, most_waiting, patience_s, "the parser")
        self._places: queue.LifoQueue[_Worker | None] = queue.LifoQueue()
        for _ in range(n_workers):
            self._places.put(None)

    def parsed(
        self,
        path: Path,
        content_type: str,
        content_encoding: str,
        limits: Limits,
        dialect: TextDialect | None = None,
        with_texts: bool = True,
    ) -> RawFile:
        """Columns and metadata of a file, as ``service.ingest.parse.parsed`` gives them.

        Without ``with_texts`` columns of words come without their words: only a mapping reads them.

        Raises
        ------
        Undecodable, UnknownType, TooLarge
            the last also when time or memory run out, naming the limit.
        TooMany, Unavailable
            when too many wait, or for too long.
        """
        request = {
            "path": str(path),
            "content_type": content_type,
            "content_encoding": content_encoding,
            "limits": asdict(limits),
            "dialect": asdict(dialect) if dialect else None,
            "with_texts": with_texts,
        }
        with self._temporary() as folder:
            output = Path(folder) / "channels.f64"
            return _taken_over(self._answer(request, output, _FILE), output)

    def opened(self, path: Path, kind: str, most_bytes: int) -> Archive:
        """An upload of many records with its index, as ``service.ingest.archive.opened_archive``; raises as ``parsed``."""
        folder = self._temporary()
        try:
            self._answer({"path": str(path), "archive": kind}, Path(folder.name) / INDEX, _ARCHIVE)
            return indexed_archive(path, kind, folder, most_bytes)
        except BaseException:
            folder.cleanup()
            raise

    def _temporary(self) -> "tempfile.TemporaryDirectory[str]":
        self._folder.mkdir(parents=True, exist_ok=True)
        return tempfile.TemporaryDirectory(dir=self._folder, prefix="parsed-")

    def _answer(self, request: dict[str, Any], output: Path, words: tuple[str, str]) -> dict[str, Any]:
        account = current_account()
        with _tracer.start_as_current_span("parse"), self._gate.entered(account), self._worker(words) as worker:
            began = time.monotonic()
            try:
                limits = {"output": str(output), "memory_bytes": self._limits.memory_bytes}
                answer = worker.ask({**request, **limits}, self._limits.seconds)
            finally:
                seconds = time.monotonic() - began
                account.parser_seconds += seconds
                _SECONDS.observe(seconds)
        if answer.get("memory"):
            raise self._too_much_memory(words)
        if "problem" in answer:
            faults = [Fault(where, problem) for where, problem in answer["errors"]]
            kind: type[Problem] = getattr(errors, answer["problem"])
            raise kind(answer["detail"], faults)
        return answer

    @property
    def waiting(self) -> int:
        """How many files wait for a worker."""
        return self._gate.waiting

    def close(self) -> None:
        """End every idle worker."""
        while True:
            try:
                worker = self._places.get_nowait()
            except queue.Empty:
                return
            if worker is not None:
                worker.kill()

    @contextmanager
    def _worker(self, words: tuple[str, str]) -> Iterator["_Worker"]:
        worker = self._places.get()
        try:
            if worker is not None and not worker.is_alive:
                worker.kill()  # closes what it left open
                worker = None
            worker = worker or _Worker()
            try:
                yield worker
            except _TookTooLongError:
                seconds = self._limits.seconds
                fault = Fault("body", f"took longer than {seconds:g} s")
                raise TooLarge(f"{words[0]} takes longer than {seconds:g} s: {words[1]}", [fault]) from None
            except _DiedError as error:
                if error.by_memory:
                    raise self._too_much_memory(words) from None
                why = f"is damaged, or needs more than {self._limits.memory_bytes} bytes of memory"
                fault = Fault("body", why if error.by_itself else f"ended the process that read it ({error})")
                raise Undecodable("the file cannot be read: its reader crashed on it", [fault]) from None
        finally:
            self._places.put(worker)

    def _too_much_memory(self, words: tuple[str, str]) -> TooLarge:
        limit = self._limits.memory_bytes
        return TooLarge(
            f"{words[0]} needs more than {limit} bytes of memory: {words[1]}",
            [Fault("body", f"needs more than {limit} bytes of memory")],
        )


class _TookTooLongError(Exception):
    """The worker was killed at the time limit."""


class _DiedError(Exception):
    """The worker ended by itself."""

    def __init__(self, code: int | None) -> None:
        super().__init__(f"exit code {code}")
        # the kernel kills who takes all memory; a reader in C that finds none aborts, and so does one that finds its own damaged
        self.by_memory, self.by_itself = code == -9, code == -6


class _Worker:
    """One process and the pipe to it; used by one thread at a time."""

    def __init__(self) -> None:
        path = os.pathsep.join(p for p in (_PACKAGE_ROOT, os.environ.get("PYTHONPATH", "")) if p)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "service.ingest.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **_QUIET, **_ARROW, "PYTHONPATH": path},
            text=True,
            encoding="utf-8",
        )
        self._line(_START_TIMEOUT_S)

    @property
    def is_alive(self) -> bool:
        return self._process.poll() is None

    def ask(self, request: dict[str, Any], seconds: float) -> dict[str, Any]:
        stdin = self._process.stdin
        if stdin is None:
            raise RuntimeError("the worker was started without a pipe")
        try:
            stdin.write(json.dumps(request) + "\n")
            stdin.flush()
        except OSError:
            self.kill()
            raise _DiedError(self._process.returncode) from None
        answer: dict[str, Any] = json.loads(self._line(seconds))
        return answer

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                pipe.close()

    def _line(self, seconds: float) -> str:
        stdout = self._process.stdout
        if stdout is None:
            raise RuntimeError("the worker was started without a pipe")
        late = threading.Event()

        def give_up() -> None:
            late.set()
            self._process.kill()

        timer = threading.Timer(seconds, give_up)
        timer.start()
        try:
            line = stdout.readline()
        finally:
            timer.cancel()
        if line.endswith("\n"):
            return line
        code = self._process.wait()
        self.kill()
        raise _TookTooLongError if late.is_set() else _DiedError(code)


def _taken_over(answer: dict[str, Any], output: Path) -> RawFile:
    with output.open("rb") as numbers:

        def taken(columns: list[Any]) -> dict[str, Samples]:
            found = {name: np.fromfile(numbers, dtype=np.float64, count=length) for name, length in columns}
            if any(len(found[name]) != length for name, length in columns):
                raise Problem(
                    "the decoded channels were cut on their way to us; nothing was changed: send the file again"
                )
            return found

        tables = tuple(
            Table(
                channels=taken(table["channels"]),
                time=None if table["time"] is None else taken([table["time"]])[""],
                times=taken(table["times"]),
                texts=table["texts"],
                name=table["name"],
                start=None if table["start"] is None else datetime.fromisoformat(table["start"]),
                units=table["units"],
                attributes=table["attributes"],
            )
            for table in answer["tables"]
        )
    faults = [Fault(where, problem) for where, problem in answer["faults"]]
    return RawFile(answer["metadata"], tables, faults, answer["not_kept"], answer["flags"])
