"""What a preview of thresholds says of a fleet's alarms is what the fleet shows once they are published."""

import itertools
from datetime import datetime
from typing import Any

import pytest
from fastapi.testclient import TestClient
from hypothesis import HealthCheck, Phase, example, given, settings
from hypothesis import strategies as st

from tests.detectors.fleet import FAULTS, history
from tests.service.stored_records import store

API = "/api/v1"
N_FLIGHTS = 36
_fleets = itertools.count(1)
SHOWN = ("onset_at", "raised_at", "cleared_at", "verdict_state", "priority")

candidates = st.fixed_dictionaries(
    {},
    optional={
        "baseline_records": st.integers(3, 20),
        "alarm_on_log_odds": st.floats(1.5, 30.0),
        "alarm_off_log_odds": st.floats(-5.0, 1.0),
        "alarm_records": st.integers(1, 10),
        "side_records": st.integers(1, 20),
        "side_probability": st.floats(0.5, 0.999),
        "case_flow_limit_lpm": st.floats(0.6, 2.0),
        "alarm_on_delay_flights": st.integers(1, 6),
        "alarm_off_delay_flights": st.integers(1, 6),
        "sensor_shift_bar": st.floats(0.01, 0.2),
    },
)
pumps = st.tuples(st.integers(0, 50), st.sampled_from((None, *FAULTS)))


def alarms(client: TestClient, of: dict[str, str]) -> dict[str, list[dict[str, Any]]]:
    """Living alarms of a fleet by pump, as its list shows them, oldest first."""
    found: dict[str, list[dict[str, Any]]] = {}
    for row in client.get(f"{API}/alarms", params={**of, "limit": 500}).json()["items"]:
        if row["state"] != "withdrawn":
            found.setdefault(row["pump_serial"], []).insert(0, {name: row[name] for name in SHOWN})
    return found


def meet(a: dict[str, Any], b: dict[str, Any]) -> bool:
    """True when two alarms share an instant."""

    def starts_within(a: dict[str, Any], b: dict[str, Any]) -> bool:
        start, end = datetime.fromisoformat(a["onset_at"]), b["cleared_at"]
        return datetime.fromisoformat(b["onset_at"]) <= start and (end is None or start <= datetime.fromisoformat(end))

    return starts_within(a, b) or starts_within(b, a)


@pytest.mark.study
def test_preview_is_apply(client: TestClient) -> None:
    context = client.app.state.context  # type: ignore[attr-defined]
    moved: list[str] = []

    @settings(
        max_examples=5 if context.database.is_sqlite else 3,
        phases=(Phase.explicit, Phase.generate),  # shrinking takes minutes, a failure shows its fleet
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(fleet=st.lists(pumps, min_size=1, max_size=2), first=candidates, values=candidates, whole=st.booleans())
    @example(fleet=[(3, "worn")], first={}, values={"alarm_on_log_odds": 29.0, "alarm_records": 8}, whole=False)
    def holds(
        fleet: list[tuple[int, str | None]], first: dict[str, float], values: dict[str, float], whole: bool
    ) -> None:
        operator = f"op-{next(_fleets)}"
        of = {"operator": operator}
        for i, (seed, fault) in enumerate(fleet):
            seen = history(seed, N_FLIGHTS, FAULTS[fault] if fault else None)
            store(context, seen.observations, f"P-{i}", operator)
        scope, name = ("operator", operator) if whole else ("pump", "P-0")
        url, more = f"{API}/thresholds/{scope}/{name}", {} if whole else of
        put = {"values": first, "reason": "where the fleet stands"}
        assert client.put(url, json=put, params=more, headers={"If-Match": "*"}).status_code == 200
        before = alarms(client, of)
        body = {"scope": scope, "id": name, "values": values, **more}
        said = client.post(f"{API}/thresholds/preview", json=body)
        assert said.status_code == 200, said.text
        assert alarms(client, of) == before
        tag = client.get(url, params=more).headers["etag"]
        put = {"values": values, "reason": "what was previewed"}
        assert client.put(url, json=put, params=more, headers={"If-Match": tag}).status_code == 200
        after = alarms(client, of)
        items = {item["pump_serial"]: item for item in said.json()["items"]}
        for serial in (f"P-{i}" for i in range(len(fleet))):
            old, new = before.get(serial, []), after.get(serial, [])
            if serial not in items:
                assert new == old
                continue
            item = items[serial]
            moved.append(f"{old} -> {new}")
            assert (item["alarms_now"], item["alarms_with_candidate"]) == (len(old), len(new))
            assert item["gained"] == [a for a in new if not any(meet(a, b) for b in old)]
            assert item["lost"] == [a for a in old if not any(meet(a, b) for b in new)]
            assert item["first_alarm"]["with_candidate"] == (new[0]["raised_at"] if new else None)
        touched = after if whole else {"P-0": after.get("P-0", [])}
        assert said.json()["totals"]["alarms_with_candidate"] == sum(map(len, touched.values()))

    holds()
    assert moved  # else nothing was compared
