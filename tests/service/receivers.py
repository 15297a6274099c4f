"""Receivers on this machine: a webhook's server and a mail server, both of a few lines."""

import socketserver
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

NEVER = -1
"""A status that never comes: headers drip in as long as somebody listens."""


class Inbox:
    """What arrived, and what to answer."""

    def __init__(self) -> None:
        self.statuses: list[int] = []
        self.requests: list[tuple[str, dict[str, str], bytes]] = []
        self.mails: list[tuple[list[str], str]] = []
        self.url = ""
        self.port = 0
        self.arrived = threading.Event()
        self.closing = threading.Event()


@contextmanager
def webhook_receiver() -> Iterator[Inbox]:
    """An HTTP server that answers the statuses it is given, then 204."""
    inbox = Inbox()

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            content = self.rfile.read(int(self.headers["content-length"]))
            inbox.requests.append((self.path, {k.lower(): v for k, v in self.headers.items()}, content))
            status = inbox.statuses.pop(0) if inbox.statuses else 204
            while status == NEVER and not inbox.closing.wait(0.05):
                try:
                    self.wfile.write(b"X-More: 1\r\n" if inbox.arrived.is_set() else b"HTTP/1.1 200 OK\r\n")
                except OSError:
                    return
                inbox.arrived.set()
            if status == NEVER:
                return
            self.send_response(status)
            if status in (301, 302, 307):
                self.send_header("Location", inbox.url)
            self.send_header("Content-Length", "0")
            self.end_headers()
            inbox.arrived.set()

        def log_message(self, *_: Any) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        inbox.port = server.server_address[1]
        inbox.url = f"http://localhost:{inbox.port}/hook?from=casedrain"
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield inbox
        inbox.closing.set()
        server.shutdown()
        thread.join()


@contextmanager
def mail_server() -> Iterator[Inbox]:
    """An SMTP server that takes everything (RFC 5321's minimum)."""
    inbox = Inbox()

    class Handler(socketserver.StreamRequestHandler):
        def say(self, line: str) -> None:
            self.wfile.write(f"{line}\r\n".encode())

        def handle(self) -> None:
            self.say("220 test")
            to: list[str] = []
            while line := self.rfile.readline().decode().strip():
                word = line.upper()
                if word.startswith("RCPT TO:"):
                    to.append(line[8:].strip("<> "))
                if word == "DATA":
                    self.say("354 go on")
                    lines = []
                    while (text := self.rfile.readline().decode()) != ".\r\n":
                        lines.append(text)
                    inbox.mails.append((to, "".join(lines)))
                self.say("221 bye" if word == "QUIT" else "250 ok")
                if word == "QUIT":
                    return

    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Handler) as server:
        inbox.port = server.server_address[1]
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield inbox
        server.shutdown()
        thread.join()
