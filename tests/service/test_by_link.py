"""What is kept of a fleet is what would be read anew: after any change of any history, in this process or another one."""

from collections import OrderedDict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select, update

from service.reading import fleet_trend, forecast, pump_history, standing
from service.reading.by_link import ByLink
from service.storage.tables import Pump, StoredAssessment
from service.web.dashboard import fleet as fleet_page
from service.web.dashboard import pages, trends
from tests.detectors.fleet import history
from tests.service.guarded import guarded_client, key
from tests.service.histories import write_history
from tests.service.stored_records import store
from tests.service.test_page_forms import come_in
from tests.service.test_statements import statements

API = "/api/v1"
KEPT = (
    *((standing, "_kept"), (fleet_trend, "_kept"), (forecast, "_kept"), (fleet_page, "_kept_flows")),
    *((pages, "_kept_changes"), (trends, "_kept_newest")),
)
CALLS = (
    "/fleet/ranking",
    "/fleet/summary",
    "/fleet/trend?metric=case_flow_at_reference_lpm",
    "/fleet/trend?metric=case_zero_bar&group_by=position",
    "/fleet/trend?metric=case_residual_bar&group_by=age",
    "/pumps",
)
PARTS = (("forecast", "curve"), ("trends", "alarms"))
"""Stretches of a pump's page."""


@pytest.fixture
def guarded(database_url: str, tmp_path: Path) -> Iterator[TestClient]:
    with guarded_client(database_url, tmp_path) as running:
        context = running.app.state.context  # type: ignore[attr-defined]
        for k, serial in enumerate(("P-1", "P-2")):
            store(context, history(k + 1, 12).observations, serial, "north")
        with context.database.writing() as session:
            write_history(session, "hhpp", serial="W")
        yield running


def answers(client: TestClient, who: dict[str, str], monkeypatch: pytest.MonkeyPatch, anew: bool) -> list[Any]:
    with monkeypatch.context() as patched:
        if anew:
            for module, name in KEPT:
                patched.setattr(module, name, ByLink(10))
            patched.setattr(pump_history, "_kept", OrderedDict())
        found = [client.get(API + call, headers=who).json() for call in CALLS]
        page = client.get("/pumps/P-1?compare=both&range=all").text
    shown = [page[page.index(f'id="{first}"') : page.index(f'id="{end}"')] for first, end in PARTS]
    return [*found, *shown, client.get("/").text.count("<tr>")]


@pytest.mark.study
def test_what_is_kept_is_what_would_be_read(guarded: TestClient, monkeypatch: pytest.MonkeyPatch) -> None:
    context = guarded.app.state.context  # type: ignore[attr-defined]
    who, seen = key(guarded, "engineer", "north"), []
    come_in(guarded, "vic", "viewer", "north")
    place = {"aircraft": "F-9", "position": "RH", "from": "2020-01-01T00:00:00Z"}

    def later() -> None:
        store(context, history(1, 13).observations[12:], "P-1", "north")

    def installed() -> None:
        assert guarded.post(f"{API}/pumps/P-2/installations", json=place, headers=who).status_code == 201

    def limited() -> None:
        body = {"values": {"case_flow_limit_lpm": 1.0}, "reason": "try"}
        put = guarded.put(f"{API}/thresholds/operator/north", json=body, headers={**who, "If-Match": "*"})
        assert put.status_code == 200

    def another() -> None:
        with context.database.writing() as session:
            write_history(session, "hhpps", serial="W")

    for change in (lambda: None, later, installed, limited, another):
        change()
        for _ in range(2):
            kept = answers(guarded, who, monkeypatch, anew=False)
            assert kept == answers(guarded, who, monkeypatch, anew=True)
        seen.append(repr(kept))
    assert len(set(seen)) == len(seen), "every change shows"


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_a_fleet_is_read_in_ten_statements(guarded: TestClient) -> None:
    context = guarded.app.state.context  # type: ignore[attr-defined]
    who = key(guarded, "viewer", "north")
    with context.database.writing() as session:
        for k in range(12):
            write_history(session, "hhp", serial=f"Q-{k}")
        session.execute(update(StoredAssessment).where(StoredAssessment.chain.is_(None)).values(chain="link"))
    for call in CALLS[:3]:
        guarded.get(API + call, headers=who)
        with statements() as asked:
            assert guarded.get(API + call, headers=who).status_code == 200
        assert len(asked) <= 10, (call, asked)
        assert not any("verdict" in text.split("FROM")[0] for text in asked), call


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_no_more_is_kept_than_was_asked(guarded: TestClient) -> None:
    kept: ByLink[str] = ByLink(2)
    read: list[int] = []

    def values(pump_ids: list[int]) -> dict[int, str]:
        read.extend(pump_ids)
        return {i: f"of {i}" for i in pump_ids}

    with guarded.app.state.context.database.reading() as session:  # type: ignore[attr-defined]
        pumps = list(session.scalars(select(Pump).order_by(Pump.id)))
        for what in ("a", "a", "b", "a"):
            assert kept.of(session, pumps, values, what) == {1: "of 1", 2: "of 2", 3: "of 3"}
    # the third pump has no link and is read every time; a second question pushed the first out
    assert read.count(3) == 4
    assert (read.count(1), read.count(2)) == (3, 3)
