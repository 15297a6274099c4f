"""Both clients: they try again where that is safe, follow pages and jobs, and pass problems on."""

import asyncio
from collections.abc import Callable
from typing import Any

import httpx2
import pytest

from service import client as client_module
from service.client import AsyncClient, Client, RefusedError

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

    monkeypatch.setattr(client_module.time, "sleep", waits.append)
    monkeypatch.setattr(client_module.asyncio, "sleep", no_sleep)

    def run(answer: Answer, method: str, *args: Any, retries: int = 4, **kwargs: Any) -> Any:
        transport = httpx2.MockTransport(answer)
        if request.param == "sync":
            with Client("http://x", "secret", retries=retries) as client:
                client._http = httpx2.Client(base_url="http://x", transport=transport)
                found = getattr(client, method)(*args, **kwargs)
                return found if isinstance(found, dict) else list(found)

        async def asked() -> Any:
            async with AsyncClient("http://x", "secret", retries=retries) as client:
                await client._http.aclose()
                client._http = httpx2.AsyncClient(base_url="http://x", transport=transport)
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
    assert call(answer, "pages", "/records", pump="P") == [{"n": 1}, {"n": 2}]
    assert [dict(r.url.params) for r in seen] == [{"pump": "P"}, {"pump": "P", "cursor": "c"}]


def test_a_job_is_waited_for_with_progress(call: Any) -> None:
    steps = [("queued", 0, None), ("running", 1, 2), ("succeeded", 2, 2)]
    bodies = [JOB | {"status": s, "progress": {"done": d, "total": t}} for s, d, t in steps]
    seen: list[tuple[int, int | None]] = []
    answer, _ = answers(*(httpx2.Response(200, json=b) for b in bodies))
    job = call(answer, "finished_job", "j", lambda done, total: seen.append((done, total)))
    assert job["status"] == "succeeded"
    assert seen == [(0, None), (1, 2), (2, 2)]
