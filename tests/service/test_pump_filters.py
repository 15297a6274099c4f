"""Filters of the list of pumps: each is the list of all with those left out that do not fit."""

from datetime import UTC, datetime
from pathlib import Path
from typing import get_args

import pytest

from service.answers.words import SIDES, STATES
from service.web.routes.pumps import SideName, StateName
from tests.service.guarded import guarded_client, key
from tests.service.histories import day, write_history

API = "/api/v1"


def test_the_words_are_those_of_the_answers() -> None:
    assert (set(get_args(StateName)), set(get_args(SideName))) == (set(STATES), set(SIDES))


def test_each_filter_takes_what_fits(database_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    letters = {"P-1": "hhi", "P-2": "hhppp", "P-3": "hhsss", "P-4": "hhPhhhhh", "P-5": "hhhhhhhhhhhh", "P-6": "b"}
    with guarded_client(database_url, tmp_path) as guarded:
        with guarded.app.state.context.database.writing() as session:  # type: ignore[attr-defined]
            for serial, history in letters.items():
                write_history(session, history, serial=serial)
            write_history(session, "hhppp", serial="P-2", operator="south")
        engineer = key(guarded, "engineer", "north")
        assert guarded.post(f"{API}/pumps", json={"serial": "P-7"}, headers=engineer).status_code == 201

        class Clock(datetime):
            @classmethod
            def now(cls, tz: object = None) -> datetime:  # type: ignore[override]
                return day(20).astimezone(UTC)

        monkeypatch.setattr("service.web.routes.pumps.datetime", Clock)
        monkeypatch.setattr("service.reading.fleet.datetime", Clock)

        def listed(query: str = "") -> list[dict[str, object]]:
            found: list[dict[str, object]] = []
            cursor = ""
            while True:
                page = guarded.get(f"{API}/pumps?limit=2&{query}{cursor}", headers=engineer).json()
                found += page["items"]
                if page["next"] is None:
                    return found
                cursor = f"&cursor={page['next']}"

        everything = listed()
        assert len(everything) == 7
        for field, values in (("state", STATES), ("side", SIDES)):
            for value in values:
                assert listed(f"{field}={value}") == [p for p in everything if p[field] == value]
        assert listed("aircraft=F-1") == [p for p in everything if p["aircraft"] == "F-1"]
        assert listed("type=h225") == everything
        assert listed("type=other") == []
        for silent in (True, False):
            assert listed(f"silent={silent}") == [p for p in everything if p["silent"] is silent]
        assert {p["serial"] for p in everything if p["silent"]} == {"P-4", "P-5"}
        ranking = guarded.get(f"{API}/fleet/ranking", headers=engineer).json()["items"]
        for priority in ("none", "low", "medium", "high", "critical"):
            wanted = {p["serial"] for p in ranking if p["urgency"] == priority}
            assert {p["serial"] for p in listed(f"priority={priority}")} == wanted
        assert [p["serial"] for p in listed("state=pump_degradation&side=pump&priority=high")] == ["P-2"]
        wrong = guarded.get(f"{API}/pumps?state=broken&priority=urgent&colour=red", headers=engineer)
        assert wrong.status_code == 422
        assert {e["where"] for e in wrong.json()["errors"]} == {"query.state", "query.priority", "query.colour"}
