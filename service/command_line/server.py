"""The server: heads that do not arrive are given up, and a stop takes no longer than it says."""

import asyncio
import os
import socket
import sys
import threading
import time
from types import FrameType
from typing import Any

import structlog
import uvicorn
from fastapi import FastAPI
from uvicorn.protocols.http.h11_impl import H11Protocol

from service.settings import Settings

_LAST_S = 8.0
"""What a stop takes at most beyond notice and drain: workers end their item, connections close. Then the process ends;
whatever it had acknowledged is in the database, as after a crash."""
_SWITCH_S = 5e-4
"""How long a thread that computes may keep the interpreter from others [s]: a read changes threads some twenty times, and
would wait ten times as long for each behind every upload that is folded by the interpreter's own interval."""
log = structlog.get_logger("casedrain")


class PatientProtocol(H11Protocol):
    """HTTP/1.1 where the head of a request must be whole within ``head_seconds`` of its first byte."""

    head_seconds = 20.0

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._late: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Await the first head."""
        super().connection_made(transport)
        self._await_head()

    def data_received(self, data: bytes) -> None:
        """Take bytes; the clock of a head runs until it is whole, however slowly it drips."""
        before = self.cycle
        super().data_received(data)
        if self.cycle is not before:
            self._forget_head()
        elif getattr(before, "response_complete", True) and self._late is None:
            self._await_head()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the clock."""
        self._forget_head()
        super().connection_lost(exc)

    def _await_head(self) -> None:
        self._late = self.loop.call_later(self.head_seconds, self._give_up)

    def _forget_head(self) -> None:
        if self._late is not None:
            self._late.cancel()
            self._late = None

    def _give_up(self) -> None:
        if not self.transport.is_closing():
            self.transport.close()


class Server(uvicorn.Server):
    """Says at `/readyz` that it is about to stop, takes requests for as long as a notice lasts, then drains and ends."""

    def __init__(self, app: FastAPI, settings: Settings, host: str, port: int) -> None:
        protocol = type("_Protocol", (PatientProtocol,), {"head_seconds": settings.body_stall_seconds})
        super().__init__(
            uvicorn.Config(
                app,
                host=host,
                port=port,
                http=protocol,
                ws="none",
                access_log=False,
                server_header=False,
                proxy_headers=bool(settings.proxies),
                forwarded_allow_ips=settings.proxies,
                timeout_graceful_shutdown=max(1, round(settings.drain_seconds)),
            )
        )
        self._app, self._settings = app, settings
        sys.setswitchinterval(_SWITCH_S)
        self._ends_at: float | None = None

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Begin to stop; a second signal shortens the notice."""
        notice = self._settings.drain_notice_seconds
        if self._ends_at is None and not self.should_exit:
            self._app.state.is_stopping = True
            self._ends_at = time.monotonic() + notice
            last = threading.Timer(notice + self._settings.drain_seconds + _LAST_S, _end)
            last.daemon = True
            last.start()
            if notice > 0.0:
                self._captured_signals.append(sig)
                return
        super().handle_exit(sig, frame)

    async def on_tick(self, counter: int) -> bool:
        """Stop when the notice is over."""
        if self._ends_at is not None and time.monotonic() >= self._ends_at:
            self.should_exit = True
        return await super().on_tick(counter)


def bound_socket(host: str, port: int) -> socket.socket:
    """A socket on an address, before anything else is started.

    Raises
    ------
    OSError
        when somebody listens there, or nobody may.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    found = socket.socket(family)
    try:
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        found.bind((host, port))
        found.listen(2048)
    except (OSError, OverflowError):
        found.close()
        raise
    found.set_inheritable(False)
    return found


def _end() -> None:
    log.warning("what was in hand is left to the next start")
    os._exit(0)
