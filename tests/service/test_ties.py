"""Records of one instant: the stored fold takes them by their names, in whatever order they came."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest
from sqlalchemy import select

from service.context import Context
from service.history.knowledge import knowledge
from service.running import opened
from service.settings import Settings
from service.storage.tables import StoredAssessment
from tests.detectors.fleet import FAULTS, history
from tests.service.stored_records import locked, store

SERIAL = "P-1"


@pytest.fixture
def context(settings: Settings) -> Iterator[Context]:
    made = opened(settings)
    yield made
    made.close()


def stored(context: Context, operator: str) -> list[tuple[str, Any, Any]]:
    """Record without its operator, trend and verdict, in the order of the fold."""
    with context.database.reading() as session:
        placed = knowledge(session, locked(session, SERIAL, operator), context.archive).known.placed
        rows = {row.record_id: row for row in session.scalars(select(StoredAssessment))}
        ids = [p.outline.record_id for p in placed]
        return [(i.removeprefix(f"{operator}-"), rows[i].trend, rows[i].verdict) for i in ids]


def test_records_of_one_instant_are_taken_by_their_names(context: Context) -> None:
    """Two operators own the same pump's history; the one's records arrive backwards."""
    found = list(history(3, 14, FAULTS["worn"]).observations)
    # an index of the table by flights would give their order by chance
    found[11], found[12] = replace(found[11], flight_id="F12"), replace(found[12], at=found[11].at, flight_id="F11")
    store(context, found, SERIAL, "north")
    store(context, found[::-1], SERIAL, "south")
    north, south = stored(context, "north"), stored(context, "south")
    assert [record for record, _, _ in north] == [f"{SERIAL}-r{i:04d}" for i in range(14)]
    assert south == north
