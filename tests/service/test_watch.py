"""An inbox sends what is complete, once, whatever stops it: crashes at every step, files that grow, services that are away."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fsspec
import httpx2
import pytest
from typer.testing import CliRunner

from benchmarks.watch import mixed_files, outcome, watched
from service.client import Client
from service.client.testing import MemoryService
from service.command_line.main import app
from service.demo.run import served
from service.inbox.journal import Journal
from service.inbox.place import Place
from service.inbox.watching import Event, Inbox, Rules, WrongSetUpError
from service.settings import Settings
from tests.service.records import METADATA

HEADER = "".join(f"# {k}: {v}\n" for k, v in METADATA.items() if k != "flight_id")


def record(flight_id: str) -> bytes:
    return (HEADER + f"# flight_id: {flight_id}\ntime_s\n0\n").encode()


class Bench:
    """One folder with a service in memory; every ``look`` is a process of its own."""

    def __init__(self, folder: Path, rules: Rules | None = None, url: str | None = None) -> None:
        self.folder, self.url = folder / "inbox", url or str(folder / "inbox")
        self.folder.mkdir(exist_ok=True)
        self.journal = folder / "journal.sqlite"
        self.rules = rules or Rules(settle_s=10.0)
        self.service = MemoryService()
        self.at = 1000.0
        self.n_sent = 0
        self.status: int | None = None
        self.unsettled = 0

    def put(self, name: str, content: bytes) -> None:
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)

    def look(self, after_s: float = 0.0, step: Callable[[], None] | None = None) -> list[Event]:
        self.at += after_s
        with Journal(self.journal) as journal, Client("http://test", retries=0, transport=self._transport()) as client:

            def send(_name: str, content: bytes) -> Any:
                self.n_sent += 1
                return client.upload(content)

            inbox = Inbox(Place(self.url), journal, send, self.rules, now=lambda: self.at)
            if step is not None:
                _crashing(inbox, step)
            events = list(inbox.look())
            self.unsettled = inbox.unsettled
            return events

    def _transport(self) -> httpx2.MockTransport:
        if self.status is None:
            return self.service.transport
        return httpx2.MockTransport(
            lambda _: httpx2.Response(self.status or 0, json={"detail": "no", "status": self.status})
        )

    def names(self) -> set[str]:
        return {str(p.relative_to(self.folder)) for p in self.folder.rglob("*") if p.is_file()}


class Killed(BaseException):
    """The process ends here."""


def _crashing(inbox: Inbox, step: Callable[[], None]) -> None:
    """Call ``step`` before and after everything that leaves a trace."""

    def around(done: Callable[..., Any]) -> Callable[..., Any]:
        def wrapped(*arguments: Any) -> Any:
            step()
            found = done(*arguments)
            step()
            return found

        return wrapped

    inbox.send = around(inbox.send)
    for owner, names in ((inbox.place, ("move", "write")), (inbox.journal, ("note", "steady_since"))):
        for name in names:
            setattr(owner, name, around(getattr(owner, name)))


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


def test_a_file_is_taken_when_it_has_not_changed_for_a_while(bench: Bench) -> None:
    bench.put("a.csv", record("1")[:20])
    assert bench.look() == []
    bench.put("a.csv", record("1"))
    assert bench.look(9.0) == []
    assert bench.look(9.0) == []
    assert bench.unsettled == 1
    (event,) = bench.look(2.0)
    assert (event.kind, event.name) == ("stored", "a.csv")
    assert bench.names() == {"done/a.csv"}
    assert bench.look(20.0) == []
    assert bench.n_sent == 1


def test_a_marker_says_that_a_file_is_complete(tmp_path: Path) -> None:
    bench = Bench(tmp_path, Rules(marker=".ok"))
    bench.put("deep/a.csv", record("1"))
    assert bench.look(100.0) == []
    bench.put("deep/a.csv.ok", b"")
    assert [e.kind for e in bench.look()] == ["stored"]
    assert bench.names() == {"done/deep/a.csv", "done/deep/a.csv.ok"}


def test_hidden_empty_unfinished_and_foreign_files_are_left(bench: Bench) -> None:
    for name in (".a.csv", "a.csv.part", "b.csv.tmp", "c.csv", "notes.txt", ".rsync/x.csv"):
        bench.put(name, b"" if name == "c.csv" else record(name))
    bench.look()
    assert [(e.kind, e.name) for e in bench.look(20.0)] == [("passed over", "notes.txt")]
    assert bench.n_sent == 0
    assert len(bench.names()) == 6


def test_a_refused_file_has_its_problem_beside_it_and_may_come_again(bench: Bench) -> None:
    bench.put("a.csv", b"time_s\n0\n")
    bench.look()
    (event,) = bench.look(20.0)
    assert event.kind == "refused"
    problem = json.loads((bench.folder / "refused/a.csv.problem.json").read_bytes())
    assert problem["status"] == 422
    assert problem["file"] == "a.csv"
    assert {"where": "pump_serial", "problem": "is missing"} in problem["errors"]
    os.rename(bench.folder / "refused/a.csv", bench.folder / "a.csv")
    assert [e.kind for e in bench.look() + bench.look(20.0)] == ["refused"]
    assert bench.n_sent == 2


def test_another_file_of_the_same_name_overwrites_nothing(bench: Bench) -> None:
    for flight in ("1", "2", "3"):
        bench.put("a.csv", record(flight))
        bench.look()
        assert [e.kind for e in bench.look(20.0)] == ["stored"]
    kept = {path.read_bytes() for path in (bench.folder / "done").iterdir()}
    assert kept == {record("1"), record("2"), record("3")}


def test_files_that_stay_are_remembered_by_the_journal_alone(tmp_path: Path) -> None:
    bench = Bench(tmp_path, Rules(settle_s=10.0, leave=True))
    bench.put("a.csv", record("1"))
    bench.put("b.csv", b"time_s\n0\n")
    bench.look()
    assert [e.kind for e in bench.look(20.0)] == ["stored", "refused"]
    assert bench.look(20.0) == []
    assert bench.names() == {"a.csv", "b.csv"}
    bench.put("b.csv", record("2"))
    bench.look()
    assert [e.kind for e in bench.look(20.0)] == ["stored"]


@pytest.mark.parametrize("status", [503, 500, 507, 429, 502])
def test_a_service_that_is_away_costs_nothing(bench: Bench, status: int) -> None:
    bench.put("a.csv", record("1"))
    bench.put("b.csv", record("2"))
    bench.look()
    bench.status = status
    assert [e.kind for e in bench.look(20.0)] == ["delayed"]
    assert bench.n_sent == 1
    assert bench.names() == {"a.csv", "b.csv"}
    bench.status = None
    assert [e.kind for e in bench.look(5.0)] == ["stored", "stored"]


@pytest.mark.parametrize("status", [401, 403, 404])
def test_a_wrong_key_or_mapping_refuses_no_file(bench: Bench, status: int) -> None:
    bench.put("a.csv", record("1"))
    bench.look()
    bench.status = status
    with pytest.raises(WrongSetUpError):
        bench.look(20.0)
    assert bench.names() == {"a.csv"}


def test_a_clock_that_was_set_back_delays_once(bench: Bench) -> None:
    bench.put("a.csv", record("1"))
    bench.look()
    assert bench.look(-1e6) == []
    assert [e.kind for e in bench.look(11.0)] == ["stored"]


def test_two_watches_do_not_share_a_journal(tmp_path: Path) -> None:
    with Journal(tmp_path / "j.sqlite"), pytest.raises(OSError, match="another"):
        Journal(tmp_path / "j.sqlite")
    Journal(tmp_path / "j.sqlite").__exit__()


def test_killed_at_every_step_each_record_is_stored_once(tmp_path: Path) -> None:
    """Every place where a process may end, one run each, the killed process followed by one that goes on."""
    last = 200
    for n in range(last):
        folder = tmp_path / str(n)
        folder.mkdir()
        bench = Bench(folder, Rules(settle_s=0.0))
        for i in range(2):
            bench.put(f"{i}.csv", record(str(i)))
        bench.put("bad.csv", b"time_s\n0\n")
        left = n

        def step() -> None:
            nonlocal left
            left -= 1
            if left < 0:
                raise Killed

        try:
            bench.look(step=step)
        except Killed:
            bench.look()
        else:
            assert n > 20
            break
        flights = [r["flight_id"] for r in bench.service._records.values()]
        assert sorted(flights) == ["0", "1"], n
        assert bench.names() == {"done/0.csv", "done/1.csv", "refused/bad.csv", "refused/bad.csv.problem.json"}, n
        assert bench.n_sent <= 4, n
    else:
        pytest.fail("the steps never end")


def test_a_store_elsewhere_is_an_inbox_too(tmp_path: Path) -> None:
    files = fsspec.filesystem("memory")
    files.makedirs("/inbox-of-a-test", exist_ok=True)
    files.pipe_file("/inbox-of-a-test/day/a.csv", record("1"))
    bench = Bench(tmp_path, url="memory://inbox-of-a-test")
    bench.look()
    assert [(e.kind, e.name) for e in bench.look(20.0)] == [("stored", "day/a.csv")]
    assert files.exists("/inbox-of-a-test/done/day/a.csv")
    assert not files.exists("/inbox-of-a-test/day/a.csv")
    files.rm("/inbox-of-a-test", recursive=True)


@pytest.mark.study
def test_forty_mixed_files_and_a_watch_that_is_killed_at_random_moments(
    tmp_path: Path, new_settings: Callable[..., Settings]
) -> None:
    folder = tmp_path / "inbox"
    is_good = mixed_files(folder, 40, 40)
    with served(new_settings("sqlite"), "127.0.0.1", 8197) as url:
        n_kills = watched(folder, url, 0.4, most_kills=3, seed=3)
        found = outcome(folder, url)
    assert n_kills >= 1
    assert found["records"] == sum(is_good.values()) == 36
    assert found["refused"] == found["problems"] == 4
    assert (found["done"], found["left"], found["more_than_once"]) == (36, 0, 0)


def test_the_command_says_what_it_did(tmp_path: Path) -> None:
    runner = CliRunner()
    nowhere = runner.invoke(app, ["watch", str(tmp_path / "none"), "--once"])
    assert nowhere.exit_code == 2
    assert "there is no folder" in nowhere.output
    (tmp_path / "inbox").mkdir()
    (tmp_path / "inbox/a.csv").write_bytes(record("1"))
    (tmp_path / "inbox/b.pdf").write_bytes(b"%PDF")
    words = ["watch", str(tmp_path / "inbox"), "--once", "--interval", "0.1", "--url", "http://127.0.0.1:9", "--json"]
    away = runner.invoke(app, words)
    assert away.exit_code == 1
    lines = [json.loads(line) for line in away.stdout.splitlines()]
    assert [(line["event"], line["file"]) for line in lines] == [("passed over", "b.pdf"), ("delayed", None)]
    wrong = runner.invoke(app, [*words, "--set", "position"])
    assert wrong.exit_code == 2
