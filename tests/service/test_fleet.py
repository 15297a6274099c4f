"""The fleet: ranking with reasons, trends by group."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import update

from detectors.words.verdict import TREND_METRICS
from service.alarms.ledger import follow
from service.storage.tables import Record, StoredAssessment
from service.thresholds.layers import thresholds_of
from tests.service.guarded import guarded_client, key
from tests.service.histories import day, pump_of, write_history

FLEET = "/api/v1/fleet"


@pytest.fixture
def guarded(database_url: str, tmp_path: Path) -> Iterator[TestClient]:
    with guarded_client(database_url, tmp_path) as running:
        yield running


def write(client: TestClient, letters: str, **names: str) -> None:
    with client.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
        write_history(session, letters, **names)


class TestRanking:
    @pytest.fixture
    def viewer(self, guarded: TestClient) -> dict[str, str]:
        for serial, letters in (("H", "hhh"), ("I", "hhi"), ("P", "hhp"), ("B", "b"), ("C", "phh"), ("A", "hhp")):
            write(guarded, letters, serial=serial)
        write(guarded, "hhp", serial="P", operator="south")
        analyst = key(guarded, "analyst", "north")
        (alarm,) = guarded.get("/api/v1/alarms", params={"pump": "A"}, headers=analyst).json()["items"]
        guarded.post(f"/api/v1/alarms/{alarm['id']}/acknowledge", headers=analyst)
        return key(guarded, "viewer", "north")

    def test_urgent_first_with_reasons(self, guarded: TestClient, viewer: dict[str, str]) -> None:
        items = guarded.get(f"{FLEET}/ranking", headers=viewer).json()["items"]
        # named and waiting, named and acknowledged, unnamed; cleared but unseen; the rest
        assert [i["serial"] for i in items] == ["P", "A", "I", "C", "B", "H"]
        assert [i["rank"] for i in items] == [1, 2, 3, 4, 5, 6]
        assert [i["urgency"] for i in items] == ["high", "high", "medium", "high", "none", "none"]
        assert "not acknowledged" in items[0]["reasons"][-1]
        assert "active, acknowledged" in items[1]["reasons"][-1]
        assert items[-1]["reasons"] == ["nothing stands out"]
        assert "baseline" in items[4]["reasons"][0]

    def test_wear_beyond_the_limit_comes_first_and_says_so(self, guarded: TestClient, viewer: dict[str, str]) -> None:
        flow = {"mean": 1.62, "low": 1.55, "high": 1.7}
        with guarded.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
            row = session.get(StoredAssessment, "north-A-2")
            row.verdict = {**row.verdict, "estimates": {"case_flow_at_reference_lpm": flow}}
            session.flush()
            pump = pump_of(session, "A", "north")
            follow(session, pump, thresholds_of(session, "north", "A", "h225").values)
        first = guarded.get(f"{FLEET}/ranking", headers=viewer).json()["items"][0]
        assert (first["serial"], first["urgency"]) == ("A", "critical")
        assert any("1.62 L/min (1.55 to 1.70), the limit is 1.5" in r for r in first["reasons"])

    def test_pages(self, guarded: TestClient, viewer: dict[str, str]) -> None:
        seen, cursor = [], None
        while True:
            params: dict[str, Any] = {"limit": 4, **({"cursor": cursor} if cursor else {})}
            page = guarded.get(f"{FLEET}/ranking", params=params, headers=viewer).json()
            seen += [i["rank"] for i in page["items"]]
            cursor = page["next"]
            if cursor is None:
                break
        assert seen == [1, 2, 3, 4, 5, 6]
        assert guarded.get(f"{FLEET}/ranking", params={"cursor": "x"}, headers=viewer).status_code == 422


class TestTrend:
    @pytest.fixture
    def viewer(self, guarded: TestClient) -> dict[str, str]:
        for serial, operator, place in (("1", "north", "LH"), ("2", "north", "RH"), ("1", "south", "LH")):
            write(guarded, "h" * 30, serial=serial, operator=operator)
            with guarded.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
                prefix = f"{operator}-{serial}-"
                mine = StoredAssessment.record_id.startswith(prefix)
                session.execute(update(StoredAssessment).where(mine).values(position=place, aircraft=f"F-{serial}"))
                for i in range(30):
                    value = 9.0 if (i, place) == (17, "LH") else float(i % 3)
                    trend = {"case_residual_bar": {"mean": value, "low": value - 1, "high": value + 1}}
                    session.get(StoredAssessment, f"{prefix}{i}").trend = trend if i else {}
        return key(guarded, "viewer")

    def get(self, client: TestClient, who: dict[str, str], **params: Any) -> Any:
        return client.get(f"{FLEET}/trend", params={"metric": "case_residual_bar", **params}, headers=who)

    @pytest.mark.parametrize(
        ("group_by", "groups"),
        [
            ("pump_type", {"h225": 3}),
            ("operator", {"north": 2, "south": 1}),
            ("position", {"LH": 2, "RH": 1}),
            ("aircraft", {"F-1": 2, "F-2": 1}),
        ],
    )
    def test_groups(self, guarded: TestClient, viewer: dict[str, str], group_by: str, groups: dict[str, int]) -> None:
        answer = self.get(guarded, viewer, group_by=group_by).json()
        assert answer["unit"] == TREND_METRICS["case_residual_bar"]
        assert {g["group"]: g["pumps"] for g in answer["items"]} == groups
        for group in answer["items"]:
            assert len(group["items"]) == 29 * group["pumps"]
            instants = [i["at"] for i in group["items"]]
            assert instants == sorted(instants)

    def test_ages_are_bands_of_flight_hours(self, guarded: TestClient, viewer: dict[str, str]) -> None:
        """A pump passes from band to band as it flies; who does not say its hours stands apart."""
        with guarded.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
            for operator, serial, start in (("north", "1", 490.0), ("north", "2", 10.0)):
                for i in range(30):
                    session.get(Record, f"{operator}-{serial}-{i}").flight_hours = start + i
        groups = self.get(guarded, viewer, group_by="age").json()["items"]
        assert [(g["group"], g["pumps"], len(g["items"])) for g in groups] == [
            ("0 to 500 h", 2, 9 + 29),
            ("500 to 1000 h", 1, 20),
            ("unknown", 1, 29),
        ]

    def test_thinned_with_extremes_and_within_bounds(self, guarded: TestClient, viewer: dict[str, str]) -> None:
        (thin,) = self.get(guarded, viewer, points=8).json()["items"]
        assert len(thin["items"]) <= 8
        values = [i["value"] for i in thin["items"]]
        assert (min(values), max(values)) == (0.0, 9.0)
        span = {"from": day(5).isoformat(), "to": day(7).isoformat()}
        (part,) = self.get(guarded, viewer, **span).json()["items"]
        assert len(part["items"]) == 2 * 3

    def test_an_operator_sees_its_own(self, guarded: TestClient, viewer: dict[str, str]) -> None:
        answer = self.get(guarded, key(guarded, "viewer", "south"), group_by="operator")
        assert [g["group"] for g in answer.json()["items"]] == ["south"]
        assert "north" not in answer.text

    def test_what_is_refused(self, guarded: TestClient, viewer: dict[str, str]) -> None:
        assert self.get(guarded, viewer, metric="mood").status_code == 422
        assert self.get(guarded, viewer, group_by="colour").status_code == 422
        assert self.get(guarded, viewer, points=1).status_code == 422
        assert self.get(guarded, viewer, **{"from": "2026-01-01T00:00:00"}).status_code == 422
