"""Records stored with their reductions, as if their raw bytes had been read: histories without the cost of files."""

from collections.abc import Sequence

from sqlalchemy import select
from sqlalchemy.orm import Session

from detectors.words.observation import Observation
from service.context import Context
from service.history.analysis import analysis_key
from service.history.codec import reduction_to_json
from service.history.setting import Setting
from service.monitoring.refold import Cause, refold
from service.storage.tables import ANALYSED, Pump, Record
from service.thresholds.layers import thresholds_of
from tests.service.histories import pump_of
from twin.pumps import pump_type

STORED = Cause("record_received")


def store(context: Context, observations: Sequence[Observation], serial: str, operator: str) -> Pump:
    """Store records and fold their pump, as one upload would."""
    with context.database.writing() as session:
        pump = pump_of(session, serial, operator)
        key = analysis_key(pump_type("h225"), Setting(), thresholds_of(session, operator, serial, "h225"))
        session.add_all(_row(pump, o, key) for o in observations)
        session.flush()
        refold(session, pump, context.archive, STORED)
        return pump


def locked(session: Session, serial: str, operator: str) -> Pump:
    """The pump's row for a change."""
    query = select(Pump).where(Pump.serial == serial, Pump.operator == operator)
    return session.scalars(query.with_for_update()).one()


def _row(pump: Pump, observation: Observation, key: str) -> Record:
    name = f"{pump.operator}-{pump.serial}-{observation.record_id}"
    return Record(
        id=name,
        operator=pump.operator,
        pump_id=pump.id,
        aircraft=observation.aircraft,
        position=observation.position,
        flight_id=observation.flight_id,
        segment=observation.segment or "",
        started_at=observation.at,
        status=ANALYSED,
        request={"encoding": "", "overrides": {}},
        attributes={},
        content_hash="0" * 64,
        content_type="text/csv",
        request_hash=name,
        identity_hash=name,
        received_at=observation.at,
        reduced_with=key,
        reduction=reduction_to_json(observation.reduction),
    )
