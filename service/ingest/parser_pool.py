"""Parsing in processes of its own: bytes from outside cost at most the time, memory and rows of the limits."""

import json
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import datetime
from pathlib import Path
from typing import cast

import numpy as np
import structlog
from opentelemetry import trace
from prometheus_client import Histogram

from service import errors
from service.access.account import current_account
from service.access.turns import Gate
from service.errors import Fault, Problem, TooLarge, Unavailable, Undecodable
from service.ingest.archive import INDEX, Archive, indexed_archive
from service.ingest.raw import Limits, RawFile, Samples, Table, TextDialect
from service.ingest.worker_words import (
    Answer,
    ArchiveAsked,
    Column,
    FileAsked,
    FileSaid,
    IndexSaid,
    LimitsSaid,
    Refused,
)

_PACKAGE_ROOT = str(Path(__file__).resolve().parent.parent.parent)
_QUIET = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "2"}
_ARROW = {"ARROW_DEFAULT_MEMORY_POOL": "system", "ARROW_NUM_THREADS": "1"}
"""Threads and arenas reserve address space that they never use, which the memory limit would count."""
_START_TIMEOUT_S = 60.0
_TICKS_PER_S = os.sysconf("SC_CLK_TCK")
_MOST_WAITING, _LEAST_S = 4.0, 0.05
"""How many times its limit a file may take by the clock (our choice), and the shortest pause between two looks [s]."""
_KILLS = 2
"""So often a file may see its process killed: once by whoever, as where memory is short; twice, then it takes too much itself."""
_FILE = ("decoding the file", "split the record into segments")
_ARCHIVE = ("looking through the upload", "split it into several")
log = structlog.get_logger("casedrain")
_tracer = trace.get_tracer("casedrain")
_SECONDS = Histogram("casedrain_parse_seconds", "Time that the parser took for a file")


@dataclass(frozen=True, slots=True)
class ParserLimits:
    """What one file may cost the parser: processor time [s], and memory [bytes]."""

    seconds: float = 60.0
    memory_bytes: int = 2 * 2**30


class ParserPool:
    """Worker processes, started when first needed, used again, replaced after a crash, killed when too slow.

    Parameters
    ----------
    folder
        Where workers leave decoded channels; they are removed as soon as they are read.
    limits
        Processor time and memory for one file.
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
            when too many wait, or for too long; the latter also when no process can be started.
        """
        request: FileAsked = {
            "path": str(path),
            "memory_bytes": self._limits.memory_bytes,
            "output": "",
            "content_type": content_type,
            "content_encoding": content_encoding,
            "limits": cast("LimitsSaid", asdict(limits)),
            "dialect": asdict(dialect) if dialect else None,
            "with_texts": with_texts,
        }
        with self._temporary() as folder:
            output = Path(folder) / "channels.f64"
            request["output"] = str(output)
            return _taken_over(cast("FileSaid", self._answer(request, _FILE)), output)

    def opened(self, path: Path, kind: str, most_bytes: int) -> Archive:
        """An upload of many records with its index, as ``service.ingest.archive.opened_archive``; raises as ``parsed``."""
        folder = self._temporary()
        try:
            request: ArchiveAsked = {
                "path": str(path),
                "memory_bytes": self._limits.memory_bytes,
                "output": str(Path(folder.name) / INDEX),
                "archive": kind,
            }
            self._answer(request, _ARCHIVE)
            return indexed_archive(path, kind, folder, most_bytes)
        except BaseException:
            folder.cleanup()
            raise

    def _temporary(self) -> "tempfile.TemporaryDirectory[str]":
        self._folder.mkdir(parents=True, exist_ok=True)
        return tempfile.TemporaryDirectory(dir=self._folder, prefix="parsed-")

    def _answer(self, request: FileAsked | ArchiveAsked, words: tuple[str, str]) -> FileSaid | IndexSaid:
        account = current_account()
        with _tracer.start_as_current_span("parse"), self._gate.entered(account):
            began = time.monotonic()
            try:
                answer = self._asked(request, words)
            finally:
                seconds = time.monotonic() - began
                account.parser_seconds += seconds
                _SECONDS.observe(seconds)
        if "problem" not in answer:
            return answer
        refused = cast("Refused", answer)
        if refused.get("memory"):
            raise self._too_much_memory(words)
        faults = [Fault(where, problem) for where, problem in refused["errors"]]
        kind: type[Problem] = getattr(errors, refused["problem"])
        raise kind(refused["detail"], faults)

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

    def _asked(self, request: FileAsked | ArchiveAsked, words: tuple[str, str]) -> Answer:
        worker = self._places.get()
        try:
            for _ in range(_KILLS):
                if worker is None or not worker.is_alive:
                    worker = _in_place_of(worker)
                try:
                    return worker.ask(request, self._limits.seconds)
                except _TookTooLongError:
                    seconds = self._limits.seconds
                    fault = Fault("body", f"took longer than {seconds:g} s")
                    raise TooLarge(f"{words[0]} takes longer than {seconds:g} s: {words[1]}", [fault]) from None
                except _DiedError as error:
                    if error.code == -signal.SIGKILL:
                        log.warning("a process that read a file was killed", file=request["path"])
                        continue
                    why = f"ended the process that read it ({error})"
                    if error.code == -signal.SIGABRT:  # a reader in C finds no memory, or its own damaged
                        why = f"is damaged, or needs more than {self._limits.memory_bytes} bytes of memory"
                    fault = Fault("body", why)
                    raise Undecodable("the file cannot be read: its reader crashed on it", [fault]) from None
            raise self._too_much_memory(words)
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
        self.code = code


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
            start_new_session=True,  # what is typed at a terminal is meant for the server
        )
        self._line(_START_TIMEOUT_S)

    @property
    def is_alive(self) -> bool:
        return self._process.poll() is None

    def ask(self, request: FileAsked | ArchiveAsked, seconds: float) -> Answer:
        stdin = self._process.stdin
        if stdin is None:
            raise RuntimeError("the worker was started without a pipe")
        try:
            stdin.write(json.dumps(request) + "\n")
            stdin.flush()
        except OSError:
            self.kill()
            raise _DiedError(self._process.returncode) from None
        answer: Answer = json.loads(self._line(seconds))
        return answer

    def kill(self) -> None:
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with suppress(OSError):  # what was not taken any more is written once more on closing
                    pipe.close()

    def _used_s(self) -> float:
        """Processor time that it has used [s]."""
        with suppress(OSError, ValueError):  # it has ended
            fields = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
            return (int(fields[11]) + int(fields[12])) / _TICKS_PER_S
        return 0.0

    def _line(self, seconds: float) -> str:
        stdout = self._process.stdout
        if stdout is None:
            raise RuntimeError("the worker was started without a pipe")
        late, answered = threading.Event(), threading.Event()
        before, ends_at = self._used_s(), time.monotonic() + _MOST_WAITING * seconds

        def watch() -> None:
            left = seconds
            while not answered.wait(left):
                # what waits for a processor beside others is not slow
                left = seconds - (self._used_s() - before)
                if left <= 0.0 or time.monotonic() >= ends_at:
                    late.set()
                    self._process.kill()
                    return
                left = max(_LEAST_S, min(left, ends_at - time.monotonic()))

        threading.Thread(target=watch, daemon=True, name="parser-limit").start()
        try:
            line = stdout.readline()
        finally:
            answered.set()
        if line.endswith("\n"):
            return line
        code = self._process.wait()
        self.kill()
        raise _TookTooLongError if late.is_set() else _DiedError(code)


def _in_place_of(dead: _Worker | None) -> _Worker:
    if dead is not None:
        dead.kill()  # closes what it left open
    try:
        return _Worker()
    except (_DiedError, _TookTooLongError, OSError) as error:
        log.error("no process to read files", error=f"{type(error).__name__}: {error}")
        raise Unavailable("no process to read files can be started: nothing was changed, send it again") from None


def _taken_over(answer: FileSaid, output: Path) -> RawFile:
    with output.open("rb") as numbers:

        def taken(columns: Sequence[Column]) -> dict[str, Samples]:
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
