"""Thresholds in layers: order across layers, restore, preview against apply, windows found again."""

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from detectors.words.thresholds import KEYS
from service.access.security import EVERYBODY
from service.context import Context
from service.demo.fleet import DemoRecord
from service.running import opened
from service.settings import Settings
from service.thresholds.layers import LIMITS, Scope, effective_thresholds, pump_scopes
from service.thresholds.layers import put as put_version
from tests.service.finished_job import finished
from tests.service.guarded import guarded_client, key
from tests.service.lent_application import lent

URL = "/api/v1/thresholds"
CSV = {"content-type": "text/csv"}


def put(client: TestClient, where: str, values: dict[str, float], if_match: str = "*", **headers: str) -> Any:
    body = {"values": values, "reason": "test"}
    return client.put(f"{URL}/{where}", json=body, headers={"If-Match": if_match, **headers})


def upload(client: TestClient, records: Sequence[DemoRecord]) -> str:
    for record in records:
        assert client.post("/api/v1/records", content=record.content, headers=CSV).status_code == 201
    return records[0].pump.serial


def living(client: TestClient) -> list[dict[str, Any]]:
    items = client.get("/api/v1/alarms").json()["items"]
    names = ("onset_at", "raised_at", "cleared_at")
    return [{n: a[n] for n in names} for a in reversed(items) if a["state"] != "withdrawn"]


def typed(client: TestClient, name: str, who: dict[str, str] | None = None, **limits: float) -> None:
    """A pump type like the h225 with other limits."""
    changes = {
        f"limits.{limit}": {"value": value, "unit": "L/min" if limit.endswith("lpm") else "bar", "source": "a sheet"}
        for limit, value in limits.items()
    }
    made = client.post("/api/v1/pump-types", json={"id": name, "base": "h225", "changes": changes}, headers=who or {})
    assert made.status_code == 201, made.text


class TestLayers:
    def test_levels_must_be_in_order_where_layers_meet(self, client: TestClient) -> None:
        assert put(client, "fleet/default", {"alarm_off_log_odds": 3.0}).status_code == 200
        low = put(client, "operator/north", {"alarm_on_log_odds": 2.0})
        assert low.status_code == 422
        (fault,) = low.json()["errors"]
        assert fault["where"] == "values.alarm_off_log_odds"
        assert "3 lies above alarm_on_log_odds = 2" in fault["problem"]
        assert "fleet/default with operator/north" in fault["problem"]
        assert put(client, "operator/north", {"alarm_on_log_odds": 3.5}).status_code == 200
        high = put(client, "fleet/default", {"alarm_off_log_odds": 3.8}, '"1"')
        assert high.status_code == 422
        assert put(client, "pump-type/h225", {"alarm_off_log_odds": 3.6}).status_code == 422
        assert client.get(f"{URL}/operator/north").status_code == 200

    def test_a_pump_types_own_limits_lie_under_every_layer(self, client: TestClient) -> None:
        typed(client, "strict", case_flow_lpm=1.2, case_pressure_limit_bar=2.0)
        client.post("/api/v1/pumps", json={"serial": "P-1", "pump_type": "strict"})
        flow, pressure = "case_flow_limit_lpm", "case_pressure_limit_bar"
        own = {"value": 1.2, "unit": "L/min", "from": "pump-type limits"}

        def held(where: str = "pump/P-1", name: str = flow) -> dict[str, Any]:
            found: dict[str, Any] = client.get(f"{URL}/{where}").json()["values"][name]
            return found

        assert held() == held("pump-type/strict") == own
        assert held(name=pressure) == {"value": 2.0, "unit": "bar", "from": "pump-type limits"}
        assert held(name="baseline_records")["from"] == "default"
        # where there is no pump there is no limit of its type
        for where in ("fleet/default", "operator/default"):
            assert (held(where)["value"], held(where)["from"]) == (1.5, "default")
        assert client.get("/api/v1/pumps/P-1/forecast").json()["limit"] == 1.2
        put(client, "fleet/default", {flow: 1.4})
        assert held() == {"value": 1.4, "unit": "L/min", "from": "fleet/default"}
        assert held(name=pressure)["value"] == 2.0
        answer = put(client, "pump/P-1", {flow: 1.1, pressure: 3.0}).json()["values"]
        assert answer[flow] == {"value": 1.1, "unit": "L/min", "from": "pump/P-1"}
        assert answer[pressure]["from"] == "pump/P-1"
        put(client, "pump/P-1", {}, '"2"')
        put(client, "fleet/default", {}, '"1"')
        assert held() == own

    def test_a_types_limit_may_lie_outside_what_can_be_set(self, client: TestClient) -> None:
        """A larger pump leaks more than any threshold of ours could say: its own limit is a fact, no setting."""
        typed(client, "large", case_flow_lpm=32.0)
        values = client.get(f"{URL}/pump-type/large").json()["values"]
        assert (values["case_flow_limit_lpm"]["value"], values["case_flow_limit_lpm"]["from"]) == (32.0, LIMITS)
        # the base's own, as nobody has said another
        assert (values["case_pressure_limit_bar"]["value"], values["case_pressure_limit_bar"]["from"]) == (
            3.5,
            LIMITS,
        )
        assert put(client, "pump-type/large", {"case_flow_limit_lpm": 32.0}).status_code == 422
        assert put(client, "pump-type/large", {"alarm_records": 4}).status_code == 200

    def test_every_operators_type_of_a_name_has_its_own_limits(self, database_url: str, tmp_path: Path) -> None:
        with guarded_client(database_url, tmp_path) as client:
            for operator, limit in (("north", 1.2), ("south", 1.3)):
                engineer = key(client, "engineer", operator)
                typed(client, "ours", engineer, case_flow_lpm=limit)
                client.post("/api/v1/pumps", json={"serial": "P-1", "pump_type": "ours"}, headers=engineer)
                for where in ("pump/P-1", "pump-type/ours"):
                    values = client.get(f"{URL}/{where}", headers=engineer).json()["values"]
                    assert values["case_flow_limit_lpm"]["value"] == limit

    def test_not_a_number_is_no_threshold(self, client: TestClient) -> None:
        content = b'{"values": {"alarm_records": NaN}, "reason": "x"}'
        headers = {"If-Match": "*", "content-type": "application/json"}
        assert client.put(f"{URL}/fleet/default", content=content, headers=headers).status_code == 422

    def test_versions_and_restore(self, client: TestClient) -> None:
        put(client, "fleet/default", {"alarm_records": 4})
        put(client, "operator/north", {"alarm_records": 5})
        put(client, "fleet/default", {"alarm_records": 6}, '"1"')
        items = client.get(f"{URL}/fleet/default/versions").json()["items"]
        assert [(v["version"], v["values"]["alarm_records"]) for v in items] == [(3, 6), (1, 4)]
        assert {v["author"] for v in items} == {"local"}
        restore = f"{URL}/fleet/default/versions/1/restore"
        assert client.post(restore, headers={"If-Match": '"1"'}).status_code == 412
        back = client.post(restore, json={"reason": "too few alarms"}, headers={"If-Match": '"3"'})
        assert back.status_code == 200
        assert back.headers["etag"] == '"4"'
        assert back.json()["own"] == {"alarm_records": 4}
        newest = client.get(f"{URL}/fleet/default/versions").json()["items"][0]
        assert (newest["version"], newest["reason"]) == (4, "too few alarms")
        assert client.post(restore).json()["version"] == 5
        for wrong in ("operator/north/versions/1", "fleet/default/versions/99"):
            assert client.post(f"{URL}/{wrong}/restore").status_code == 404
        assert client.post(restore, json={"mood": 1}).status_code == 422
        assert client.post(f"{URL}/fleet/default/versions/x/restore").status_code == 422

    def test_changes_at_the_same_moment_take_numbers_of_their_own(self, client: TestClient) -> None:
        with ThreadPoolExecutor(6) as pool:
            answers = list(pool.map(lambda i: put(client, f"operator/o{i}", {"alarm_records": 4}), range(12)))
        assert {a.status_code for a in answers} == {200}
        assert sorted(a.json()["version"] for a in answers) == list(range(1, 13))

    def test_of_two_changes_on_one_version_one_wins(self, client: TestClient) -> None:
        with ThreadPoolExecutor(4) as pool:
            statuses = list(
                pool.map(lambda i: put(client, "fleet/default", {"alarm_records": 4}).status_code, range(4))
            )
        assert sorted(statuses) == [200, 412, 412, 412]

    def test_every_change_is_in_the_audit_log(self, database_url: str, tmp_path: Path) -> None:
        with guarded_client(database_url, tmp_path) as client:
            engineer = key(client, "engineer", "north", owner="eva")
            put(client, "operator/north", {"alarm_records": 4}, **engineer)
            put(client, "operator/north", {"alarm_records": 5}, '"1"', **engineer)
            client.post(f"{URL}/operator/north/versions/1/restore", headers=engineer)
            entries = client.get("/api/v1/audit", headers=key(client, "admin", "north")).json()["items"]
        assert [e["details"]["version"] for e in entries] == [3, 2, 1]
        assert entries[1]["details"]["before"] == {"alarm_records": 4}
        assert {(e["actor"], e["subject"]) for e in entries} == {("eva", "thresholds/operator/north")}


def versions_of(context: Context, *layers: Scope) -> None:
    """Versions 1 to n, one per layer in this order; each asks for as many records as its number plus ten."""
    for number, scope in enumerate(layers, 1):
        with context.database.writing() as session:
            assert (
                put_version(session, scope, {"alarm_records": 10.0 + number}, "test", EVERYBODY, "*").number == number
            )


class TestOrderOfLayers:
    FLEET, KIND = Scope("fleet", "default"), Scope("pump-type", "h225")
    OPERATOR, PUMP = Scope("operator", "north"), Scope("pump", "P-1", "north")

    @pytest.fixture
    def context(self, settings: Settings) -> Iterator[Context]:
        made = opened(settings)
        yield made
        made.close()

    @pytest.mark.parametrize(
        "layers",
        [(FLEET, KIND, OPERATOR, PUMP), (PUMP, OPERATOR, KIND, FLEET)],
        ids=["widest first", "narrowest first"],
    )
    def test_the_narrower_layer_wins_whichever_was_written_last(
        self, context: Context, layers: Sequence[Scope]
    ) -> None:
        """Fleet, pump type, operator, pump: each is narrower than the one before, whatever the versions' numbers."""
        versions_of(context, *layers)
        narrowing = (self.FLEET, self.KIND, self.OPERATOR, self.PUMP)
        assert pump_scopes("north", "P-1", "h225") == narrowing
        with context.database.reading() as session:
            for n in range(1, 5):
                # the layers that stand above the narrowest of these have no say
                found = effective_thresholds(session, pump_scopes("north", "P-1", "h225")[:n])
                narrowest = narrowing[n - 1]
                assert found.values["alarm_records"] == 11 + layers.index(narrowest)
                assert found.origin["alarm_records"] == f"{narrowest.kind}/{narrowest.id}"
                assert found.version == 1 + max(layers.index(scope) for scope in narrowing[:n])

    def test_up_to_a_version_holds_that_version(self, context: Context) -> None:
        """One counter for the whole service: what stood when version n was the newest."""
        versions_of(context, self.FLEET, self.OPERATOR, self.PUMP)
        scopes = pump_scopes("north", "P-1", "h225")
        with context.database.reading() as session:
            found = [effective_thresholds(session, scopes, up_to=n) for n in range(4)]
        assert [f.version for f in found] == [0, 1, 2, 3]
        default = next(k.default for k in KEYS if k.name == "alarm_records")
        assert [f.values["alarm_records"] for f in found] == [default, 11, 12, 13]

    def test_another_operators_pump_of_the_same_serial_has_its_own(self, context: Context) -> None:
        versions_of(context, self.PUMP)
        with context.database.reading() as session:
            assert effective_thresholds(session, pump_scopes("south", "P-1", "h225")).version == 0


class TestPreview:
    CANDIDATES = (
        {"alarm_on_log_odds": 12.0},
        {"alarm_on_delay_flights": 4},
        {"alarm_on_log_odds": 0.5, "alarm_off_log_odds": 0.4, "alarm_records": 1},
        {"baseline_records": 12},
        {"window_minimum_duration_s": 300},
    )

    @pytest.mark.parametrize("values", CANDIDATES)
    def test_it_shows_what_applying_does(
        self, worn_client: TestClient, worn_records: list[DemoRecord], values: dict[str, float]
    ) -> None:
        client, serial = worn_client, worn_records[0].pump.serial
        before = living(client)
        body = {"scope": "pump", "id": serial, "values": values}
        shown = client.post(f"{URL}/preview", json=body)
        assert shown.status_code == 200, shown.text
        assert living(client) == before, "a preview writes nothing"
        assert client.get(f"{URL}/pump/{serial}").json()["version"] == 0
        assert put(client, f"pump/{serial}", values).status_code == 200
        after = living(client)
        totals = shown.json()["totals"]
        assert (totals["alarms_now"], totals["alarms_with_candidate"]) == (len(before), len(after))
        for item in shown.json()["items"]:
            first = item["first_alarm"]
            assert first["now"] == (before[0]["raised_at"] if before else None)
            assert first["with_candidate"] == (after[0]["raised_at"] if after else None)
            if first["earlier_by_days"] is not None:
                assert (first["earlier_by_days"] > 0) == (first["earlier_by_flights"] > 0)
            kept = [{n: a[n] for n in after[0]} for a in item["gained"]] if after else []
            assert all(a in after for a in kept)

    def test_windows_are_found_again_and_back(self, client: TestClient, worn_records: list[DemoRecord]) -> None:
        serial = upload(client, worn_records[:10])
        pump = f"/api/v1/pumps/{serial}/verdict"
        before = client.get(pump).json()["quality"]
        put(client, f"pump/{serial}", {"window_minimum_duration_s": 600})
        assert client.get(pump).json()["quality"]["records_used"] == 0
        # without a key of its own the layer falls back to the default: the windows must come back
        put(client, f"pump/{serial}", {}, '"1"')
        assert client.get(pump).json()["quality"] == before

    def test_findings_tell_false_from_missed(self, worn_client: TestClient, worn_records: list[DemoRecord]) -> None:
        client, serial = worn_client, worn_records[0].pump.serial
        raised = worn_records[-1].started_at
        for at, found in (
            (raised, "pump_degradation"),
            (worn_records[2].started_at - timedelta(days=1), "no_fault_found"),
        ):
            finding = {"at": at.isoformat(), "found": found}
            assert client.post(f"/api/v1/pumps/{serial}/findings", json=finding).status_code == 201
        body = {"scope": "pump", "id": serial, "values": {"alarm_on_delay_flights": 20}}
        totals = client.post(f"{URL}/preview", json=body).json()["totals"]
        counts = totals["findings"]
        assert (counts["missed_now"], counts["missed_with_candidate"]) == (0, 1)
        assert (counts["false_now"], counts["false_with_candidate"]) == (0, 0)

    def test_bad_candidates_are_refused_as_by_put(self, client: TestClient) -> None:
        body = {"scope": "fleet", "id": "default", "values": {"mood": 1, "alarm_records": 0, "alarm_off_log_odds": 9}}
        answer = client.post(f"{URL}/preview", json=body)
        assert answer.status_code == 422
        assert {e["where"] for e in answer.json()["errors"]} == {
            "values.mood",
            "values.alarm_records",
            "values.alarm_off_log_odds",
        }
        for bad in ({"scope": "planet"}, {"reason": "x"}):
            assert client.post(f"{URL}/preview", json={**body, **bad}).status_code == 422
        assert client.post(f"{URL}/preview", json={**body, "id": "other"}).status_code == 404
        nobody = {"scope": "pump", "id": "nobody", "values": {}}
        assert client.post(f"{URL}/preview", json=nobody).status_code == 404

    def test_the_work_is_bounded(self, database_url: str, tmp_path: Path, healthy_records: list[DemoRecord]) -> None:
        settings = Settings(database_url=database_url, data_dir=tmp_path, auth="off", max_preview_records=2)
        with lent(settings) as client:
            serial = upload(client, healthy_records[:3])
            body = {"scope": "fleet", "id": "default", "values": {"alarm_records": 5}}
            answer = client.post(f"{URL}/preview", json=body)
            assert answer.status_code == 202
            assert answer.json()["kind"] == "preview"
            job = finished(client, answer.json()["id"])
            assert client.get(f"{URL}/fleet/default").json()["own"] == {}, "a preview writes nothing"
        assert (job["status"], [item["pump_serial"] for item in job["items"]]) == ("succeeded", [serial])
        assert job["result"]["totals"]["alarms_now"] == 0

    def test_others_are_neither_shown_nor_counted(
        self, database_url: str, tmp_path: Path, healthy_records: list[DemoRecord]
    ) -> None:
        with guarded_client(database_url, tmp_path, max_preview_records=2) as client:
            north, south = key(client, "analyst", "north"), key(client, "analyst", "south")
            for record in healthy_records[:3]:
                params = {"operator": "north"}
                sent = client.post("/api/v1/records", content=record.content, headers={**CSV, **north}, params=params)
                assert sent.status_code == 201
            body = {"scope": "fleet", "id": "default", "values": {}}
            assert client.post(f"{URL}/preview", json=body, headers=north).status_code == 202
            answer = client.post(f"{URL}/preview", json=body, headers=south).json()
            assert (answer["items"], answer["cost"]["records"], answer["cost"]["pumps"]) == ([], 0, 0)
            viewer = key(client, "viewer", "north")
            assert client.post(f"{URL}/preview", json=body, headers=viewer).status_code == 403
