"""Trends on the pump page: events, ranges, flight hours, the sibling, the fleet; the sensor's zero; the curve's picture."""

import re
from collections.abc import Iterator
from datetime import datetime, timedelta
from pathlib import Path

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select, update

from detectors.words.numbers import Z_90
from service.reading import queries
from service.storage.tables import Pump, Record, StoredAssessment
from tests.detectors.fleet import history
from tests.service.guarded import guarded_client, key
from tests.service.histories import write_history
from tests.service.stored_records import store
from tests.service.test_page_forms import come_in

API = "/api/v1"
N = 14


@pytest.fixture
def guarded(database_url: str, tmp_path: Path) -> Iterator[TestClient]:
    with guarded_client(database_url, tmp_path) as running:
        context = running.app.state.context  # type: ignore[attr-defined]
        for k, serial in enumerate(("P-1", "P-2")):
            pump = store(context, history(k + 1, N).observations, serial, "north")
            with context.database.writing() as session:
                for table in (Record, StoredAssessment):
                    where = table.pump_id == pump.id  # type: ignore[attr-defined]
                    session.execute(update(table).where(where).values(aircraft="F-1", position=("LH", "RH")[k]))
                rows = session.scalars(select(Record).where(Record.pump_id == pump.id).order_by(Record.started_at))
                for i, row in enumerate(rows):
                    row.flight_hours = 100.0 + 2.5 * i
        yield running


def zeros(client: TestClient) -> list[tuple[str, float, float]]:
    """Time, offset and one-sigma error of the measured zeros, from the reductions themselves."""
    with client.app.state.context.database.reading() as session:  # type: ignore[attr-defined]
        rows = session.scalars(select(Record).join(Pump).where(Pump.serial == "P-1").order_by(Record.started_at))
        found = [(row.started_at, row.reduction["zero"]) for row in rows]
    return [(at.isoformat(), z["offset_bar"], z["standard_deviation_bar"]) for at, z in found if z["measured"]]


def test_the_zero_has_a_trend(guarded: TestClient) -> None:
    headers, params = key(guarded, "viewer", "north"), {"metric": "case_zero_bar"}
    trend = guarded.get(f"{API}/pumps/P-1/trend", params=params, headers=headers).json()
    expected = zeros(guarded)
    assert len(expected) == N
    assert trend["unit"] == "bar"
    assert [i["value"] for i in trend["items"]] == [offset for _, offset, _ in expected]
    for item, (at, offset, error) in zip(trend["items"], expected, strict=True):
        assert datetime.fromisoformat(item["at"]) == datetime.fromisoformat(at)
        assert (item["low"], item["high"]) == pytest.approx((offset - Z_90 * error, offset + Z_90 * error))
    later = {**params, "from": expected[3][0], "to": expected[6][0]}
    part = guarded.get(f"{API}/pumps/P-1/trend", params=later, headers=headers).json()["items"]
    assert [i["value"] for i in part] == [offset for _, offset, _ in expected[3:6]]
    place = guarded.get(f"{API}/aircraft/F-1/positions/RH/trend", params=params, headers=headers)
    assert place.status_code in (200, 404)  # an aircraft that nobody registered has no page of its own
    fleet = guarded.get(f"{API}/fleet/trend", params={**params, "group_by": "position"}, headers=headers).json()
    assert {g["group"]: len(g["items"]) for g in fleet["items"]} == {"LH": N, "RH": N}
    by_age = guarded.get(f"{API}/fleet/trend", params={**params, "group_by": "age"}, headers=headers).json()
    assert sum(len(g["items"]) for g in by_age["items"]) == 2 * N


def chart(page: str, title: str) -> str:
    found = re.search(rf'<figure class="chart"[^>]*aria-label="Trend of {title}".*?</figure>', page, re.DOTALL)
    assert found, title
    return found[0]


def values_of(figure: str) -> int:
    return figure.count("<tr><td>")


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_the_page_of_trends(guarded: TestClient) -> None:
    engineer = key(guarded, "engineer", "north")
    come_in(guarded, "vic", "viewer", "north")
    starts = [datetime.fromisoformat(at) for at, _, _ in zeros(guarded)]
    middle = (starts[6] + timedelta(minutes=1)).isoformat()
    for what, body in (
        ("maintenance", {"at": middle, "action": "filter_changed", "note": "blue <one>"}),
        ("findings", {"at": middle, "found": "no_fault_found"}),
    ):
        assert guarded.post(f"{API}/pumps/P-1/{what}", json=body, headers=engineer).status_code == 201
    whole = guarded.get("/pumps/P-1?range=all").text
    zero = chart(whole, "zero of the case sensor")
    assert values_of(zero) == N
    assert zero.count('class="event maintenance"') == zero.count('class="event finding"') == 1
    assert 'class="sibling"' in zero
    assert 'class="fleet"' not in zero
    assert "Filter of the case drain changed" in whole
    assert "blue &lt;one&gt;" in whole
    assert "baseline: complete" in whole
    # a stretch shows what was flown in it, and the marks of that time
    ends = {"from": f"{starts[8]:%Y-%m-%dT%H:%M}", "to": f"{starts[11] + timedelta(minutes=1):%Y-%m-%dT%H:%M}"}
    part = chart(guarded.get("/pumps/P-1", params=ends).text, "zero of the case sensor")
    assert values_of(part) == sum(starts[8].replace(second=0) <= s < starts[11] + timedelta(minutes=1) for s in starts)
    assert "event maintenance" not in part
    # over flight hours, narrowed to some of them
    hours = guarded.get("/pumps/P-1?axis=hours&from=105&to=115&compare=none").text
    part = chart(hours, "zero of the case sensor")
    assert values_of(part) == sum(105.0 <= 100.0 + 2.5 * i <= 115.0 for i in range(N))
    assert "flight hours [h]" in part
    assert 'class="sibling"' not in part
    assert guarded.get("/pumps/P-1?axis=hours").status_code == 200
    for query, words in (
        ("axis=hours&from=soon", "is no number of flight hours"),
        ("axis=hours&from=5&to=4", "does not lie after from"),
        ("from=2026-05-02&to=2026-05-01", "does not lie after from"),
        ("range=7", "range"),
    ):
        answer = guarded.get(f"/pumps/P-1?{query}")
        assert (answer.status_code, words in answer.text) == (422, True), query
    # a stretch without a record keeps its axes, so that one can look elsewhere
    empty = guarded.get("/pumps/P-1?from=1999-01-01&to=1999-01-02").text
    assert values_of(chart(empty, "zero of the case sensor")) == 0
    with guarded.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
        for k in range(5):
            write_history(session, "hh", serial=f"Q-{k}")
    assert guarded.get("/pumps/P-1?compare=both").status_code == 200


@pytest.mark.parametrize("database_url", ["sqlite"], indirect=True)
def test_the_curve_is_drawn_anew_when_the_history_has_changed(guarded: TestClient) -> None:
    come_in(guarded, "vic", "viewer", "north")
    first = guarded.get("/pumps/P-1/curve.svg")
    assert first.headers["content-type"].startswith("image/svg+xml")
    assert "prefers-color-scheme: dark" in first.text
    assert guarded.get("/pumps/P-1/curve.svg").text == first.text
    assert guarded.get("/pumps/P-2/curve.svg").text != first.text
    context = guarded.app.state.context  # type: ignore[attr-defined]
    store(context, history(1, N + 1).observations[N:], "P-1", "north")
    assert guarded.get("/pumps/P-1/curve.svg").text != first.text
    assert guarded.get("/pumps/nobody/curve.svg").status_code == 404


@pytest.mark.parametrize("letters", ["", "h", "bbhhiippphhbh", "hhhh", "hihihi"])
def test_changes_of_verdict_are_those_of_a_loop(guarded: TestClient, letters: str) -> None:
    with guarded.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
        pump = write_history(session, letters, serial="W")
        expected: list[StoredAssessment] = []
        for row in session.scalars(queries.assessments(pump.id)):
            if not expected or expected[-1].state != row.state:
                expected.append(row)
        assert queries.verdict_changes(session, pump) == expected
