"""Reduce and fold a pump anew: for changed thresholds, for another twin, or only to see what would change."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from sqlalchemy import Select, func, select
from sqlalchemy.orm import Session

from detectors.judgement.version import twin_version
from service.alarms.comparison import gained_and_lost
from service.alarms.ledger import point_of, points_of
from service.alarms.life_cycle import Point, Rules, lives, rules_of
from service.answers import jobs as answers
from service.answers.alarms import AlarmChanges
from service.answers.jobs import VerdictDifference
from service.history.analysis import keep_analysis
from service.history.archive import Archive
from service.history.codec import verdict_to_json
from service.history.knowledge import Knowledge, knowledge
from service.identity import software
from service.monitoring.fold import fold
from service.monitoring.precedence import held_by, left_to_newer, newer_release, take_over
from service.monitoring.refold import REPROCESSED, Cause, apart
from service.monitoring.succession import with_neighbours
from service.pump_types.parameter_sets import held_type
from service.storage.database import Database
from service.storage.tables import ANALYSED, Pump, Record
from service.thresholds.layers import Effective, Scope, effective_thresholds, pump_scopes, thresholds_of
from service.thresholds.pins import hold, newest_number

Change = Literal["thresholds_changed", "reference_curve_changed"]
"""What may have changed for all pumps of a scope."""
_MOST_CHANGES_SHOWN = 50
"""Changed pumps that a job names; the rest is counted (our choice: a page)."""


@dataclass(frozen=True, slots=True)
class PumpChange:
    """What became of a pump's verdicts: ``changes`` names the records whose state differs, in event order.

    ``alarms`` are those ``gained`` and ``lost``, actions of operators aside; versions are those of the new verdicts.
    """

    serial: str
    operator: str
    n_records: int
    n_changed: int
    changes: tuple[VerdictDifference, ...]
    before: str | None
    after: str | None
    alarms: AlarmChanges
    twin_version: str
    threshold_version: int

    def to_json(self) -> answers.PumpChange:
        """As a job's item shows it."""
        return {
            "pump": self.serial,
            "operator": self.operator,
            "records": self.n_records,
            "changed": self.n_changed,
            "changes": list(self.changes),
            "state_before": self.before,
            "state_after": self.after,
            "alarms": self.alarms,
            "twin_version": self.twin_version,
            "threshold_version": self.threshold_version,
        }


@dataclass(frozen=True, slots=True)
class Wanted:
    """Versions that a pump is reprocessed with.

    Attributes
    ----------
    threshold_version
        Number up to which versions of thresholds count; None for the newest.
    pump_type
        Parameter set of the twin in place of the pump's own, for a rehearsal only; None for its own.
    author
        Who asks; the pump is held at the threshold version in this name.
    """

    threshold_version: int | None
    pump_type: str | None
    author: str


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


def reprocessed(
    database: Database,
    archive: Archive,
    pump_id: int,
    cause: Cause = REPROCESSED,
    *,
    reduce_anew: bool = False,
    wanted: Wanted | None = None,
) -> PumpChange:
    """Fold one pump anew, apart from other writers, and say what changed.

    Parameters
    ----------
    reduce_anew
        Read every record again from its raw bytes; otherwise only where something has changed that it depends on.
    wanted
        Versions to do it with, from the first record on; the pump is held at them. None for those that it has, with
        whatever still holds left as it is.

    Raises
    ------
    Problem
        when a record must be read again and cannot be; nothing is changed then.
    HeldByNewerError
        when a newer release has judged the pump; a process of that release is asked to fold it anew.
    """
    _leave_to_newer(database, pump_id)
    # reading a pump's whole history may take minutes: before the lock; what changes meanwhile, the fold notices
    with database.reading() as session:
        pump = session.get_one(Pump, pump_id)
        before, old_rules = points_of(session, pump_id), _rules(session, pump)
        is_plain = wanted is None and not reduce_anew
        anew = {} if is_plain else _known(session, archive, pump, wanted, reduce_anew=reduce_anew).anew
    if not is_plain:
        with database.writing() as session:
            pump = session.scalars(select(Pump).where(Pump.id == pump_id).with_for_update()).one()
            newer = newer_release(session, pump_id)
            if newer is not None:
                raise held_by(newer, pump.serial)
            before, old_rules = points_of(session, pump_id), _rules(session, pump)
            if wanted is not None:
                hold(session, pump, wanted.threshold_version, wanted.author)
            for row in session.scalars(select(Record).where(Record.id.in_(anew), Record.status == ANALYSED)):
                keep_analysis(row, anew[row.id])
            take_over(pump, whole=False)  # who dies here leaves the fold to the sweep
    apart(database, archive, pump_id, cause, from_scratch=wanted is not None)
    with database.reading() as session:
        pump = session.get_one(Pump, pump_id)
        newer = newer_release(session, pump_id)
        if newer is not None:
            raise held_by(newer, pump.serial)
        after, thresholds = points_of(session, pump_id), _thresholds(session, pump)
        alarms = gained_and_lost(lives(before, (), old_rules), lives(after, (), rules_of(thresholds.values)))
        return _change(
            pump,
            before,
            after,
            alarms,
            twin_version(held_type(session, pump.operator, pump.pump_type)),
            thresholds.version,
        )


def _leave_to_newer(database: Database, pump_id: int) -> None:
    """Ask a process of the newer release that has judged a pump to fold it anew; raises where there is one."""
    with database.reading() as session:
        newer = newer_release(session, pump_id)
    if newer is None:
        return
    with database.writing() as session:
        pump = session.scalars(select(Pump).where(Pump.id == pump_id).with_for_update()).one()
        left_to_newer(session, pump)
    raise held_by(newer, pump.serial)


def rehearsed(
    database: Database, archive: Archive, pump_id: int, wanted: Wanted, *, reduce_anew: bool = False
) -> PumpChange:
    """What ``reprocessed`` would change; nothing is written or locked. Raises as it does."""
    with database.reading() as session:
        pump = session.get_one(Pump, pump_id)
        before, old_rules = points_of(session, pump_id), _rules(session, pump)
        found = _known(session, archive, pump, wanted, reduce_anew=reduce_anew)
        # the others are of the type that this pump still has
        found = with_neighbours(session, pump, archive, found, kind=pump.pump_type)
        after = points_of_fold(session, found)
        alarms = gained_and_lost(lives(before, (), old_rules), lives(after, (), rules_of(found.thresholds.values)))
        return _change(pump, before, after, alarms, twin_version(found.known.kind), found.thresholds.version)


def points_of_fold(session: Session, found: Knowledge) -> list[Point]:
    """What alarms need of a history, folded without being stored."""
    flights = {p.outline.record_id: p.outline.flight_id for p in found.known.placed}
    assessments = fold(found.known, found.observations(session), found.others)
    return [
        point_of(a.record_id, a.at, verdict_to_json(a.verdict, "", 0, software().to_json()), flights[a.record_id])
        for a in assessments
    ]


def _known(session: Session, archive: Archive, pump: Pump, wanted: Wanted | None, *, reduce_anew: bool) -> Knowledge:
    if wanted is None:
        return knowledge(session, pump, archive, reduce_anew=reduce_anew)
    kind = wanted.pump_type
    number = newest_number(session) if wanted.threshold_version is None else wanted.threshold_version
    name = kind or pump.pump_type
    layers, held = pump_scopes(pump.operator, pump.serial, name), held_type(session, pump.operator, name)
    thresholds = effective_thresholds(session, layers, up_to=number, kind=held)
    return knowledge(session, pump, archive, thresholds=thresholds, reduce_anew=reduce_anew, pump_type_name=kind)


def _thresholds(session: Session, pump: Pump) -> Effective:
    return thresholds_of(session, pump.operator, pump.serial, pump.pump_type)


def _rules(session: Session, pump: Pump) -> Rules:
    return rules_of(_thresholds(session, pump).values)


def _change(
    pump: Pump,
    before: Sequence[Point],
    after: Sequence[Point],
    alarms: AlarmChanges,
    twin: str,
    thresholds: int,
) -> PumpChange:
    old = {p.record_id: p.state for p in before}
    changes: list[VerdictDifference] = [
        {"record_id": p.record_id, "at": p.at.isoformat(), "before": old.get(p.record_id), "after": p.state}
        for p in after
        if old.get(p.record_id) != p.state
    ]
    return PumpChange(
        serial=pump.serial,
        operator=pump.operator,
        n_records=len(after),
        n_changed=len(changes),
        changes=tuple(changes[:_MOST_CHANGES_SHOWN]),
        before=before[-1].state if before else None,
        after=after[-1].state if after else None,
        alarms=alarms,
        twin_version=twin,
        threshold_version=thresholds,
    )
