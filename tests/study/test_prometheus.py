"""Every query of the dashboard and every alert, asked of a Prometheus that scrapes what an installation says."""

import json
import shutil
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import httpx2
import pytest
from fastapi.testclient import TestClient

from service.settings import Settings
from tests.service.lent_application import lent
from tests.service.records import body
from tests.service.test_monitoring import API, DEPLOY, JSON, dashboard_queries

pytestmark = pytest.mark.study
QUIET = ("casedrain_errors_total", "casedrain_refused_total")
"""Counters that nothing has counted yet have no series."""


@pytest.fixture
def scraped(tmp_path: Path, new_database: Callable[[str], str]) -> Iterator[int]:
    """Port of what an installation says after an upload."""
    settings = Settings(database_url=new_database("sqlite"), data_dir=tmp_path / "data", auth="off")
    with lent(settings) as client:
        assert client.post(f"{API}/records", content=body(), headers=JSON).status_code == 201
        server = ThreadingHTTPServer(("127.0.0.1", 0), handler_of(client))
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield server.server_port
        server.shutdown()
        server.server_close()


def handler_of(client: TestClient) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            client.get(f"{API}/pumps")
            content = client.get("/metrics").content
            self.send_response(200)
            self.send_header("content-type", "text/plain; version=0.0.4")
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *_: Any) -> None:
            pass

    return Handler


def test_every_query_is_answered(scraped: int, tmp_path: Path) -> None:
    program = shutil.which("prometheus")
    if program is None:
        pytest.skip("PROMETHEUS-SKIPPED: install the package prometheus")
    config = {
        "global": {"scrape_interval": "1s", "evaluation_interval": "1s"},
        "rule_files": [str(DEPLOY / "prometheus" / "casedrain.rules.yml")],
        "scrape_configs": [{"job_name": "casedrain", "static_configs": [{"targets": [f"127.0.0.1:{scraped}"]}]}],
    }
    (tmp_path / "prometheus.yml").write_text(json.dumps(config))
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [program, f"--config.file={tmp_path / 'prometheus.yml'}", f"--storage.tsdb.path={tmp_path / 'tsdb'}"]
    with (tmp_path / "log").open("wb") as log:
        process = subprocess.Popen([*command, f"--web.listen-address=127.0.0.1:{port}"], stdout=log, stderr=log)
    try:
        api = f"http://127.0.0.1:{port}/api/v1"
        until(lambda: len(asked(api, "casedrain_requests_total")) > 0)
        time.sleep(4.0)
        for query in dashboard_queries():
            assert asked(api, query) or any(name in query for name in QUIET), query
        groups = httpx2.get(f"{api}/rules").json()["data"]["groups"]
        rules = [rule for group in groups for rule in group["rules"]]
        assert len(rules) == 10
        assert {rule["health"] for rule in rules} == {"ok"}
        assert [rule["name"] for rule in rules if rule["state"] == "firing"] == []
    finally:
        process.terminate()
        process.wait(20)


def asked(api: str, query: str) -> list[Any]:
    answer = httpx2.get(f"{api}/query", params={"query": query}).json()
    assert answer["status"] == "success", answer
    found: list[Any] = answer["data"]["result"]
    return found


def until(condition: Callable[[], bool]) -> None:
    for _ in range(100):
        try:
            if condition():
                return
        except (httpx2.HTTPError, ValueError):  # it says in words that it is not ready
            pass
        time.sleep(0.3)
    raise AssertionError("Prometheus has scraped nothing")
