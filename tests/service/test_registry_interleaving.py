"""Any interleaving of uploads, corrections, withdrawals, entries, thresholds and restarts ends where the ordered replay
does, and what stands then is to the last bit what a fold from the first record on gives.
"""

import itertools
import json
from contextlib import ExitStack
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from fastapi.testclient import TestClient
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule, run_state_machine_as_test
from sqlalchemy import select

from detectors.words.observation import ACTIONS
from service.monitoring.refold import refold
from service.storage.tables import Pump, StoredAssessment
from service.web.app import create_app
from tests.service.records import document

JSON = {"content-type": "application/json"}
API = "/api/v1"
START = datetime(2026, 5, 2, 7, 11, tzinfo=UTC)
PLACES = (("F-1", "LH"), ("F-1", "RH"), ("F-2", "LH"))
_operators = itertools.count(1)

flights = st.integers(0, 9)
sizes = st.sampled_from((0.86, 0.9, 1.1))
places = st.sampled_from(PLACES)
instants = st.integers(0, 19)


def instant(half_days: int) -> str:
    return (START + timedelta(hours=12 * half_days - 1)).isoformat()


def content(flight: int, size: float, place: tuple[str, str]) -> dict[str, Any]:
    changed = document()
    changed["channels"]["case_pressure_bar"] = [p * size / 0.9 for p in changed["channels"]["case_pressure_bar"]]
    started_at = (START + timedelta(days=flight)).isoformat()
    return changed | {
        "flight_id": f"F{flight}",
        "started_at": started_at,
        "aircraft": place[0],
        "position": place[1],
    }


class Life:
    """One pump of an operator of its own, spoken to over the API."""

    def __init__(self, client: TestClient) -> None:
        self.client = client
        self.of = {"operator": f"op-{next(_operators)}"}
        self.pump = f"{API}/pumps/P-1"

    def upload(self, record: dict[str, Any], **more: str) -> str:
        answer = self.client.post(
            f"{API}/records", content=json.dumps(record), headers=JSON, params={**self.of, **more}
        )
        assert answer.status_code == 201, answer.text
        return str(answer.json()["record_id"])

    def post(self, what: str, body: dict[str, Any]) -> Any:
        return self.client.post(f"{self.pump}/{what}", json=body, params=self.of)

    def set_thresholds(self, values: dict[str, float]) -> None:
        url = f"{API}/thresholds/operator/{self.of['operator']}"
        tag = self.client.get(url).headers["etag"]
        answer = self.client.put(url, json={"values": values, "reason": "a trial"}, headers={"If-Match": tag})
        assert answer.status_code == 200, answer.text

    def set_circuit(self, name: str, circuit: str) -> None:
        url = f"{API}/aircraft"
        answer = self.client.patch(f"{url}/{name}", json={"circuit": circuit}, params=self.of)
        if answer.status_code == 404:
            answer = self.client.post(url, json={"aircraft": name, "circuit": circuit, **self.of})
        assert answer.status_code in (200, 201), answer.text

    def verdict(self, **more: str) -> Any:
        verdict = self.client.get(f"{self.pump}/verdict", params={**self.of, **more}).json()
        verdict.pop("threshold_version")
        return verdict

    def history(self) -> Any:
        """Every verdict and trend point, without ids and version numbers."""
        with self.client.app.state.context.database.reading() as session:  # type: ignore[attr-defined]
            known = session.scalar(select(Pump.id).where(Pump.operator == self.of["operator"]))
        if known is None:
            return None
        trend = self.client.get(f"{self.pump}/trend", params={**self.of, "metric": "case_residual_bar"}).json()
        changes = self.client.get(f"{self.pump}/verdicts", params=self.of).json()["items"]
        return (
            self.verdict(),
            [{k: v for k, v in item.items() if k != "record_id"} for item in trend["items"]],
            [(c["at"], c["verdict"]["state"], c["verdict"]["quality"]) for c in changes],
        )


class Interleaving(RuleBasedStateMachine):
    """Operations in any order against one pump; ``teardown`` replays what counts in event order."""

    def __init__(self, client: TestClient) -> None:
        super().__init__()
        self.life = Life(client)
        self.held: dict[int, tuple[str, dict[str, Any]]] = {}
        self.spent: set[tuple[int, float, tuple[str, str]]] = set()
        self.entered: dict[str, tuple[str, dict[str, Any]]] = {}
        self.thresholds: dict[str, float] = {"baseline_records": 3}
        self.circuits: dict[str, str] = {}
        self.moments: list[tuple[str, Any]] = []
        self.processes = ExitStack()
        self.restarted = False
        self.life.set_thresholds(self.thresholds)

    @initialize()
    def first_flights(self) -> None:
        """Enough records that maintenance and installations fall between some."""
        for flight in (6, 0, 8, 2, 4):
            self.upload(flight, 0.9, PLACES[0])

    def _note(self) -> None:
        self.moments.append((datetime.now(UTC).isoformat(), self.life.verdict()))

    @rule(flight=flights, size=sizes, place=places)
    def upload(self, flight: int, size: float, place: tuple[str, str]) -> None:
        if (flight, size, place) in self.spent:
            return
        self.spent.add((flight, size, place))
        record = content(flight, size, place)
        more = {"supersedes": self.held[flight][0]} if flight in self.held else {}
        self.held[flight] = (self.life.upload(record, **more), record)
        self._note()

    @precondition(lambda self: self.held)
    @rule(choice=st.integers(0, 99))
    def withdraw(self, choice: int) -> None:
        flight = sorted(self.held)[choice % len(self.held)]
        record_id, _ = self.held.pop(flight)
        answer = self.life.client.delete(f"{API}/records/{record_id}", params={"reason": "a trial"})
        assert answer.status_code == 200, answer.text
        self._note()

    @rule(place=places, start=instants, length=st.none() | st.integers(1, 8))
    def install(self, place: tuple[str, str], start: int, length: int | None) -> None:
        end = None if length is None else instant(start + length)
        body = {"aircraft": place[0], "position": place[1], "from": instant(start), "to": end}
        answer = self.life.post("installations", body)
        assert answer.status_code in (201, 409), answer.text
        if answer.status_code == 201:
            self.entered[answer.json()["id"]] = ("installations", body)
            self._note()

    @rule(at=instants, action=st.sampled_from(ACTIONS))
    def maintain(self, at: int, action: str) -> None:
        body = {"at": instant(at), "action": action}
        self.entered[self.life.post("maintenance", body).json()["id"]] = ("maintenance", body)
        self._note()

    @precondition(lambda self: self.entered)
    @rule(choice=st.integers(0, 99))
    def take_back(self, choice: int) -> None:
        entry_id = list(self.entered)[choice % len(self.entered)]
        what, _ = self.entered.pop(entry_id)
        answer = self.life.client.delete(f"{self.life.pump}/{what}/{entry_id}", params=self.life.of)
        assert answer.status_code == 204, answer.text
        self._note()

    @rule(duration=st.sampled_from((30.0, 100.0, 300.0)), side=st.sampled_from((0.9, 0.99)))
    def change_thresholds(self, duration: float, side: float) -> None:
        wanted = {"baseline_records": 3.0, "window_minimum_duration_s": duration, "side_probability": side}
        self.thresholds = wanted
        self.life.set_thresholds(wanted)
        self._note()

    @rule(place=places, circuit=st.sampled_from(("shared_return", "separate_drain")))
    def rebuild(self, place: tuple[str, str], circuit: str) -> None:
        self.circuits[place[0]] = circuit
        self.life.set_circuit(place[0], circuit)
        self._note()

    @precondition(lambda self: not self.restarted)
    @rule()
    def restart(self) -> None:
        """The service goes on in another process, as it were: nothing but the database and the bytes is left of it."""
        self.restarted = True
        settings = self.life.client.app.state.context.settings  # type: ignore[attr-defined]
        self.life.client = self.processes.enter_context(TestClient(create_app(settings), base_url="http://localhost"))

    def _from_scratch(self) -> None:
        """What is stored with the help of snapshots is what a fold that trusts nothing stores."""
        context = self.life.client.app.state.context  # type: ignore[attr-defined]
        with context.database.writing() as session:
            pump = session.scalars(select(Pump).where(Pump.operator == self.life.of["operator"])).one()
            row = StoredAssessment
            columns = (row.record_id, row.state, row.trend, row.verdict, row.chain)
            query = select(*columns).where(row.pump_id == pump.id).order_by(row.at, row.record_id)
            stored = session.execute(query).all()
            refold(session, pump, context.archive, from_scratch=True)
            session.flush()
            assert session.execute(query).all() == stored

    def teardown(self) -> None:
        with self.processes:
            self._check()

    def _check(self) -> None:
        self._from_scratch()
        replay = Life(self.life.client)
        replay.set_thresholds(self.thresholds)
        for name, circuit in self.circuits.items():
            replay.set_circuit(name, circuit)
        if self.held:
            for flight in sorted(self.held):
                replay.upload(self.held[flight][1])
            for what, body in self.entered.values():
                assert replay.post(what, body).status_code == 201
            assert self.life.history() == replay.history()
        for known_at, verdict in self.moments:
            assert self.life.verdict(known_at=known_at) == verdict


@pytest.mark.parametrize("lives", [1, pytest.param(20, marks=pytest.mark.study)])
def test_any_interleaving_is_the_ordered_replay(client: TestClient, lives: int) -> None:
    run_state_machine_as_test(
        lambda: Interleaving(client),
        settings=settings(
            max_examples=lives,
            stateful_step_count=14,
            phases=(Phase.generate,),  # a failure shows its steps; shrinking it takes minutes
            deadline=None,
            derandomize=True,
            database=None,
            suppress_health_check=list(HealthCheck),
        ),
    )
