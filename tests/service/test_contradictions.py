"""Records that contradict one another: refused where it is clear, else a remark that every verdict on them carries."""

import itertools
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient

from service.history.contradictions import (
    COPIED_ELSEWHERE,
    HOURS_BACKWARDS,
    HOURS_TOO_FAST,
    PLACE_TAKEN,
    SILENCE,
    Said,
    contradicted,
    names_alike,
    remarks_on,
)
from service.history.traits import traits_of
from service.ingest.decode import Limits, decode
from service.settings import Settings
from tests.service.lent_application import lent
from tests.service.records import body, document
from twin.pumps import PUMP_TYPES
from twin.recording import Recording

START = datetime(2026, 5, 2, 7, tzinfo=UTC)
JSON = {"content-type": "application/json"}


def said(n: int, **changes: Any) -> Said:
    """The n-th flight of a pump, two hours every day."""
    at = START + timedelta(days=n)
    whole = Said(f"r{n}", "P-1", f"F{n}", "", "A", "LH", at, at + timedelta(hours=2), 2.0 * n, f"samples {n}", 1)
    return replace(whole, **changes)


def remarks(*own: Said, elsewhere: dict[str, list[str]] | None = None) -> dict[str, list[str]]:
    """Remarks, which are the same in whatever order the records are given."""
    found = [remarks_on(order, elsewhere or {}, ()) for order in itertools.islice(itertools.permutations(own), 24)]
    assert all(f == found[0] for f in found)
    return found[0]


class TestRemarks:
    def test_a_good_history_has_none(self) -> None:
        assert remarks(*map(said, range(4))) == {}
        burst = said(1, record_id="b", segment="burst-1", samples_hash="b", until=START + timedelta(days=1, seconds=2))
        assert remarks(said(0), said(1), burst) == {}
        assert remarks(*(said(n, hours=None, until=None, samples_hash=None) for n in range(4))) == {}

    def test_copies_name_the_first_flight(self) -> None:
        copies = [said(n, samples_hash="one") for n in range(4)]
        found = remarks(*copies)
        assert set(found) == {"r1", "r2", "r3"}
        assert all("samples of flight F0 again" in words for (words,) in found.values())

    def test_two_flights_at_once(self) -> None:
        late = START + timedelta(hours=1)
        for changes, words in (
            ({}, "two flights at the same time"),
            ({"aircraft": "B"}, "on A and B at the same time"),
            ({"position": "RH"}, "at LH and RH of A at the same time"),
        ):
            again = said(1, at=late, until=late + timedelta(hours=2), hours=0.0, **changes)
            assert remarks(said(0), again) == {"r1": [words]}
        # the next flight begins while the recorder of the first still runs, by clocks that differ
        touching = said(1, at=START + timedelta(hours=2, seconds=-30), hours=2.0)
        assert remarks(said(0), touching) == {}
        within = said(1, at=late, until=late + timedelta(seconds=20), hours=0.0)
        assert remarks(said(0), within) == {"r1": ["two flights at the same time"]}

    def test_what_other_pumps_say_stands_beside_it(self) -> None:
        found = remarks(said(0), said(1, samples_hash="samples 0"), elsewhere={"r1": [PLACE_TAKEN]})
        assert len(found["r1"]) == 2
        assert PLACE_TAKEN in found["r1"]

    def test_hours_against_dates(self) -> None:
        assert remarks(said(0), said(1, hours=-0.5)) == {}
        assert remarks(said(0, hours=60.0), said(1)) == {"r1": [HOURS_BACKWARDS]}
        assert remarks(said(0), said(1, hours=60.0)) == {"r1": [HOURS_TOO_FAST]}
        assert remarks(said(0), said(3 * 365), said(9 * 365)) == {"r3285": [SILENCE]}

    def test_names_in_two_spellings(self) -> None:
        assert names_alike([said(0), said(1)]) == []
        own = [said(0, aircraft="F-HCAA"), said(1, aircraft="f‑hcaa"), said(2, aircraft="F-HCAB", position="RH")]
        (words,) = names_alike(own)
        assert words.startswith("aircraft F-HCAA and f‑hcaa look alike")


def test_a_record_from_a_lost_clock_contradicts_the_next_one_by_date() -> None:
    flights = [said(n) for n in range(30)]
    lost = said(-9000, hours=60.0)
    assert contradicted(lost, None, flights[0], ())
    assert contradicted(said(5, hours=60.0), flights[4], flights[6], ())
    late = said(5, hours=10.0)
    assert not contradicted(late, flights[4], flights[6], ())
    assert not contradicted(said(5, hours=14.0), flights[4], flights[6], ()), "hours of the end of a flight"
    # hours counted anew after flight 9: a late one from before belongs there
    again = said(10, hours=0.0)
    assert not contradicted(said(9, hours=500.0), said(8, hours=498.0), again, ())
    assert not contradicted(lost, None, flights[0], [START - timedelta(days=1)]), "overhauled in between"


def test_samples_are_the_same_whatever_holds_them() -> None:
    channels = {name: np.array(v, float) for name, v in document()["channels"].items()}
    pump = PUMP_TYPES["h225"]
    plain = traits_of(Recording(dict(channels)), pump)
    single = {name: v.astype(np.float32).astype(float) for name, v in channels.items()}
    shifted = {**channels, "time_s": channels["time_s"] + 5.0, "reservoir_pressure_bar": channels["time_s"]}
    psi = {**channels, "case_pressure_bar": channels["case_pressure_bar"] * 14.503774 / 14.503774}
    for same in (single, shifted, psi):
        assert traits_of(Recording(same), pump).samples_hash == plain.samples_hash
    other = {**channels, "case_pressure_bar": channels["case_pressure_bar"] + 0.001}
    assert traits_of(Recording(other), pump).samples_hash != plain.samples_hash
    text = decode(body(), "application/json", "", {}, Limits(10_000_000, 100_000)).recording
    assert traits_of(text, pump).samples_hash == plain.samples_hash


def flight(n: int, **changes: Any) -> dict[str, Any]:
    """The n-th flight, with noise of its own."""
    noise = np.random.default_rng(n).normal(0.0, 0.003, 160)
    found = document(case_pressure_bar=list(np.where(np.arange(160) >= 40, 0.9, 0.5) + noise))
    at = START + timedelta(days=n)
    return {**found, "flight_id": f"F{n}", "started_at": at.isoformat(), "flight_hours": 100.0 + 2.0 * n, **changes}


def post(client: TestClient, content: dict[str, Any]) -> Any:
    return client.post("/api/v1/records", content=body(content), headers=JSON)


def flags(client: TestClient, serial: str) -> list[str]:
    found: list[str] = client.get(f"/api/v1/pumps/{serial}/verdict").json()["quality"]["flags"]
    return found


def test_a_lost_clock_is_refused_and_changes_nothing(client: TestClient) -> None:
    first = post(client, flight(0)).json()["record_id"]
    for n in range(1, 3):
        assert post(client, flight(n)).status_code == 201
    before = client.get("/api/v1/pumps/P-1/verdict").json()
    for year, where in ((1980, "started_at"), (2019, "flight_hours")):
        lost = post(client, flight(30, started_at=f"{year}-01-06T00:00:00Z"))
        assert lost.status_code == 422, lost.text
        (fault,) = lost.json()["errors"]
        assert fault["where"] == where
        assert "recorder's clock" in fault["problem"] or first in fault["problem"]
    assert client.get("/api/v1/pumps/P-1/verdict").json() == before
    # hours counted anew, in order: stored, and said
    assert post(client, flight(40, flight_hours=0.0)).status_code == 201
    assert f"{HOURS_BACKWARDS} (1 record)" in flags(client, "P-1")
    # a correct late upload has consistent hours
    assert post(client, flight(20)).status_code == 201


@pytest.mark.postgres_in_study
def test_contradictions_are_said_in_any_order_of_arrival(settings: Settings, tmp_path: Any, new_database: Any) -> None:
    """One flight twice, and two pumps in one place at one time."""
    records = [
        flight(0),
        {**flight(0), "flight_id": "copy", "started_at": flight(1)["started_at"]},
        flight(0, pump_serial="P-2", aircraft="F-2", flight_id="of another pump"),
        {**flight(5), "pump_serial": "P-3", "started_at": flight(0)["started_at"]},
    ]
    kind = "sqlite" if settings.database_url.startswith("sqlite") else "postgres"
    seen = []
    for order in ((0, 1, 2, 3), (3, 2, 1, 0)):
        own = settings.model_copy(update={"database_url": new_database(kind), "data_dir": tmp_path / f"{order[0]}"})
        with lent(own) as client:
            ids = {i: post(client, records[i]).json()["record_id"] for i in order}
            seen.append({serial: flags(client, serial) for serial in ("P-1", "P-2", "P-3")})
            if order[0] == 3:
                answer = client.request("DELETE", f"/api/v1/records/{ids[0]}", params={"reason": "wrong pump"})
                assert answer.status_code == 200, answer.text
                assert flags(client, "P-3") == [], "the other pump forgets it too"
    assert seen[0] == seen[1]
    one = " ".join(seen[0]["P-1"])
    assert "the samples of flight F1 again" in one or "the samples of flight F0 again" in one
    assert f"{COPIED_ELSEWHERE} (2 records)" in seen[0]["P-1"]
    assert f"{PLACE_TAKEN} (1 record)" in seen[0]["P-1"]
    assert seen[0]["P-2"] == [f"{COPIED_ELSEWHERE} (1 record)"]
    assert seen[0]["P-3"] == [f"{PLACE_TAKEN} (1 record)"]


def test_a_serial_that_looks_like_another_is_pointed_out_to_both(client: TestClient) -> None:
    assert post(client, flight(0, pump_serial="SN-1")).status_code == 201
    made = client.post("/api/v1/pumps", json={"serial": "sn–01"})
    assert made.status_code == 201, made.text
    (alike,) = made.json()["looks_like"]
    assert alike["name"] == "SN-1"
    assert alike["since"].endswith("Z")
    assert flags(client, "SN-1") == ["pump sn–01 looks like this one: the same pump twice?"]
    assert "looks_like" not in client.post("/api/v1/pumps", json={"serial": "SN-2"}).json()
    aircraft = client.post("/api/v1/aircraft", json={"aircraft": "f 1"}).json()
    assert [a["name"] for a in aircraft["looks_like"]] == ["F-1"]
