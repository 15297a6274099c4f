"""The dashboard for Grafana: every query of it runs over the views and says what the API says."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import text

from tests.service.guarded import guarded_client, key
from tests.service.histories import write_history

DASHBOARD = Path(__file__).parents[2] / "docs" / "examples" / "grafana-fleet.json"
pytestmark = pytest.mark.parametrize("database_url", ["postgres"], indirect=True)


@pytest.fixture
def guarded(database_url: str, tmp_path: Path) -> Iterator[TestClient]:
    with guarded_client(database_url, tmp_path) as running:
        with running.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
            for serial, letters in (
                ("P-1", "hhi"),
                ("P-2", "hhppp"),
                ("P-3", "hhsss"),
                ("P-4", "hhPhhhhh"),
                ("P-5", "hh"),
            ):
                write_history(session, letters, serial=serial)
            write_history(session, "hhppp", serial="P-2", operator="south")
            session.execute(
                text(
                    """update assessments set trend = '{"case_flow_at_reference_lpm": {"mean": 1.1, "low": 1, "high": 1.2}}'"""
                )
            )
        yield running


def queries(node: Any) -> Iterator[str]:
    """Every query in the dashboard, wherever it stands."""
    if isinstance(node, dict):
        if "rawSql" in node:
            yield node["rawSql"]
        elif node.get("type") == "query":
            yield node["query"]
        for value in node.values():
            yield from queries(value)
    elif isinstance(node, list):
        for value in node:
            yield from queries(value)


def as_grafana_asks(sql: str) -> str:
    """With its macros and variables filled in."""
    sql = re.sub(r"\$__timeFilter\((\w+)\)", r"\1 between '2026-05-01T00:00:00Z' and '2026-06-01T00:00:00Z'", sql)
    values = {"operator": "'north'", "pump": "'P-1','P-2'", "metric": "'case_flow_at_reference_lpm'"}
    sql = re.sub(r"\$\{(\w+):sqlstring\}", lambda m: values[m[1]], sql)
    assert "$" not in sql, sql
    return sql


def test_every_query_runs_and_says_what_the_api_says(guarded: TestClient) -> None:
    held = list(queries(json.loads(DASHBOARD.read_text(encoding="utf-8"))))
    assert len(held) == 6 + 3 + 1
    found: list[list[dict[str, Any]]] = []
    with guarded.app.state.context.database.reading() as session:  # type: ignore[attr-defined]
        for sql in held:
            rows = [dict(r) for r in session.execute(text(as_grafana_asks(sql).replace(":", "\\:"))).mappings()]
            assert rows, sql
            found.append(rows)
    by_columns = {tuple(rows[0]): rows for rows in found}
    who = key(guarded, "viewer", "north")
    summary = guarded.get("/api/v1/fleet/summary", headers=who).json()
    states = next(rows for columns, rows in by_columns.items() if columns == ("state", "pumps"))
    assert {r["state"]: r["pumps"] for r in states} == summary["by_state"]
    attention = next(rows for columns, rows in by_columns.items() if "advice" in columns)
    ranking = guarded.get("/api/v1/fleet/ranking", headers=who).json()["items"]
    asking = {p["serial"]: (p["state"], p["urgency"]) for p in ranking if p["urgency"] != "none"}
    assert {r["pump"]: (r["state"], r["alarm_priority"]) for r in attention} == asking
    assert attention[0]["alarm_priority"] == "critical"
    alarms = guarded.get("/api/v1/alarms?state=open", headers=who).json()["items"]
    shown = next(rows for columns, rows in by_columns.items() if "work_order" in columns)
    assert [r["pump"] for r in shown] == [a["pump_serial"] for a in alarms]
    trend = next(rows for columns, rows in by_columns.items() if columns == ("time", "value", "low", "high"))
    assert len(trend) == 3 + 5
