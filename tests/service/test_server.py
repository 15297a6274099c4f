"""The server in front of the application: heads that drip, a stop that ends, proxies that are trusted or not."""

import signal
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import pytest
from fastapi import FastAPI, Request

from service.command_line import server
from service.command_line.server import Server, bound_socket
from service.settings import Settings


@contextmanager
def serving(monkeypatch: pytest.MonkeyPatch, **settings: Any) -> Iterator[tuple[Server, int, threading.Thread]]:
    """A small application behind the server; it tells who asks it and whether it stops."""
    monkeypatch.setattr(server, "_end", lambda: None)  # would end the tests, too
    app = FastAPI()

    @app.get("/who")
    async def who(request: Request) -> dict[str, Any]:
        stopping = getattr(request.app.state, "is_stopping", False)
        return {"host": request.client and request.client.host, "scheme": request.url.scheme, "stopping": stopping}

    @app.post("/body")
    async def body(request: Request) -> int:
        return len(await request.body())

    listening = bound_socket("127.0.0.1", 0)
    port = listening.getsockname()[1]
    running = Server(app, Settings(**settings), "127.0.0.1", port)
    thread = threading.Thread(target=running.run, kwargs={"sockets": [listening]}, daemon=True)
    thread.start()
    while not running.started:
        time.sleep(0.01)
    try:
        yield running, port, thread
    finally:
        running.should_exit = running.force_exit = True
        thread.join(5.0)


def said(port: int, sent: bytes, seconds: float = 5.0) -> bytes:
    with socket.create_connection(("127.0.0.1", port), timeout=seconds) as client:
        client.sendall(sent)
        found = b""
        while not found.endswith(b"}") and (part := client.recv(4000)):
            found += part
        return found


WHO = b"GET /who HTTP/1.1\r\nHost: localhost\r\nX-Forwarded-For: 198.51.100.7\r\nX-Forwarded-Proto: https\r\n\r\n"


def test_a_head_that_does_not_arrive_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    with serving(monkeypatch, body_stall_seconds=0.3) as (_, port, _thread):
        assert said(port, b"GET / HT") == b""
        with socket.create_connection(("127.0.0.1", port), timeout=5.0) as client:
            client.sendall(WHO)
            assert client.recv(4000).startswith(b"HTTP/1.1 200")
            began = time.monotonic()
            dripped = 0
            try:
                while time.monotonic() - began < 5.0:  # a byte now and then does not wind the clock back
                    client.sendall(b"G")
                    dripped += 1
                    time.sleep(0.1)
            except OSError:
                pass
            assert 1 <= dripped < 20


def test_a_stop_says_so_first_and_ends_whoever_stalls(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = {"drain_notice_seconds": 0.4, "drain_seconds": 1.0, "body_stall_seconds": 60.0}
    with ExitStack() as kept, serving(monkeypatch, **settings) as (running, port, thread):
        stalled = [kept.enter_context(socket.create_connection(("127.0.0.1", port))) for _ in range(3)]
        stalled[0].sendall(b"GET / HT")
        stalled[1].sendall(b"POST /body HTTP/1.1\r\nHost: localhost\r\nContent-Length: 50\r\n\r\nx")
        assert b'"stopping":false' in said(port, WHO)
        began = time.monotonic()
        running.handle_exit(signal.SIGTERM, None)
        running._captured_signals.clear()  # it would be raised again, here in the tests' process
        assert b'"stopping":true' in said(port, WHO)
        thread.join(10.0)
        assert not thread.is_alive()
        assert time.monotonic() - began < 4.0


def test_only_trusted_proxies_speak_for_others(monkeypatch: pytest.MonkeyPatch) -> None:
    with serving(monkeypatch) as (_, port, _thread):
        assert b'"127.0.0.1","scheme":"http"' in said(port, WHO)
    with serving(monkeypatch, trusted_proxies="127.0.0.0/8") as (_, port, _thread):
        assert b'"198.51.100.7","scheme":"https"' in said(port, WHO)
