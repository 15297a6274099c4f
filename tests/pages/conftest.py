"""A service with two pumps' histories and a Chromium to look at it, lent to every test of the pages."""

import shutil
import socket
from collections.abc import Iterator
from typing import Any

import pytest

from service.client import Client
from service.demo.fleet import PUMPS, pump_records
from service.demo.run import served
from service.settings import Settings

ARGUMENTS = (
    "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking", "--disable-component-update",
    "--disable-sync", "--disable-quic",
)  # fmt: skip
SCREENS = {
    "light": {"viewport": {"width": 1280, "height": 900}, "color_scheme": "light"},
    "dark": {"viewport": {"width": 1280, "height": 900}, "color_scheme": "dark"},
    "tablet": {"viewport": {"width": 768, "height": 1024}, "color_scheme": "light"},
    "phone": {"viewport": {"width": 380, "height": 800}, "color_scheme": "light"},
}
FLIGHTS = 20


@pytest.fixture(scope="session")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    settings = Settings(database_url="", data_dir=tmp_path_factory.mktemp("pages"), auth="off")
    with served(settings, "127.0.0.1", port) as found:
        with Client(found) as client:
            for pump in PUMPS[:2]:
                for record in pump_records(pump, FLIGHTS, seed=1):
                    client.upload(record.content)
        yield found


@pytest.fixture(scope="session")
def names(address: str) -> dict[str, str]:
    with Client(address) as client:
        record = next(iter(client.records(pump=PUMPS[1].serial)))
        alarm = next(iter(client.alarms(pump=PUMPS[1].serial)))
    return {"worn": PUMPS[1].serial, "aircraft": PUMPS[1].aircraft, "record": record["record_id"], "alarm": alarm["id"]}


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    found = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    assert found, "make pages needs Chromium: install the package chromium"
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=found, args=list(ARGUMENTS))
        yield running
        running.close()


@pytest.fixture
def page(browser: Any, address: str) -> Iterator[Any]:
    context = browser.new_context(base_url=address, **SCREENS["light"])
    opened = context.new_page()
    opened.set_default_timeout(30_000)
    yield opened
    context.close()
