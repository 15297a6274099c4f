"""Fold anew what a change of thresholds touches; windows are found again from the raw bytes where they may differ."""

import structlog
from sqlalchemy import Select, select

from service.database import Database
from service.errors import Problem
from service.ingest.decode import Limits
from service.monitoring.archive import Archive
from service.monitoring.refold import Cause, refold
from service.raw_store import RawStore
from service.settings import Settings
from service.tables import Pump
from service.threshold_layers import Scope

log = structlog.get_logger()


def refold_scope(database: Database, raw_store: RawStore, settings: Settings, scope: Scope) -> None:
    """Reduce and fold anew every pump that a layer of thresholds holds for, one transaction per pump.

    A pump that cannot be folded now, e.g. because raw bytes are gone, keeps its verdicts and stops none of the others.
    """
    with database.reading() as session:
        pump_ids = [pump.id for pump in session.scalars(pumps_of(scope))]
    archive = Archive(raw_store, Limits(settings.max_inflated_bytes, settings.max_rows))
    for pump_id in pump_ids:
        try:
            with database.writing() as session:
                pump = session.scalars(select(Pump).where(Pump.id == pump_id).with_for_update()).one()
                refold(session, pump, archive, Cause("thresholds_changed", f"{scope.kind}/{scope.id}"))
        except Problem as problem:
            log.warning("verdicts left as they were", pump_id=pump_id, problem=problem.detail)


def pumps_of(scope: Scope) -> Select[Pump]:
    """The pumps that a layer of thresholds holds for."""
    query = select(Pump)
    if scope.kind == "pump-type":
        query = query.where(Pump.pump_type == scope.id)
    elif scope.kind == "operator":
        query = query.where(Pump.operator == scope.id)
    elif scope.kind == "pump":
        query = query.where(Pump.serial == scope.id, Pump.operator == scope.operator)
    return query.order_by(Pump.id)
