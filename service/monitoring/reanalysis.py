"""Reduce and fold a pump anew: for changed thresholds, for another twin, or only to see what would change."""

from dataclasses import dataclass
from typing import Any, Literal

import structlog
from sqlalchemy import Select, func, select
from sqlalchemy.orm import Session

from service.database import Database
from service.errors import Problem
from service.monitoring.archive import Archive
from service.monitoring.knowledge import knowledge
from service.monitoring.refold import REPROCESSED, Cause, refold
from service.tables import ANALYSED, Pump, Record, StoredAssessment
from service.threshold_layers import Scope

Change = Literal["thresholds_changed", "reference_curve_changed"]
"""What may have changed for all pumps of a scope."""
_MOST_CHANGES_SHOWN = 50
log = structlog.get_logger("casedrain")


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


def pumps_of(scope: Scope) -> Select[Pump]:
    """The pumps that a layer of thresholds holds for, or a pump type's curve: of one operator where it names one."""
    query = select(Pump)
    if scope.kind == "pump-type":
        query = query.where(Pump.pump_type == scope.id)
        if scope.operator is not None:
            query = query.where(Pump.operator == scope.operator)
    elif scope.kind == "operator":
        query = query.where(Pump.operator == scope.id)
    elif scope.kind == "pump":
        query = query.where(Pump.serial == scope.id, Pump.operator == scope.operator)
    return query.order_by(Pump.id)


def n_pumps(session: Session, scope: Scope) -> int:
    """Number of pumps that a layer of thresholds holds for."""
    found = pumps_of(scope).order_by(None).with_only_columns(Pump.id).subquery()
    return int(session.scalar(select(func.count()).select_from(found)) or 0)


def cause_of(change: Change, scope: Scope) -> Cause:
    """Why the pumps of a scope are folded anew."""
    return Cause(change, f"{scope.kind}/{scope.id}")


def refold_scope(database: Database, archive: Archive, scope: Scope, change: Change) -> None:
    """Fold anew every pump of a scope, one transaction per pump.

    A pump that cannot be folded now, e.g. because raw bytes are gone, keeps its verdicts and stops none of the others.
    """
    with database.reading() as session:
        pump_ids = [pump.id for pump in session.scalars(pumps_of(scope))]
    for pump_id in pump_ids:
        try:
            reprocessed(database, archive, pump_id, cause_of(change, scope))
        except Problem as problem:
            log.warning("verdicts left as they were", pump_id=pump_id, problem=problem.detail)


def reprocessed(
    database: Database,
    archive: Archive,
    pump_id: int,
    cause: Cause = REPROCESSED,
    *,
    reduce_anew: bool = False,
    dry_run: bool = False,
) -> PumpChange:
    """Fold one pump anew in one transaction and say which verdicts changed.

    Parameters
    ----------
    reduce_anew
        Read every record again from its raw bytes; otherwise only where something has changed that it depends on.
    dry_run
        The real fold, undone at its end.

    Raises
    ------
    Problem
        when a record must be read again and cannot be; nothing is changed then.
    """
    # reading a pump's whole history may take minutes: before the lock; what changes meanwhile, the fold notices
    with database.reading() as session:
        anew = knowledge(session, session.get_one(Pump, pump_id), archive, reduce_anew=reduce_anew).anew
    found: list[PumpChange] = []
    try:
        with database.writing() as session:
            pump = session.scalars(select(Pump).where(Pump.id == pump_id).with_for_update()).one()
            before = _states(session, pump_id)
            for row in session.scalars(select(Record).where(Record.id.in_(anew), Record.status == ANALYSED)):
                analysis = anew[row.id]
                row.reduction, row.residuals, row.reduced_with = analysis.reduction, analysis.residuals, analysis.key
            session.flush()
            refold(session, pump, archive, cause)
            found.append(_change(pump, before, _states(session, pump_id)))
            if dry_run:
                raise _UndoneError
    except _UndoneError:
        pass
    return found[0]


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
