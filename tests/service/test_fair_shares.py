"""Nobody takes the service from others: places in turn, quotas, queues that are refused before they are long."""

import asyncio
import itertools
import json
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
from fastapi.testclient import TestClient
from hypothesis import given, settings
from hypothesis import strategies as st

from service.access.account import Account, current_account, in_background, working_for
from service.access.crowd import Crowd
from service.access.quotas import Quotas
from service.access.turns import Gate, TooMany
from service.errors import Unavailable
from service.ingest.parser_pool import ParserPool
from service.ingest.raw import Limits
from service.settings import Settings
from service.web.edge import Edge
from tests.service.guarded import guarded_client, key
from tests.service.records import body, document

API = "/api/v1"
JSON = {"content-type": "application/json"}


class Clock:
    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


def gate(places: int = 2, most_waiting: int = 8, patience_s: float = 20.0) -> tuple[Gate, Clock]:
    clock = Clock()
    return Gate(places, most_waiting, patience_s, "a turn", clock), clock


def asked(of: Gate, tenant: str, **more: Any) -> Any:
    return of._ask(Account(tenant=tenant, **more), lambda: None)


class TestTurns:
    def test_whoever_is_alone_holds_every_place(self) -> None:
        shared, _ = gate()
        assert [asked(shared, "a").is_given for _ in range(3)] == [True, True, False]

    def test_one_place_is_kept_from_whoever_holds_the_rest(self) -> None:
        shared, clock = gate()
        shared._leave(asked(shared, "b"))
        first, second = asked(shared, "a"), asked(shared, "a")
        assert (first.is_given, second.is_given) == (True, False)
        late = asked(shared, "b")
        assert late.is_given
        shared._leave(first)
        assert second.is_given  # it holds none of the others any more
        clock.now += 700.0
        shared._leave(late)
        assert [asked(shared, "a").is_given, asked(shared, "a").is_given] == [True, False]

    def test_who_has_used_least_is_next(self) -> None:
        shared, clock = gate(places=1)
        holding = asked(shared, "greedy")
        waiting = [asked(shared, name) for name in ("greedy", "greedy", "modest")]
        clock.now += 30.0
        shared._leave(holding)
        assert [turn.is_given for turn in waiting] == [False, False, True]

    def test_background_work_waits_for_nobody_and_keeps_nobody_out(self) -> None:
        shared, _ = gate(places=2, most_waiting=2)
        shared._leave(asked(shared, "a"))
        turns = [asked(shared, "a", is_background=True) for _ in range(50)]
        assert sum(turn.is_given for turn in turns) == 1  # the other place is for those who wait for an answer
        assert asked(shared, "a").is_given

    def test_queues_are_refused_before_they_are_long(self) -> None:
        shared, _ = gate(places=1, most_waiting=4)
        asked(shared, "other")
        for _ in range(2):
            asked(shared, "a")
        with pytest.raises(TooMany) as mine:
            asked(shared, "a")
        assert mine.value.headers["Retry-After"]
        for name in ("b", "b", "c", "d", "e", "f"):  # whoever waits for nothing yet is let in beyond the limit
            asked(shared, name)
        with pytest.raises(Unavailable) as everybody:
            asked(shared, "c")
        assert everybody.value.headers["Retry-After"]
        assert shared.waiting == 8

    @settings(max_examples=40, deadline=None)
    @given(st.lists(st.tuples(st.sampled_from("abc"), st.booleans()), max_size=60))
    def test_places_are_neither_lost_nor_doubled(self, steps: list[tuple[str, bool]]) -> None:
        shared, clock = gate(places=3, most_waiting=1000)
        turns: list[Any] = []
        for tenant, comes in steps:
            clock.now += 1.0
            if comes or not turns:
                turns.append(asked(shared, tenant))
            else:
                shared._leave(turns.pop(0))
            held = sum(turn.is_given for turn in turns)
            assert held + shared._free == 3
            assert shared.waiting == len(turns) - held
        for turn in turns:
            shared._leave(turn)
        assert (shared._free, shared.waiting) == (3, 0)

    def test_threads_and_tasks_wait_and_give_up(self) -> None:
        shared = Gate(1, 10, 0.2, "a turn")
        inside: list[str] = []

        async def comes(name: str) -> None:
            async with shared.entered_by_task(Account(tenant=name)):
                inside.append(name)
                await asyncio.sleep(0.02)

        async def cancelled() -> None:
            waits = asyncio.create_task(comes("gone"))
            with shared.entered(Account(tenant="holder")):
                await asyncio.sleep(0.02)
                waits.cancel()
                with pytest.raises(Unavailable, match="no turn came"):
                    await comes("late")
            await asyncio.gather(*(comes(name) for name in "abc"), return_exceptions=True)

        asyncio.run(cancelled())
        assert sorted(inside) == ["a", "b", "c"]
        with shared.entered(Account(tenant="a")), ThreadPoolExecutor(1) as threads:

            def wait() -> None:
                with shared.entered(Account(tenant="b")):
                    pass

            with pytest.raises(Unavailable):
                threads.submit(wait).result()
        assert (shared._free, shared.waiting) == (1, 0)


def test_the_parser_is_shared_between_tenants(tmp_path: Path) -> None:
    """One tenant sends slow files without end; another's is read at once."""
    pool = ParserPool(tmp_path / "spool", n_workers=2)
    slow, quick = tmp_path / "slow.csv", tmp_path / "quick.json"
    with slow.open("w") as file:
        file.write("time_s,case_pressure_bar\n")
        file.writelines(f"{i},x\n" for i in range(60_000))
    quick.write_bytes(body())
    limits = Limits(1_000_000_000, 10_000_000)
    done = threading.Event()
    slow_s: list[float] = []

    def read(path: Path, tenant: str) -> Account:
        with working_for(Account(tenant=tenant)) as account:
            kind = "text/csv" if path is slow else "application/json"
            pool.parsed(path, kind, "", limits)
        return account

    def greedy() -> None:
        while not done.is_set():
            slow_s.append(read(slow, "greedy").parser_seconds)

    read(quick, "modest")
    with ThreadPoolExecutor(3) as threads:
        kept = [threads.submit(greedy) for _ in range(3)]
        time.sleep(0.3)
        waits = []
        for _ in range(5):
            began = time.monotonic()
            assert read(quick, "modest").parser_seconds > 0.0
            waits.append(time.monotonic() - began)
        done.set()
        for thread in kept:
            thread.result()
    pool.close()
    # behind three slow files, one after another, its turn would take their time each time
    assert sorted(waits)[2] < min(slow_s)


def quotas(**limits: Any) -> tuple[Quotas, Clock]:
    clock = Clock()
    return Quotas(Settings(_env_file=None, **limits), clock), clock  # type: ignore[call-arg]


def account(name: str = "k1", operator: str | None = "north") -> Account:
    return Account(key=name, operator=operator)


class TestQuotas:
    def test_a_burst_passes_and_a_steady_excess_does_not(self) -> None:
        held, clock = quotas(quota_key_requests_per_minute=60.0)
        passed = 0
        for _ in range(600):  # ten a second for a minute, where one is allowed
            with suppress(TooMany):
                held.count(account(), brings_bytes=False)
                passed += 1
            clock.now += 0.1
        assert 20 + 59 <= passed <= 20 + 61
        held.count(account("k2", None), brings_bytes=False)

    def test_keys_of_one_operator_share_its_quota(self) -> None:
        held, _ = quotas(quota_operator_requests_per_minute=30.0)
        keys = itertools.cycle(("k1", "k2", "k3"))
        for _ in range(10):
            held.count(account(next(keys)), brings_bytes=False)
        with pytest.raises(TooMany, match="operator north"):
            held.count(account(next(keys)), brings_bytes=False)
        held.count(account("k4", "south"), brings_bytes=False)

    @pytest.mark.parametrize(
        ("limit", "cost"),
        [
            ({"quota_key_bytes_per_hour": 3600.0}, (2000, 0.0)),
            ({"quota_operator_parser_seconds_per_hour": 36.0}, (0, 20.0)),
        ],
    )
    def test_debts_are_waited_for_and_reads_go_on(self, limit: dict[str, float], cost: tuple[int, float]) -> None:
        held, clock = quotas(**limit)
        sender = account()
        sender.parser_seconds = cost[1]
        held.count(sender, brings_bytes=True)
        held.charge(sender, cost[0])
        with pytest.raises(TooMany) as refused:
            held.count(account(), brings_bytes=True)
        held.count(account(), brings_bytes=False)
        clock.now += int(refused.value.headers["Retry-After"]) + 1.0
        held.count(account(), brings_bytes=True)

    def test_a_request_counts_once_and_nobody_without_a_key(self) -> None:
        held, _ = quotas(quota_key_requests_per_minute=3.0)
        one = account()
        for _ in range(10):
            held.count(one, brings_bytes=True)
            held.count(Account(), brings_bytes=True)
        with pytest.raises(TooMany):
            held.count(account(), brings_bytes=True)


def test_a_crowd_lets_in_whoever_has_nothing_in_hand() -> None:
    crowd = Crowd(Settings(_env_file=None, max_requests_in_hand=4, max_requests_each=2), Clock())  # type: ignore[call-arg]
    for _ in range(4):  # alone, one may have all
        crowd.enter(crowd.came("", "1.1.1.1", brings_bytes=False).tenant)
    with pytest.raises(Unavailable):
        crowd.came("", "1.1.1.1", brings_bytes=False)
    crowd.enter(crowd.came("", "2.2.2.2", brings_bytes=False).tenant)
    with pytest.raises(TooMany):
        crowd.came("", "1.1.1.1", brings_bytes=False)
    for _ in range(4):
        crowd.leave("address 1.1.1.1")
    asker = crowd.came("Bearer x", "2.2.2.2", brings_bytes=False)
    crowd.learn(asker, "Bearer x", "k1", "north", "office")
    assert crowd.came("Bearer x", "3.3.3.3", brings_bytes=False).tenant == "operator north"
    crowd.leave("address 2.2.2.2")
    assert crowd.in_hand == 0


def test_work_in_the_background_is_its_operator_s() -> None:
    assert current_account().is_background
    with working_for(Account(tenant="operator north", key="k", operator="north")), in_background() as later:
        assert (later.tenant, later.operator, later.key, later.is_background) == ("operator north", "north", "", True)


def test_over_http_quotas_are_of_their_key(database_url: str, tmp_path: Path) -> None:
    with guarded_client(database_url, tmp_path, quota_key_requests_per_minute=15.0) as client:
        noisy, quiet = key(client, "analyst", "north"), key(client, "viewer", "south")
        answers = [client.get(f"{API}/pumps", headers=noisy) for _ in range(7)]
        assert [a.status_code for a in answers] == [200] * 5 + [429] * 2
        refused = answers[-1]
        assert refused.headers["content-type"] == "application/problem+json"
        assert 1 <= int(refused.headers["retry-after"]) <= 5
        assert "quota of requests" in refused.json()["detail"]
        assert client.post(f"{API}/records", content=body(), headers={**noisy, **JSON}).status_code == 429
        assert client.get(f"{API}/pumps", headers=quiet).status_code == 200
        for path in ("/healthz", "/readyz", "/metrics"):
            assert client.get(path, headers=noisy).status_code == 200
        assert 'casedrain_refused_total{why="quota_requests"}' in client.get("/metrics").text


def test_over_http_bytes_and_the_parser_are_paid_for(database_url: str, tmp_path: Path) -> None:
    limits = {"quota_key_bytes_per_hour": 3000.0, "quota_key_parser_seconds_per_hour": 1.0}
    with guarded_client(database_url, tmp_path, **limits) as client:
        asker = {**key(client, "analyst", "north"), **JSON}
        assert client.post(f"{API}/records", content=body(), headers=asker).status_code == 201
        again = client.post(f"{API}/records", content=body(), headers=asker)
        assert again.status_code == 429
        assert "bytes sent" in again.json()["detail"]
        assert client.get(f"{API}/records", headers=asker).status_code == 200


def test_jobs_that_have_not_ended_are_counted(
    database_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with guarded_client(database_url, tmp_path, quota_key_jobs=2) as client, monkeypatch.context() as patch:
        patch.setattr("service.jobs.engine.submit", lambda _job_id: None)
        asker, other = key(client, "admin", "north", "a"), key(client, "admin", "south", "b")

        def asks(headers: dict[str, str], pump: str) -> Any:
            return client.post(f"{API}/jobs", json={"kind": "reprocess", "parameters": {"pump": pump}}, headers=headers)

        for pump in ("P-1", "P-2"):
            client.post(f"{API}/pumps", json={"serial": pump}, headers=asker)
        client.post(f"{API}/pumps", json={"serial": "P-1"}, headers=other)
        started = [asks(asker, pump).status_code for pump in ("P-1", "P-2")]
        assert started == [202, 202]
        client.post(f"{API}/pumps", json={"serial": "P-3"}, headers=asker)
        refused = asks(asker, "P-3")
        assert refused.status_code == 429
        assert refused.headers["retry-after"]
        assert asks(asker, "P-1").status_code == 202  # the one that waits already
        assert asks(other, "P-1").status_code == 202


def test_uploads_beyond_the_queue_are_refused_before_their_bytes(client: TestClient) -> None:
    crowd = client.app.state.context.crowd  # type: ignore[attr-defined]
    crowd.uploads._free, crowd.uploads._most_waiting = 0, 0
    refused = client.post(f"{API}/records", content=body(), headers=JSON)
    assert refused.status_code in (429, 503)
    assert refused.headers["retry-after"]
    assert client.get(f"{API}/records").json()["items"] == []
    crowd.uploads._free, crowd.uploads._most_waiting = 1, 4
    assert client.post(f"{API}/records", content=body(), headers=JSON).status_code == 201
    stored = client.post(
        f"{API}/records?wait=false", content=json.dumps({**document(), "flight_id": "F2"}), headers=JSON
    )
    assert stored.status_code == 202
    assert client.get(f"{API}/records/{stored.json()['record_id']}").json()["status"] == "analysed"


def test_an_answer_that_is_taken_slowly_holds_no_place(client: TestClient) -> None:
    """A place of the reads is given back where the answer begins; a queue that is full is answered, not waited for."""
    context = client.app.state.context  # type: ignore[attr-defined]
    reads, seen = context.crowd.reads, []
    start = Edge.__call__

    async def slowly(self: Edge, scope: Any, receive: Any, send: Any) -> None:
        async def look(message: Any) -> None:
            seen.append((message["type"], reads._free))  # before it is taken, however long that lasts
            await send(message)

        await start(self, scope, receive, look)

    with mock.patch.object(Edge, "__call__", slowly):
        assert client.get(f"{API}/pumps").status_code == 200
    assert seen == [("http.response.start", reads._places), ("http.response.body", reads._places)]
    reads._free, reads._most_waiting = 0, 0
    refused = client.get(f"{API}/pumps")
    assert refused.status_code in (429, 503)
    assert refused.headers["retry-after"]
    assert client.get("/readyz").status_code == 200
    reads._free, reads._most_waiting = 8, 64
    assert client.head(f"{API}/pumps").status_code == 200
    assert reads._free == 8
