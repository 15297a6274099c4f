"""Fold anew what a change of thresholds touches; windows are found again from the raw bytes where they may differ."""

from sqlalchemy import select

from service.database import Database
from service.ingest.decode import Limits
from service.monitoring.archive import Archive
from service.monitoring.refold import Cause, refold
from service.raw_store import RawStore
from service.settings import Settings
from service.tables import Pump
from service.threshold_layers import Scope


def refold_scope(database: Database, raw_store: RawStore, settings: Settings, scope: Scope) -> None:
    """Reduce and fold anew every pump that a layer of thresholds holds for, one transaction per pump."""
    query = select(Pump.id)
    if scope.kind == "pump-type":
        query = query.where(Pump.pump_type == scope.id)
    elif scope.kind == "operator":
        query = query.where(Pump.operator == scope.id)
    elif scope.kind == "pump":
        query = query.where(Pump.serial == scope.id, Pump.operator == scope.operator)
    with database.reading() as session:
        pump_ids = list(session.scalars(query.order_by(Pump.id)))
    archive = Archive(raw_store, Limits(settings.max_inflated_bytes, settings.max_rows))
    for pump_id in pump_ids:
        with database.writing() as session:
            pump = session.scalars(select(Pump).where(Pump.id == pump_id).with_for_update()).one()
            refold(session, pump, archive, Cause("thresholds_changed", f"{scope.kind}/{scope.id}"))
