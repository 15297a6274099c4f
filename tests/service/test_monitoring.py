"""What an installation says of itself: metrics that are true and bounded, lines of the log, traces, alerts that ring."""

import json
import os
import re
import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from opentelemetry import trace
from opentelemetry.sdk.trace import TracerProvider
from opentelemetry.sdk.trace.export import SimpleSpanProcessor
from opentelemetry.sdk.trace.export.in_memory_span_exporter import InMemorySpanExporter
from opentelemetry.util._once import Once
from prometheus_client.parser import text_string_to_metric_families
from structlog.contextvars import merge_contextvars
from structlog.testing import capture_logs

from service.settings import Settings
from service.web import metrics, traces
from service.web.app import create_app
from tests.service.guarded import guarded_client, key
from tests.service.records import body

API = "/api/v1"
JSON = {"content-type": "application/json"}
DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
TRACE, SPAN = "4bf92f3577b34da6a3ce929d0e0e4736", "00f067aa0ba902b7"


@pytest.fixture(autouse=True)
def _asked_anew() -> Iterator[None]:
    metrics._kept.clear()
    yield
    metrics._kept.clear()


def scraped(client: TestClient) -> dict[tuple[str, str], float]:
    """Samples by name and the value of the last label."""
    metrics._kept.clear()
    families = text_string_to_metric_families(client.get("/metrics").text)
    return {(s.name, [*s.labels.values(), ""][0]): s.value for family in families for s in family.samples}


def test_metrics_say_what_waits(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    before = scraped(client)
    assert before["casedrain_backlog_records", ""] == before["casedrain_backlog_age_seconds", ""] == 0.0
    context = client.app.state.context  # type: ignore[attr-defined]
    with monkeypatch.context() as patch:
        patch.setattr(type(context.acceptance), "process", lambda *_: None)
        client.post(f"{API}/records?wait=false", content=body(), headers=JSON)
    waiting = scraped(client)
    assert waiting["casedrain_backlog_records", ""] == 1.0
    assert waiting["casedrain_backlog_age_seconds", ""] > 0.0
    context.acceptance.process(context.acceptance.pending()[0])
    client.post(f"{API}/records", content=b"{}", headers=JSON)
    with monkeypatch.context() as patch:
        patch.setattr("service.jobs.engine.submit", lambda _job_id: None)
        client.post(f"{API}/jobs", json={"kind": "reprocess"})
    after = scraped(client)
    assert after["casedrain_backlog_records", ""] == 0.0
    assert after["casedrain_jobs", "queued"] == 1.0
    assert after["casedrain_jobs_age_seconds", ""] > 0.0
    assert after["casedrain_pumps", "insufficient_data"] == 1.0
    assert after["casedrain_database_up", ""] == 1.0
    assert after["casedrain_requests_in_hand", ""] == 0.0  # whoever looks is not counted
    assert 0.0 < after["casedrain_disk_free_bytes", "raw"] < after["casedrain_disk_bytes", "raw"]
    for name in ("casedrain_refusals_total", "casedrain_fold_seconds_count", "casedrain_parse_seconds_count"):
        assert after[name, ""] > before[name, ""], name


def test_metrics_are_asked_seldom_and_outlive_the_database(client: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    scraped(client)
    context = client.app.state.context  # type: ignore[attr-defined]

    def away(*_: Any) -> Any:
        raise ConnectionError("made to fail")

    monkeypatch.setattr(type(context.database), "reading", away)
    assert "casedrain_database_up 1.0" in client.get("/metrics").text  # what was asked a moment ago
    text = scraped(client)
    assert text["casedrain_database_up", ""] == 0.0
    assert ("casedrain_backlog_records", "") not in text


def test_every_line_says_who_asked_and_in_whose_trace(database_url: str, tmp_path: Path) -> None:
    with guarded_client(database_url, tmp_path) as client, capture_logs(processors=[merge_contextvars]) as lines:
        asker = key(client, "viewer", "north", "hums-office")
        client.get(f"{API}/pumps", headers={**asker, "traceparent": f"00-{TRACE}-{SPAN}-01"})
        for wrong in (f"ff-{TRACE}-{SPAN}-01", f"00-{'0' * 32}-{SPAN}-01", "00-1-2-3", "x" * 9000):
            client.get(f"{API}/pumps", headers={**asker, "traceparent": wrong})
        client.get(f"{API}/pumps")
    found = [line for line in lines if line["event"] == "request"]
    first = found[0]
    assert (first["principal"], first["operator"], first["route"]) == ("hums-office", "north", f"{API}/pumps")
    assert (first["trace_id"], first["parent_span_id"]) == (TRACE, SPAN)
    assert len(first["request_id"]) == 12
    assert all("trace_id" not in line for line in found[1:])
    assert (found[-1]["principal"], found[-1]["status"]) == (None, 401)


def test_a_request_is_a_span_with_parsing_and_folding_below(
    new_database: Callable[[str], str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = InMemorySpanExporter()
    provider = TracerProvider()
    provider.add_span_processor(SimpleSpanProcessor(kept))
    monkeypatch.setattr(trace, "_TRACER_PROVIDER", None)
    monkeypatch.setattr(trace, "_TRACER_PROVIDER_SET_ONCE", Once())
    monkeypatch.setattr(traces, "_provider", lambda _settings: provider)
    for tracer in ("service.ingest.parser_pool._tracer", "service.monitoring.folded._tracer"):
        monkeypatch.setattr(tracer, provider.get_tracer("casedrain"))
    settings = Settings(database_url=new_database("sqlite"), data_dir=tmp_path / "data", auth="off", traces="otlp")
    with TestClient(create_app(settings), base_url="http://localhost") as client:
        headers = {**JSON, "traceparent": f"00-{TRACE}-{SPAN}-01"}
        answer = client.post(f"{API}/records", content=body(), headers=headers)
        assert answer.status_code == 201
        client.get("/healthz")
    spans = {span.name: span for span in kept.get_finished_spans() if span.context.trace_id == int(TRACE, 16)}
    assert {"parse", "fold", f"POST {API}/records"} <= set(spans)
    request = spans[f"POST {API}/records"]
    assert request.parent is not None
    assert request.parent.span_id == int(SPAN, 16)
    assert request.attributes is not None
    assert request.attributes["casedrain.request_id"] == answer.headers["x-request-id"]
    for name in ("parse", "fold"):
        parent = spans[name].parent
        assert parent is not None
        assert parent.span_id == request.context.span_id
    assert not any("healthz" in span.name for span in kept.get_finished_spans())


def dashboard_queries() -> list[str]:
    document = json.loads((DEPLOY / "grafana" / "casedrain.json").read_text())
    ids = [panel["id"] for panel in document["panels"]]
    assert len(ids) == len(set(ids))
    return [target["expr"] for panel in document["panels"] for target in panel["targets"]]


def test_what_alerts_and_dashboard_ask_for_is_there(client: TestClient) -> None:
    client.post(f"{API}/records", content=body(), headers=JSON)
    names = {name for name, _ in scraped(client)}
    # counters with labels that nothing has counted yet have a family and no sample
    names |= {f"{m}_total" for m in ("casedrain_errors", "casedrain_refused")}
    rules = (DEPLOY / "prometheus" / "casedrain.rules.yml").read_text()
    asked = set(
        re.findall(r"casedrain_\w+", " ".join([*re.findall(r"expr: (?:>-\n)?(.*)", rules), *dashboard_queries()]))
    )
    assert asked
    assert asked <= names, asked - names
    guide = (DEPLOY.parent / "docs" / "operations.md").read_text()
    for alert in re.findall(r"alert: (\w+)", rules):
        assert f"`{alert}`" in guide, alert


def test_alerts_ring_when_they_should_and_every_query_is_one(tmp_path: Path) -> None:
    promtool = shutil.which("promtool")
    if promtool is None:
        reason = "PROMTOOL-SKIPPED: install the package prometheus"
        (pytest.fail if os.environ.get("REQUIRE_PROMTOOL") else pytest.skip)(reason)
    tested = [promtool, "test", "rules", str(DEPLOY / "prometheus" / "casedrain.rules.test.yml")]
    result = subprocess.run(tested, capture_output=True, text=True, check=False, timeout=60)
    assert result.returncode == 0, result.stdout + result.stderr
    rows = [{"record": f"query:{i}", "expr": expr} for i, expr in enumerate(dashboard_queries())]
    rules = tmp_path / "dashboard.yml"
    rules.write_text(json.dumps({"groups": [{"name": "dashboard", "rules": rows}]}))
    checked = subprocess.run(
        [promtool, "check", "rules", str(rules)], capture_output=True, text=True, check=False, timeout=60
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr
