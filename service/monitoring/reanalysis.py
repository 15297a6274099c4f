"""Reduce and fold a pump anew: for changed thresholds, for another twin, or only to see what would change."""

from dataclasses import dataclass
from typing import Any

from sqlalchemy import Select, select
from sqlalchemy.orm import Session

from service.database import Database
from service.monitoring.acceptance import Acceptance
from service.monitoring.analysis import RecordAnalysis, analysed, refold, thresholds_of
from service.tables import ANALYSED, Pump, Record, StoredAssessment
from service.threshold_layers import Scope

_WINDOW_KEYS = ("window_", "pump_off_")
_MOST_CHANGES_SHOWN = 50


@dataclass(frozen=True, slots=True)
class PumpChange:
    """What became of a pump's verdicts: ``changes`` names the records whose state differs, in event order."""

    serial: str
    operator: str
    n_records: int
    n_changed: int
    changes: tuple[dict[str, Any], ...]
    before: str | None
    after: str | None

    def to_json(self) -> dict[str, Any]:
        """As a job's item shows it."""
        return {
            "pump": self.serial,
            "operator": self.operator,
            "records": self.n_records,
            "changed": self.n_changed,
            "changes": list(self.changes),
            "state_before": self.before,
            "state_after": self.after,
        }


class _UndoneError(Exception):
    """Leaves the transaction of a dry run."""


def pumps_of_scope(scope: Scope) -> Select[int]:
    """Ids of the pumps that a layer of thresholds holds for."""
    query = select(Pump.id)
    if scope.kind == "pump-type":
        query = query.where(Pump.pump_type == scope.id)
    elif scope.kind == "operator":
        query = query.where(Pump.operator == scope.id)
    elif scope.kind == "pump":
        query = query.where(Pump.serial == scope.id, Pump.operator == scope.operator)
    return query.order_by(Pump.id)


def refold_scope(database: Database, acceptance: Acceptance, scope: Scope) -> None:
    """Fold anew every pump that a layer of thresholds holds for, one transaction per pump."""
    with database.reading() as session:
        pump_ids = list(session.scalars(pumps_of_scope(scope)))
    for pump_id in pump_ids:
        reprocessed(database, acceptance, pump_id, reduce_anew=False)


def reprocessed(
    database: Database, acceptance: Acceptance, pump_id: int, *, reduce_anew: bool, dry_run: bool = False
) -> PumpChange:
    """Fold one pump anew in one transaction and say which verdicts changed.

    Parameters
    ----------
    reduce_anew
        Read every record again from its raw bytes; otherwise only where thresholds of windows are not the defaults.
    dry_run
        The real fold, undone at its end.
    """
    analyses = _analyses(database, acceptance, pump_id, reduce_anew)
    found: list[PumpChange] = []
    try:
        with database.writing() as session:
            pump = session.scalars(select(Pump).where(Pump.id == pump_id).with_for_update()).one()
            before = _states(session, pump_id)
            for record_id, analysis in analyses.items():
                row = session.get(Record, record_id)
                if row is not None and row.status == ANALYSED:
                    row.reduction, row.residuals = analysis.reduction, analysis.residuals
            session.flush()
            refold(session, pump)
            session.flush()
            found.append(_change(pump, before, _states(session, pump_id)))
            if dry_run:
                raise _UndoneError
    except _UndoneError:
        pass
    return found[0]


def _analyses(database: Database, acceptance: Acceptance, pump_id: int, reduce_anew: bool) -> dict[str, RecordAnalysis]:
    """Reductions from the raw bytes, outside any transaction: reading a pump's whole history may take minutes."""
    with database.reading() as session:
        pump = session.get_one(Pump, pump_id)
        thresholds = thresholds_of(session, pump.operator, pump.serial, pump.pump_type)
        asked_for = any(n.startswith(_WINDOW_KEYS) and o != "default" for n, o in thresholds.origin.items())
        if not (reduce_anew or asked_for):
            return {}
        rows = session.scalars(select(Record).where(Record.pump_id == pump_id, Record.status == ANALYSED)).all()
    return {
        row.id: analysed(acceptance.decoded_anew(row, pump.pump_type).recording, pump.pump_type, thresholds)
        for row in rows
    }


def _states(session: Session, pump_id: int) -> dict[str, tuple[str, str]]:
    """Instant and state by record, in event order."""
    columns = select(StoredAssessment.record_id, StoredAssessment.at, StoredAssessment.state)
    query = columns.where(StoredAssessment.pump_id == pump_id)
    query = query.order_by(StoredAssessment.at, StoredAssessment.record_id)
    return {record_id: (at.isoformat(), state) for record_id, at, state in session.execute(query)}


def _change(pump: Pump, before: dict[str, tuple[str, str]], after: dict[str, tuple[str, str]]) -> PumpChange:
    changes = [
        {"record_id": record_id, "at": at, "before": before.get(record_id, ("", None))[1], "after": state}
        for record_id, (at, state) in after.items()
        if before.get(record_id, ("", None))[1] != state
    ]
    return PumpChange(
        serial=pump.serial,
        operator=pump.operator,
        n_records=len(after),
        n_changed=len(changes),
        changes=tuple(changes[:_MOST_CHANGES_SHOWN]),
        before=next(reversed(before.values()))[1] if before else None,
        after=next(reversed(after.values()))[1] if after else None,
    )
