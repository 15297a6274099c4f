"""Both clients: they try again where that is safe, follow pages and jobs, pass problems on, and stay light."""

import asyncio
import inspect
import subprocess
import sys
from collections.abc import Callable
from typing import Any, get_args, get_origin, get_type_hints

import httpx2
import pytest
from pydantic import TypeAdapter

from service.answers.records import Record
from service.answers.verdicts import Verdict
from service.client import AsyncClient, Client, RefusedError, asynchronous, synchronous
from service.client.testing import MemoryService, verdict_of

Answer = Callable[[httpx2.Request], httpx2.Response]
JOB = {"id": "j", "problem": None, "items": []}


def answers(*given: httpx2.Response | Exception) -> tuple[Answer, list[httpx2.Request]]:
    """A server that gives these answers one after the other."""
    waiting, seen = list(given), []

    def answer(request: httpx2.Request) -> httpx2.Response:
        seen.append(request)
        found = waiting.pop(0)
        if isinstance(found, Exception):
            raise found
        return found

    return answer, seen


@pytest.fixture(params=["sync", "async"])
def call(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Run one method of either client against given answers; waiting costs nothing and is noted."""
    waits: list[float] = []

    async def no_sleep(seconds: float) -> None:
        waits.append(seconds)

    monkeypatch.setattr(synchronous.time, "sleep", waits.append)
    monkeypatch.setattr(asynchronous.asyncio, "sleep", no_sleep)

    def run(answer: Answer, method: str, *args: Any, retries: int = 4, **kwargs: Any) -> Any:
        transport = httpx2.MockTransport(answer)
        if request.param == "sync":
            with Client("http://x", "secret", retries=retries, transport=transport) as client:
                found = getattr(client, method)(*args, **kwargs)
                return found if isinstance(found, dict) else list(found)

        async def asked() -> Any:
            async with AsyncClient("http://x", "secret", retries=retries, transport=transport) as client:
                found = getattr(client, method)(*args, **kwargs)
                return [item async for item in found] if hasattr(found, "__aiter__") else await found

        return asyncio.run(asked())

    run.waits = waits  # type: ignore[attr-defined]
    return run


def test_an_upload_is_repeated_after_429_503_and_a_lost_connection(call: Any) -> None:
    answer, seen = answers(
        httpx2.ConnectError("gone"),
        httpx2.Response(503),
        httpx2.Response(429, headers={"retry-after": "7"}),
        httpx2.Response(201, json={"record_id": "r"}),
    )
    found = call(answer, "upload", b"bytes", mapping="m", metadata={"position": "LH"}, wait=False)
    assert found == {"record_id": "r"}
    assert [r.content for r in seen] == [b"bytes"] * 4
    assert dict(seen[0].url.params) == {"position": "LH", "wait": "false", "mapping": "m"}
    assert 0.15 <= call.waits[0] <= 0.25
    assert 0.3 <= call.waits[1] <= 0.5
    assert call.waits[2] == 7.0


def test_it_gives_up_in_the_end_and_never_repeats_a_refusal(call: Any) -> None:
    with pytest.raises(httpx2.ConnectError):
        call(answers(*[httpx2.ConnectError("gone")] * 3)[0], "upload", b"", retries=2)
    problem = {"detail": "wrong", "errors": [{"where": "aircraft", "problem": "is missing"}]}
    answer, seen = answers(httpx2.Response(422, json=problem))
    with pytest.raises(RefusedError, match="aircraft: is missing") as refused:
        call(answer, "upload", b"")
    assert refused.value.problem == problem
    assert len(seen) == 1
    with pytest.raises(RefusedError, match="HTTP 503"):
        call(answers(*[httpx2.Response(503)] * 2)[0], "upload", b"", retries=1)


def test_pages_are_followed(call: Any) -> None:
    answer, seen = answers(
        httpx2.Response(200, json={"items": [{"n": 1}], "next": "c"}),
        httpx2.Response(200, json={"items": [{"n": 2}], "next": None}),
    )
    assert call(answer, "records", pump="P") == [{"n": 1}, {"n": 2}]
    assert [dict(r.url.params) for r in seen] == [{"pump": "P"}, {"pump": "P", "cursor": "c"}]


def test_a_job_is_waited_for_with_progress(call: Any) -> None:
    steps = [("queued", 0, None), ("running", 1, 2), ("succeeded", 2, 2)]
    bodies = [JOB | {"status": s, "progress": {"done": d, "total": t}} for s, d, t in steps]
    seen: list[tuple[int, int | None]] = []
    answer, _ = answers(*(httpx2.Response(200, json=b) for b in bodies))
    job = call(answer, "finished_job", "j", lambda done, total: seen.append((done, total)))
    assert job["status"] == "succeeded"
    assert seen == [(0, None), (1, 2), (2, 2)]


def test_a_call_without_a_body_is_no_fault(call: Any) -> None:
    answer, _ = answers(httpx2.Response(204))
    assert call(answer, "request", "DELETE", "/keys/k") == {}


def test_both_clients_have_the_same_calls_with_the_same_arguments_and_answers() -> None:
    def methods(client: type) -> dict[str, Any]:
        return {n: f for n, f in vars(client).items() if not n.startswith("_") and n != "close" and callable(f)}

    sync, later = methods(Client), methods(AsyncClient)
    assert sync.keys() == later.keys()
    for name, method in sync.items():
        ours, others = inspect.signature(method), inspect.signature(later[name])
        assert list(ours.parameters.values()) == list(others.parameters.values()), name
        given, awaited = get_type_hints(method)["return"], get_type_hints(later[name])["return"]
        if get_origin(given) is not None:
            given, awaited = get_args(given), get_args(awaited)
        assert given == awaited, name


def test_importing_the_client_loads_neither_the_server_nor_numbers() -> None:
    heavy = "numpy numba scipy pint fastapi starlette sqlalchemy structlog typer twin detectors matplotlib"
    code = (
        "import sys, service.client, service.client.testing\n"
        f"print(*sorted({{n.split('.')[0] for n in sys.modules}} & set({heavy.split()!r})))\n"
        "print(*sorted({n.split('.')[1] for n in sys.modules if n.startswith('service.')}))"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    outside, inside = found.stdout.splitlines()
    assert outside == ""
    assert inside.split() == ["answers", "client"]


UPLOAD = b"""# pump_serial: DT/907
# aircraft: F-HCAA
# position: LH
# flight_id: 2026-05-02/1
# started_at: 2026-05-02T07:11:00Z
time_s,case_pressure_bar
0,0.9
"""


def test_a_service_in_memory_answers_in_the_shapes_of_the_api(call: Any) -> None:
    service = MemoryService({"DT/907": verdict_of("pump_degradation", "pump", 0.97)})
    run = service.transport.handler
    answer = call(run, "upload", UPLOAD)
    TypeAdapter(Record).validate_python(answer)
    verdict = call(run, "verdict", "DT/907")
    TypeAdapter(Verdict).validate_python(verdict)
    assert verdict == answer["verdict"]
    assert verdict["state"] == "pump_degradation"
    assert sum(verdict["probabilities"].values()) == pytest.approx(1.0)
    assert call(run, "upload", UPLOAD)["record_id"] == answer["record_id"]
    assert [r["record_id"] for r in call(run, "records", pump="DT/907")] == [answer["record_id"]]
    assert list(call(run, "records", pump="another")) == []
    assert [p["serial"] for p in call(run, "pumps")] == ["DT/907"]
    assert call(run, "pump", "DT/907")["records"] == 1
    assert len(service.requests) == 7


def test_a_service_in_memory_refuses_as_the_service_does(call: Any) -> None:
    service = MemoryService(refuse=[{"where": "channels.time_s", "problem": "stands still"}])
    run = service.transport.handler
    with pytest.raises(RefusedError, match="time_s: stands still") as refused:
        call(run, "upload", b"time_s\n1\n")
    assert {e["where"] for e in refused.value.problem["errors"]} >= {"channels.time_s", "pump_serial", "flight_id"}
    with pytest.raises(RefusedError, match="no pump P-7"):
        call(run, "verdict", "P-7")
    with pytest.raises(RefusedError, match="does not answer GET /alarms"):
        call(run, "alarms")
