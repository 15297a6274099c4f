"""Parsing in processes of its own: limits name themselves, a crash costs one file, the pool goes on."""

import asyncio
import json
import math
import os
import signal
import threading
import tracemalloc
from collections.abc import AsyncIterator, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from service.errors import TooLarge, Unavailable, Undecodable
from service.ingest import parser_pool
from service.ingest.parser_pool import ParserLimits, ParserPool
from service.ingest.raw import Limits, RawFile
from service.storage.spool import Spool
from tests.service.records import body, document

LIMITS = Limits(1_000_000_000, 10_000_000)


@pytest.fixture
def pool(tmp_path: Path) -> Iterator[ParserPool]:
    made = ParserPool(tmp_path / "spool", n_workers=1)
    yield made
    made.close()


@pytest.fixture
def record(tmp_path: Path) -> Path:
    path = tmp_path / "record.json"
    path.write_bytes(body())
    return path


def test_channels_arrive_exactly(pool: ParserPool, record: Path, tmp_path: Path) -> None:
    raw = pool.parsed(record, "application/json", "", LIMITS)
    for name, samples in document()["channels"].items():
        assert np.array_equal(raw.tables[0].channels[name], samples)
    assert raw.metadata["pump_serial"] == "P-1"
    assert list((tmp_path / "spool").iterdir()) == []


def test_time_is_limited_and_the_pool_goes_on(record: Path, tmp_path: Path) -> None:
    pool = ParserPool(tmp_path / "spool", ParserLimits(seconds=0.3), n_workers=1)
    pool.parsed(record, "application/json", "", LIMITS)
    slow = tmp_path / "slow.csv"
    with slow.open("w") as file:
        file.write("time_s,case_pressure_bar\n")
        file.writelines(f"{i},0.9\n" for i in range(2_000_000))
    with pytest.raises(TooLarge, match="takes longer than"):
        pool.parsed(slow, "text/csv", "", LIMITS)
    assert pool.parsed(record, "application/json", "", LIMITS).tables[0].channels
    pool.close()


def test_a_file_that_waits_for_a_processor_is_not_slow(record: Path, tmp_path: Path) -> None:
    """Beside much other work a good file takes long by the clock: it is not the file that does."""
    pool = ParserPool(tmp_path / "spool", ParserLimits(seconds=0.4), n_workers=1)
    pool.parsed(record, "application/json", "", LIMITS)
    _while_it_reads(pool, after_s=0.7)
    assert pool.parsed(record, "application/json", "", LIMITS).tables[0].channels
    _while_it_reads(pool, after_s=math.inf)
    with pytest.raises(TooLarge, match="takes longer than"):
        pool.parsed(record, "application/json", "", LIMITS)
    pool.close()


def test_memory_is_limited_and_the_pool_goes_on(record: Path, tmp_path: Path) -> None:
    pool = ParserPool(tmp_path / "spool", ParserLimits(memory_bytes=64 * 2**20), n_workers=1)
    fat = tmp_path / "fat.json"
    fat.write_text(json.dumps({"channels": {"time_s": list(range(3_000_000))}}))
    with pytest.raises(TooLarge, match="memory"):
        pool.parsed(fat, "application/json", "", LIMITS)
    assert pool.parsed(record, "application/json", "", LIMITS).tables[0].channels
    pool.close()


def test_a_worker_that_dies_is_replaced(pool: ParserPool, record: Path) -> None:
    pool.parsed(record, "application/json", "", LIMITS)
    worker = pool._places.queue[0]
    assert worker is not None
    os.kill(worker._process.pid, signal.SIGKILL)
    worker._process.wait()
    assert pool.parsed(record, "application/json", "", LIMITS).tables[0].channels


def test_a_crash_on_a_file_is_its_fault_alone(pool: ParserPool, record: Path) -> None:
    pool.parsed(record, "application/json", "", LIMITS)
    worker = pool._places.queue[0]
    assert worker is not None
    os.kill(worker._process.pid, signal.SIGSTOP)
    timer = threading.Timer(0.3, lambda: os.kill(worker._process.pid, signal.SIGSEGV))
    timer.start()
    threading.Timer(0.4, lambda: os.kill(worker._process.pid, signal.SIGCONT)).start()
    with pytest.raises(Undecodable, match="crashed"):
        pool.parsed(record, "application/json", "", LIMITS)
    assert pool.parsed(record, "application/json", "", LIMITS).tables[0].channels


def _while_it_reads(pool: ParserPool, *signals: int, after_s: float = 0.2) -> None:
    """Send signals to the process of the next file while it has the file in hand, which stands still until then."""
    worker = pool._places.queue[0]
    assert worker is not None
    pid = worker._process.pid
    os.kill(pid, signal.SIGSTOP)  # so that it has not answered before

    def sent() -> None:
        with suppress(ProcessLookupError):
            for number in (*signals, signal.SIGCONT):
                os.kill(pid, number)

    if after_s < math.inf:
        threading.Timer(after_s, sent).start()


def test_a_process_that_somebody_kills_costs_no_file(pool: ParserPool, record: Path) -> None:
    pool.parsed(record, "application/json", "", LIMITS)
    _while_it_reads(pool, signal.SIGKILL)
    raw = pool.parsed(record, "application/json", "", LIMITS)
    assert np.array_equal(raw.tables[0].channels["time_s"], document()["channels"]["time_s"])


def test_a_process_killed_before_it_takes_a_file_costs_none(
    pool: ParserPool, record: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pool.parsed(record, "application/json", "", LIMITS)
    worker = pool._places.queue[0]
    assert worker is not None
    worker._process.kill()
    worker._process.wait()
    seen = iter([True])  # it died right behind the look
    monkeypatch.setattr(parser_pool._Worker, "is_alive", property(lambda _: next(seen, False)))
    assert pool.parsed(record, "application/json", "", LIMITS).tables[0].channels


def test_a_stop_of_all_processes_lets_a_file_be_read_to_its_end(pool: ParserPool, record: Path) -> None:
    """systemd sends SIGTERM to a whole group, a terminal SIGINT; the file in hand is the server's to finish."""
    pool.parsed(record, "application/json", "", LIMITS)
    before = pool._places.queue[0]
    _while_it_reads(pool, signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
    assert pool.parsed(record, "application/json", "", LIMITS).metadata["pump_serial"] == "P-1"
    assert pool._places.queue[0] is before
    assert before is not None
    assert os.getsid(before._process.pid) != os.getsid(0)


def test_reading_files_yields_to_answering(pool: ParserPool, record: Path) -> None:
    pool.parsed(record, "application/json", "", LIMITS)
    worker = pool._places.queue[0]
    assert worker is not None
    own, its = (os.getpriority(os.PRIO_PROCESS, pid) for pid in (0, worker._process.pid))
    assert its == min(19, own + 10)


def test_a_file_on_which_two_processes_are_killed_takes_too_much_memory(
    pool: ParserPool, record: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def killed(_worker: parser_pool._Worker, _request: object, _seconds: float) -> None:
        raise parser_pool._DiedError(-signal.SIGKILL)

    with monkeypatch.context() as patch:
        patch.setattr(parser_pool._Worker, "ask", killed)
        with pytest.raises(TooLarge, match="memory"):
            pool.parsed(record, "application/json", "", LIMITS)
    assert pool.parsed(record, "application/json", "", LIMITS).tables[0].channels


def test_no_process_is_no_fault_of_the_file(pool: ParserPool, record: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for program in ("/bin/false", "/nowhere/python"):
        with monkeypatch.context() as patch:
            patch.setattr(parser_pool.sys, "executable", program)
            with pytest.raises(Unavailable, match="send it again"):
                pool.parsed(record, "application/json", "", LIMITS)
    assert pool.parsed(record, "application/json", "", LIMITS).tables[0].channels


def test_problems_pass_through_with_every_fault(pool: ParserPool, tmp_path: Path) -> None:
    path = tmp_path / "x"
    path.write_bytes(b"time_s\n\xff\xfe")
    with pytest.raises(Undecodable) as refused:
        pool.parsed(path, "text/csv", "", LIMITS)
    assert refused.value.errors[0].where == "byte 7"


def test_a_slow_file_keeps_no_neighbour_waiting(record: Path, tmp_path: Path) -> None:
    pool = ParserPool(tmp_path / "spool", ParserLimits(seconds=3.0), n_workers=2)
    pool.parsed(record, "application/json", "", LIMITS)
    slow = tmp_path / "slow.csv"
    with slow.open("w") as file:
        file.write("time_s,case_pressure_bar\n")
        file.writelines(f"{i},x\n" for i in range(9_000_000))
    with ThreadPoolExecutor(2) as threads:
        # both processes are up before it matters
        list(threads.map(lambda _: pool.parsed(record, "application/json", "", LIMITS), range(2)))
        late = threads.submit(pool.parsed, slow, "text/csv", "", LIMITS)
        assert pool.parsed(record, "application/json", "", LIMITS).tables[0].channels
        assert not late.done()
        with pytest.raises(TooLarge, match="takes longer than 3 s"):
            late.result()
    pool.close()


def test_the_server_does_not_grow_with_the_file(pool: ParserPool, tmp_path: Path) -> None:
    """A body of 64 MiB with the numbers of 160 samples: what the server holds is the numbers."""
    spool = Spool(tmp_path / "received")
    start, end = body()[:1], body()[1:]

    async def sent() -> AsyncIterator[bytes]:
        yield start
        for _ in range(64):
            yield b" " * 2**20
        yield end

    async def taken() -> RawFile:
        async with spool.received(sent(), "", 2**27) as file:
            return pool.parsed(file.path, "application/json", "", LIMITS)

    tracemalloc.start()
    try:
        raw = asyncio.run(taken())
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(raw.tables[0].channels["time_s"]) == 160
    assert peak < 8 * 2**20
