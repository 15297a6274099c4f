"""However a history came about, its alarms are those of the history as it stands, and nothing said before is lost."""

from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import delete, insert, select
from sqlalchemy.orm import Session

from service.alarms.ledger import actions_of, catch_up, points_of
from service.alarms.life_cycle import lives, rules_of
from service.storage.database import Database
from service.storage.tables import Alarm, AlarmAction, Message, Pump, StoredAssessment, Webhook
from service.thresholds.layers import thresholds_of
from tests.service.histories import day, write_history

WEBHOOK = {
    "id": "w", "operator": None, "url": "https://hooks.example.org", "events": ["alarm.raised"], "secret": "whsec_eA==",
    "owner": "ann", "created_at": day(0), "ended_at": None, "end_reason": None,
}  # fmt: skip


@pytest.fixture
def database(database_url: str, tmp_path: Path) -> Iterator[Database]:
    opened = Database(database_url)
    yield opened
    opened.close()


def acted(session: Session, pump: Pump, kind: str, n: int) -> None:
    """Somebody does something about the newest living alarm."""
    query = select(Alarm).where(Alarm.pump_id == pump.id, Alarm.withdrawn_at.is_(None)).order_by(Alarm.onset_at.desc())
    row = session.scalars(query).first()
    if row is not None:
        session.add(
            AlarmAction(
                alarm_id=row.id,
                pump_id=pump.id,
                kind=kind,
                by="ann",
                reason="because",
                until=day(99) if kind == "shelve" else None,
                onset_at=row.onset_at,
                seen_at=max(p.at for p in points_of(session, pump.id)),
                seen_state=row.verdict_state,
                seen_priority=row.priority,
                done_at=day(50) + timedelta(minutes=n),
            )
        )


def test_what_the_ledger_keeps_of_case_pressure(database: Database) -> None:
    """Assessments as rows repeat them and as whole verdicts say them; rows from before the rule know nothing of it."""
    with database.writing() as session:
        session.execute(insert(Webhook), [WEBHOOK])
        pump = write_history(session, "hhH")
        said = [p.case_pressure_beyond for p in points_of(session, pump.id)]
        assert said == [False, False, True]
        (alarm,) = session.scalars(select(Alarm))
        assert (alarm.priority, alarm.side, alarm.verdict_state) == ("critical", "unknown", "healthy")
        (message,) = session.scalars(select(Message))
        assert message.event == "alarm.raised"
        assert message.payload["data"]["case_pressure_beyond"] is True
        for row in session.scalars(select(StoredAssessment)):
            row.side = None
        assert [p.case_pressure_beyond for p in points_of(session, pump.id)] == said
        write_history(session, "hhHhh")
        assert (alarm.condition, alarm.case_pressure_beyond) == ("cleared", True)
        for row in session.scalars(select(StoredAssessment)):
            row.verdict = {name: value for name, value in row.verdict.items() if name != "case_pressure"}
        session.flush()
        assert not any(p.case_pressure_beyond for p in points_of(session, pump.id))


def test_alarms_of_case_pressure_catch_up(database: Database) -> None:
    with database.writing() as session:
        write_history(session, "hhH")
        session.execute(delete(Alarm))
    assert catch_up(database) == 1
    with database.reading() as session:
        assert session.scalars(select(Alarm.priority)).all() == ["critical"]


STEPS = st.lists(
    st.tuples(
        st.text("hips.bHP", min_size=3, max_size=12),
        st.sampled_from([None, "acknowledge", "shelve", "unshelve", "close"]),
    ),
    min_size=1,
    max_size=5,
)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(STEPS)
@pytest.mark.postgres_in_study
def test_any_way_to_a_history(database: Database, steps: list[tuple[str, str | None]]) -> None:
    with database.writing() as session:
        for table in (AlarmAction, Alarm):
            session.execute(delete(table))
        known: set[str] = set()
        for n, (letters, kind) in enumerate(steps):
            pump = write_history(session, letters)
            if kind is not None and any(c != "." for c in letters):
                acted(session, pump, kind, n)
            pump = write_history(session, letters)
            rows = session.scalars(select(Alarm).order_by(Alarm.onset_at)).all()
            assert known <= {row.id for row in rows}, "an alarm once told of stays, if only as withdrawn"
            known = {row.id for row in rows}
            thresholds = thresholds_of(session, "north", "P-1", "h225").values
            expected = lives(points_of(session, pump.id), actions_of(session, pump.id), rules_of(thresholds))
            living = [row for row in rows if row.withdrawn_at is None]
            assert [(r.onset_at, r.raised_at, r.cleared_at, r.acknowledged, r.priority) for r in living] == [
                (a.onset_at, a.raised_at, a.cleared_at, a.acknowledged, a.priority) for a in expected
            ]
            assert [(r.side, r.case_pressure_beyond) for r in living] == [
                (a.side, a.case_pressure_beyond) for a in expected
            ]
            assert [(r.shelved_until, r.closed_at) for r in living] == [
                (a.shelved_until, a.closed_at) for a in expected
            ]
            assert all(row.cause for row in rows if row.withdrawn_at is not None)
