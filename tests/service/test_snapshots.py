"""Snapshots of the fold spare work and change no answer: kept few, checked by their chain, gone with their operator."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import timedelta
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select
from structlog.testing import capture_logs

from detectors.words.observation import Observation
from service.alarms.ledger import points_of
from service.context import Context
from service.history import knowledge
from service.monitoring.refold import refold
from service.monitoring.snapshots import snapshot_places, warm
from service.running import opened
from service.settings import Settings
from service.storage.tables import FoldSnapshot, MaintenanceEvent, Record, StoredAssessment
from service.web.app import create_app
from tests.detectors.fleet import FAULTS, history
from tests.service.stored_records import STORED, locked, store

OPERATOR, SERIAL = "north", "P-1"
N = 40


@pytest.fixture
def context(settings: Settings) -> Iterator[Context]:
    made = opened(settings)
    yield made
    made.close()


@pytest.fixture(scope="module")
def flights() -> Sequence[Observation]:
    return history(5, N, FAULTS["worn"]).observations


def assessments(context: Context) -> list[tuple[Any, ...]]:
    """Every stored assessment with everything that it says."""
    row = StoredAssessment
    says = (row.record_id, row.at, row.state, row.trend, row.verdict, row.chain)
    columns = (*says, row.aircraft, row.position, row.side, row.candidates, row.case_flow_lpm)
    with context.database.reading() as session:
        return [tuple(found) for found in session.execute(select(*columns).order_by(row.at, row.record_id))]


def kept(context: Context) -> dict[int, str]:
    with context.database.reading() as session:
        return {row.records: row.chain for row in session.scalars(select(FoldSnapshot))}


def again(context: Context, *, from_scratch: bool = False) -> None:
    """Fold the pump once more."""
    with context.database.writing() as session:
        refold(session, locked(session, SERIAL, OPERATOR), context.archive, STORED, from_scratch=from_scratch)


def from_scratch(context: Context) -> list[tuple[Any, ...]]:
    """Assessments of a fold that trusts nothing that is stored."""
    again(context, from_scratch=True)
    return assessments(context)


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Records whose reductions were read."""
    ids: list[str] = []
    original = knowledge._reductions

    def watched(session: Any, wanted_ids: Sequence[str]) -> dict[str, Any]:
        ids.extend(wanted_ids)
        return original(session, wanted_ids)

    monkeypatch.setattr(knowledge, "_reductions", watched)
    return ids


def test_a_history_keeps_few_snapshots_and_what_it_keeps_it_had() -> None:
    for n in range(1, 2000):
        assert len(snapshot_places(n)) <= 4 + n // 128
        assert snapshot_places(n) <= snapshot_places(n - 1) | {n}
    assert snapshot_places(0) == set()
    assert snapshot_places(1000) == {992, 976, *range(128, 1000, 128)}


def test_appending_late_and_corrected_records_read_only_what_follows(
    context: Context, flights: Sequence[Observation], read: list[str]
) -> None:
    late = flights[N - 6]
    store(context, [o for o in flights[: N - 1] if o is not late], SERIAL, OPERATOR)
    assert set(kept(context)) == snapshot_places(N - 2)
    read.clear()
    store(context, flights[N - 1 :], SERIAL, OPERATOR)
    assert len(read) == 1
    read.clear()
    store(context, [late], SERIAL, OPERATOR)
    assert len(read) == N - 32  # the snapshot behind 32 records is the newest before the place of the late one
    with context.database.writing() as session:
        last = session.get_one(Record, f"{OPERATOR}-{SERIAL}-{flights[N - 1].record_id}")
        last.reduction = {**last.reduction, "flags": ["read again"]}
    read.clear()
    again(context)
    assert read == [last.id]
    assert set(kept(context)) == snapshot_places(N)
    read.clear()
    again(context)
    assert read == []
    stored = assessments(context)
    assert len(stored) == N
    assert stored == from_scratch(context)


def test_other_chains_and_damaged_bytes_are_ignored(context: Context, flights: Sequence[Observation]) -> None:
    store(context, flights[:36], SERIAL, OPERATOR)
    warm.forget()
    with context.database.writing() as session:
        for row in session.scalars(select(FoldSnapshot)):
            if row.records == 32:
                row.content = row.content[:-1] + bytes([row.content[-1] ^ 1])
            else:
                row.chain = "0" * 64
    with capture_logs() as logs:
        store(context, flights[36:37], SERIAL, OPERATOR)
    (line,) = [entry for entry in logs if entry["event"] == "snapshot ignored"]
    assert (line["log_level"], line["records"]) == ("warning", 32)
    stored = assessments(context)
    assert set(kept(context)) == snapshot_places(37)
    assert stored == from_scratch(context)


def test_whatever_comes_before_a_snapshot_ends_it(context: Context, flights: Sequence[Observation]) -> None:
    """Maintenance that is entered late and taken back again: also what was true before must be found anew."""
    store(context, flights[:20], SERIAL, OPERATOR)
    plain, links = assessments(context), kept(context)
    with context.database.writing() as session:
        pump = locked(session, SERIAL, OPERATOR)
        entry = MaintenanceEvent(
            id="m-1",
            pump_id=pump.id,
            recorded_at=flights[19].at,
            author="somebody",
            at=flights[10].at - timedelta(minutes=1),
            action="setting_adjusted",
            note="",
        )
        session.add(entry)
    again(context)
    adjusted = assessments(context)
    assert adjusted[:10] == plain[:10]
    assert all(a[5] != b[5] for a, b in zip(adjusted[10:], plain[10:], strict=True))
    assert adjusted == from_scratch(context)
    with context.database.writing() as session:
        session.get_one(MaintenanceEvent, entry.row_id).withdrawn_at = flights[19].at
    again(context)
    assert assessments(context) == plain
    assert kept(context) == links


def test_histories_older_than_snapshots_are_taken_over(context: Context, flights: Sequence[Observation]) -> None:
    """After the migration rows have neither outlines nor links; the next fold gives them both."""
    store(context, flights[:20], SERIAL, OPERATOR)
    warm.forget()
    stored = assessments(context)
    with context.database.writing() as session:
        points = points_of(session, locked(session, SERIAL, OPERATOR).id)
        for row in session.scalars(select(FoldSnapshot)):
            session.delete(row)
        for record in session.scalars(select(Record)):
            record.reduction_digest = record.has_zero_flow = record.has_spectrum = None
        for assessment in session.scalars(select(StoredAssessment)):
            assessment.chain = assessment.side = assessment.candidates = assessment.case_flow_lpm = None
        session.flush()
        assert points_of(session, locked(session, SERIAL, OPERATOR).id) == points
    again(context)
    assert assessments(context) == stored
    assert set(kept(context)) == snapshot_places(20) != set()


@pytest.mark.study
def test_snapshots_survive_a_restart_and_go_with_their_operator(
    settings: Settings, flights: Sequence[Observation], read: list[str]
) -> None:
    with TestClient(create_app(settings), base_url="http://localhost") as client:
        before = client.app.state.context  # type: ignore[attr-defined]
        store(before, flights[:20], SERIAL, OPERATOR)
        store(before, [replace(o, aircraft="G-1") for o in flights[:17]], SERIAL, "south")
    warm.forget()
    with TestClient(create_app(settings), base_url="http://localhost") as client:
        after = client.app.state.context  # type: ignore[attr-defined]
        read.clear()
        store(after, flights[20:21], SERIAL, OPERATOR)
        assert len(read) == 21 - 16
        url = f"/api/v1/operators/{OPERATOR}"
        gone = client.request("DELETE", url, params={"reason": "they left", "confirm": OPERATOR})
        assert gone.status_code == 200, gone.text
        assert gone.json()["receipt"]["rows"]["fold_snapshots"] == len(snapshot_places(21)) == 1
        assert set(kept(after)) == snapshot_places(17)
