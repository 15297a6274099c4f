"""Fold anew what a change of thresholds touches; windows are found again from the raw bytes where they may differ."""

from sqlalchemy import select

from service.database import Database
from service.ingest.decode import Limits, decode
from service.monitoring.analysis import analysed, refold, thresholds_of
from service.raw_store import RawStore
from service.settings import Settings
from service.tables import ANALYSED, Pump, Record
from service.threshold_layers import Scope

_WINDOW_KEYS = ("window_", "pump_off_")


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
    limits = Limits(settings.max_inflated_bytes, settings.max_rows)
    for pump_id in pump_ids:
        _refold_pump(database, raw_store, limits, pump_id)


def _refold_pump(database: Database, raw_store: RawStore, limits: Limits, pump_id: int) -> None:
    with database.writing() as session:
        pump = session.scalars(select(Pump).where(Pump.id == pump_id).with_for_update()).one()
        thresholds = thresholds_of(session, pump.operator, pump.serial, pump.pump_type)
        if any(name.startswith(_WINDOW_KEYS) and origin != "default" for name, origin in thresholds.origin.items()):
            for row in session.scalars(select(Record).where(Record.pump_id == pump_id, Record.status == ANALYSED)):
                content = raw_store.get(row.content_hash)
                overrides = {"pump_type": pump.pump_type, **row.request["overrides"]}
                decoded = decode(content, row.content_type, row.request["encoding"], overrides, limits)
                analysis = analysed(decoded.recording, pump.pump_type, thresholds)
                row.reduction, row.residuals = analysis.reduction, analysis.residuals
            session.flush()
        refold(session, pump)
