"""A built application that many tests share, each with a database, a folder, settings and a client of its own.

Building the routes and starting the job engine cost ten times what most tests ask of them. The routes are the same for
every test and are kept; everything that a test can change hangs on the context, which each test opens and closes. Jobs
run on the test's own database, in an engine that starts with the first of them; a record that nobody waits for is
analysed right after its answer. What a start does besides (taking up
what was left, delivering messages, expiry) is seen by the tests that start an application themselves.
"""

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from unittest import mock

from anyio.from_thread import BlockingPortal, start_blocking_portal
from fastapi import FastAPI
from fastapi.testclient import TestClient

import detectors.warm_up
from service.context import Context
from service.ingest.parser_pool import ParserPool
from service.jobs import engine, state
from service.running import opened
from service.settings import Settings
from service.web.app import create_app

_idle: list[tuple[FastAPI, BlockingPortal]] = []
_open = ExitStack()
_workers = ParserPool(Path(), n_workers=Settings.model_fields["parse_workers"].default)
"""Whose processes parse for every test: the limits and the folder come with each file."""


@contextmanager
def lent(settings: Settings, **options: Any) -> Iterator[TestClient]:
    """A client of an application that works with these settings while the block runs; ``options`` are the client's.

    Blocks may be nested: the inner one is lent another application.
    """
    app, portal = _idle.pop() if _idle else _built()
    context = opened(settings)
    app.state.context = context
    options.setdefault("base_url", "http://localhost")
    client = TestClient(app, raise_server_exceptions=False, **options)
    client.portal = portal
    try:
        with _workers_of_all(context.parser), _jobs_on_demand(context):
            yield client
    finally:
        client.portal = None
        client.close()
        del app.state.context
        context.close()
        _idle.append((app, portal))


def close() -> None:
    """End the threads that applications ran on."""
    _idle.clear()
    _workers.close()
    _open.close()


def _built() -> tuple[FastAPI, BlockingPortal]:
    detectors.warm_up.warm_up()
    portal = _open.enter_context(start_blocking_portal(name="lent-application"))
    return create_app(Settings()), portal


@contextmanager
def _workers_of_all(parser: ParserPool) -> Iterator[None]:
    own = parser._places
    if own.qsize() == _workers._places.qsize():
        parser._places = _workers._places
    try:
        yield
    finally:
        parser._places = own


@contextmanager
def _jobs_on_demand(context: Context) -> Iterator[None]:
    started, starting = False, threading.Lock()

    def start_and_submit(_job_id: str) -> None:
        nonlocal started
        with starting:
            # an engine on another database refuses, as it does where an application starts
            if state.running is None or state.running.url != engine.system_url(context.database.url):
                engine.start(context, upkeep=False)
                started = True
        engine.call()

    def analyse(of: Context, record_id: str) -> None:
        of.acceptance.process(record_id)

    try:
        with mock.patch.object(engine, "submit", start_and_submit), mock.patch.object(engine, "acknowledged", analyse):
            yield
    finally:
        if started:
            engine.stop()
