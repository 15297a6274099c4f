"""Fold anew what a change of thresholds touches; windows are found again from the raw bytes where they may differ."""

from collections.abc import Mapping

from sqlalchemy import Select, select

from service.database import Database
from service.ingest.decode import Limits, decode
from service.monitoring.analysis import RecordAnalysis, analysed, refold, thresholds_of
from service.raw_store import RawStore
from service.settings import Settings
from service.tables import ANALYSED, Pump, Record
from service.threshold_layers import Effective, Scope

_WINDOW_KEYS = ("window_", "pump_off_")


def refold_scope(
    database: Database, raw_store: RawStore, settings: Settings, scope: Scope, with_windows: bool = True
) -> None:
    """Fold anew every pump that a layer of thresholds holds for, one transaction per pump.

    ``with_windows`` also finds the windows of every record again.
    """
    with database.reading() as session:
        pump_ids = [pump.id for pump in session.scalars(pumps_of(scope))]
    limits = Limits(settings.max_inflated_bytes, settings.max_rows)
    for pump_id in pump_ids:
        _refold_pump(database, raw_store, limits, pump_id, with_windows)


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


def touches_windows(*values: Mapping[str, float]) -> bool:
    """True when any of these values is about finding windows."""
    return any(name.startswith(_WINDOW_KEYS) for some in values for name in some)


def window_values(values: Mapping[str, float]) -> dict[str, float]:
    """Those values that are about finding windows."""
    return {name: value for name, value in values.items() if name.startswith(_WINDOW_KEYS)}


def analysed_again(
    row: Record, pump: Pump, raw_store: RawStore, limits: Limits, thresholds: Effective
) -> RecordAnalysis:
    """Windows and residuals of a stored record with other thresholds, from its raw bytes."""
    content = raw_store.get(row.content_hash)
    overrides = {"pump_type": pump.pump_type, **row.request["overrides"]}
    decoded = decode(content, row.content_type, row.request["encoding"], overrides, limits)
    return analysed(decoded.recording, pump.pump_type, thresholds)


def _refold_pump(database: Database, raw_store: RawStore, limits: Limits, pump_id: int, with_windows: bool) -> None:
    with database.writing() as session:
        pump = session.scalars(select(Pump).where(Pump.id == pump_id).with_for_update()).one()
        if with_windows:
            thresholds = thresholds_of(session, pump.operator, pump.serial, pump.pump_type)
            for row in session.scalars(select(Record).where(Record.pump_id == pump_id, Record.status == ANALYSED)):
                analysis = analysed_again(row, pump, raw_store, limits, thresholds)
                row.reduction, row.residuals = analysis.reduction, analysis.residuals
            session.flush()
        refold(session, pump)
