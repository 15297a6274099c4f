"""Histories written straight into the database: one flight a day, one letter per verdict, no signal behind them.

A capital says that the case pressure is beyond its rule on that flight.
"""

from datetime import UTC, datetime, timedelta
from typing import Any

from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from service.alarms.ledger import follow
from service.history.verdicts import empty_verdict
from service.storage.tables import ANALYSED, Pump, Record, StoredAssessment
from service.thresholds.layers import thresholds_of
from twin.pumps import pump_type

START = datetime(2026, 5, 1, 8, tzinfo=UTC)
STATES = {
    "h": ("healthy", "none"),
    "i": ("indeterminate", "unknown"),
    "p": ("pump_degradation", "pump"),
    "s": ("system_leakage", "system"),
    "b": ("insufficient_data", "unknown"),
}


def day(n: float) -> datetime:
    return START + timedelta(days=n)


def pump_of(session: Session, serial: str, operator: str) -> Pump:
    """The pump of that name, made when needed."""
    found = session.scalar(select(Pump).where(Pump.serial == serial, Pump.operator == operator))
    if found is None:
        found = Pump(operator=operator, serial=serial, pump_type="h225", confirmed=True, created_at=START)
        session.add(found)
        session.flush()
    return found


def write_history(
    session: Session, letters: str, serial: str = "P-1", operator: str = "north", aircraft: str = "F-1"
) -> Pump:
    """Make the pump's history read like ``letters``; ``.`` stands for a flight whose record does not count.

    Its records have neither bytes nor a reduction: no pump that is folded may take over from it at its ``aircraft``.
    """
    pump = pump_of(session, serial, operator)
    session.execute(delete(StoredAssessment).where(StoredAssessment.pump_id == pump.id))
    empty = empty_verdict(pump_type("h225"), thresholds_of(session, operator, serial, "h225"))
    for i, letter in enumerate(letters):
        record_id = f"{operator}-{serial}-{i}"
        if session.get(Record, record_id) is None:
            session.add(_record(pump, record_id, i, aircraft))
            session.flush()
        if letter == ".":
            continue
        state, side = STATES[letter.lower()]
        verdict: dict[str, Any] = {**empty, "state": state, "side": side, "since": day(i).isoformat()}
        if letter.isupper():
            verdict["case_pressure"] = {
                "over_reservoir_bar": 1.2, "reference_bar": 0.5, "limit_bar": 3.5, "beyond": True
            }  # fmt: skip
        session.add(
            StoredAssessment(
                record_id=record_id,
                pump_id=pump.id,
                at=day(i),
                aircraft=aircraft,
                position="LH",
                state=state,
                trend={},
                verdict=verdict,
            )
        )
    follow(session, pump, thresholds_of(session, operator, serial, "h225").values)
    return pump


def _record(pump: Pump, record_id: str, i: int, aircraft: str) -> Record:
    return Record(
        id=record_id,
        operator=pump.operator,
        pump_id=pump.id,
        aircraft=aircraft,
        position="LH",
        flight_id=f"F{i}",
        segment="",
        started_at=day(i),
        status=ANALYSED,
        request={"encoding": "", "overrides": {}},
        attributes={},
        content_hash="0" * 64,
        content_type="text/csv",
        request_hash=record_id,
        identity_hash=record_id,
        received_at=day(i),
    )
