"""Pumps that change places: stored verdicts are those of the chain judged at once, whatever came when."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import timedelta
from typing import Any

import pytest
from sqlalchemy import select

from detectors.judgement.succession import assess_together
from detectors.words.observation import History, Maintenance, Observation
from detectors.words.thresholds import effective
from service.context import Context
from service.history.codec import verdict_to_json
from service.monitoring.refold import refold, verdict_known_at
from service.running import opened
from service.settings import Settings
from service.storage.tables import WITHDRAWN, MaintenanceEvent, Pump, Record, StoredAssessment
from tests.detectors.fleet import CIRCUIT, PUMP, history
from tests.service.stored_records import STORED, locked, store
from twin.condition import Health

OPERATOR = "north"
N, AT = 26, 12
"""Flights of each pump, and the first one after they have changed places."""


@pytest.fixture
def context(settings: Settings) -> Iterator[Context]:
    made = opened(settings)
    yield made
    made.close()


def worn(i: int, own: Health) -> Health:
    return own._replace(slipper_leakage_scale=own.slipper_leakage_scale + 0.8 * max(i - 5, 0))


@pytest.fixture(scope="module")
def pumps() -> dict[str, tuple[Observation, ...]]:
    """P wears at A and goes to B at flight 12, Q comes from there; each flies two hours apart."""
    found = {}
    for serial, seed, fault, hours in (("P", 3, worn, 0), ("Q", 4, None, 9)):
        places = ("A", "B") if serial == "P" else ("B", "A")
        found[serial] = tuple(
            replace(o, at=o.at + timedelta(hours=hours), aircraft=places[i >= AT])
            for i, o in enumerate(history(seed, N, fault).observations)
        )
    return found


def expected(pumps: dict[str, Sequence[Observation]], entries: dict[str, tuple[Maintenance, ...]]) -> dict[str, Any]:
    """Verdicts of the chain judged at once, by record."""
    histories = [History(tuple(o), entries.get(serial, ())) for serial, o in pumps.items()]
    judged = assess_together(histories, PUMP, CIRCUIT, effective({}, PUMP))
    return {
        f"{OPERATOR}-{serial}-{a.record_id}": verdict_to_json(a.verdict, "", 0, {})  # type: ignore[typeddict-item]
        for serial, own in zip(pumps, judged, strict=True)
        for a in own.assessments
    }


def stored(context: Context) -> dict[str, Any]:
    with context.database.reading() as session:
        query = select(StoredAssessment.record_id, StoredAssessment.verdict)
        return {i: {**v, "twin_version": "", "threshold_version": 0, "software": {}} for i, v in session.execute(query)}


def links(context: Context) -> dict[str, str | None]:
    with context.database.reading() as session:
        query = select(StoredAssessment.record_id, StoredAssessment.chain)
        return {row.record_id: row.chain for row in session.execute(query)}


def test_an_exchange_is_folded_as_if_everything_had_been_known_at_once(
    context: Context, pumps: dict[str, tuple[Observation, ...]]
) -> None:
    """In the order of the flights, one pump after the other, and with what came late, was withdrawn, entered and taken back."""
    late = pumps["P"][AT - 3]
    store(context, [o for o in pumps["P"] if o is not late], "P", OPERATOR)
    store(context, pumps["Q"][:AT], "Q", OPERATOR)
    for o in pumps["Q"][AT:]:
        store(context, [o], "Q", OPERATOR)
    without = {"P": tuple(o for o in pumps["P"] if o is not late), "Q": pumps["Q"]}
    alone = expected(without, {})
    assert stored(context) == alone
    assert any(v["resolved_by"] is not None for v in alone.values())
    # a late record before the exchange: both pumps rest on it, and what lies before it is left as it was
    before = links(context)
    store(context, [late], "P", OPERATOR)
    assert stored(context) == expected(pumps, {})
    after = links(context)
    same = {i.split("-", 1)[1] for i in before if before[i] == after[i]}
    assert {f"P-{o.record_id}" for o in pumps["P"][: AT - 3]} | {f"Q-{o.record_id}" for o in pumps["Q"][:AT]} == same
    # an entry about the pump that left, on the day of the exchange
    entry = Maintenance(pumps["P"][AT - 1].at + timedelta(hours=1), "filter_changed")
    with context.database.writing() as session:
        pump = locked(session, "P", OPERATOR)
        row = MaintenanceEvent(
            id="m", pump_id=pump.id, at=entry.at, action=entry.action, note="", author="x", recorded_at=entry.at
        )
        session.add(row)
        refold(session, pump, context.archive, STORED)
    told = expected(pumps, {"P": (entry,)})
    assert stored(context) == told
    assert told != expected(pumps, {})
    # withdrawn again, as an answer to an earlier instant still knows
    with context.database.writing() as session:
        pump = locked(session, "P", OPERATOR)
        record = session.get_one(Record, f"{OPERATOR}-P-{late.record_id}")
        record.status, record.ended_at = WITHDRAWN, pumps["Q"][-1].at + timedelta(days=9)
        refold(session, pump, context.archive, STORED)
    assert stored(context) == expected(without, {"P": (entry,)})
    with context.database.reading() as session:
        pump = session.scalars(select(Pump).where(Pump.serial == "Q")).one()
        then = verdict_known_at(session, pump, context.archive, pumps["Q"][-1].at + timedelta(days=1), None)
    last = told[f"{OPERATOR}-Q-{pumps['Q'][-1].record_id}"]
    assert {**then, "twin_version": "", "threshold_version": 0, "software": {}, "crossing": None} == last
