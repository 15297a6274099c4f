"""Reprocess: records reduced again from their raw bytes and pumps folded anew, with today's versions or with others."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Literal

from fastapi.encoders import jsonable_encoder
from pydantic import Field, model_validator
from sqlalchemy import Select, select
from sqlalchemy.orm import Session

from detectors.judgement.version import twin_version
from service.errors import Fault, Invalid, NotFound, Unavailable
from service.jobs.kinds import Item, Kind, Parameters, Work, register
from service.monitoring.precedence import HeldByNewerError
from service.monitoring.reanalysis import Change, PumpChange, Wanted, cause_of, pumps_of, rehearsed, reprocessed
from service.monitoring.refold import REPROCESSED
from service.pump_types.parameter_sets import types
from service.storage.tables import Pump
from service.thresholds.layers import Scope
from service.thresholds.pins import newest_number


class ReprocessParameters(Parameters):
    """Which pumps; without ``pump``, ``pump_type`` or ``scope`` all that the key may see."""

    pump: str | None = None
    pump_type: str | None = None
    dry_run: bool = False
    only: Literal["everything", "verdicts"] = "everything"
    """``verdicts`` folds the stored windows and reads no raw bytes unless thresholds of windows ask for it."""
    threshold_version: int | None = Field(default=None, ge=0)
    """Number up to which versions of thresholds count. The pumps are held at it until thresholds that hold for them
    change or they are reprocessed without a number."""
    twin_version: str | None = None
    """One of those that this installation can run; one that is not the pumps' own only in a dry run."""
    up_to_pump: int | None = None
    """Set when the job is asked for: pumps that come later are new already."""

    @model_validator(mode="after")
    def _names_one(self) -> "ReprocessParameters":
        if self.pump is not None and self.pump_type is not None:
            raise ValueError("name a pump or a pump type, not both")
        return self


@register
class Reprocess(Kind[ReprocessParameters, list[int]]):
    """One item per pump: ``changed`` or ``unchanged``, with every record whose verdict differs; a dry run writes nothing.

    A pump whose raw bytes are missing is ``failed`` and keeps its verdicts.
    """

    name = "reprocess"
    most_parts = 64
    parameters = ReprocessParameters
    internal = frozenset({"up_to_pump"})

    def prepared(self, session: Session, parameters: ReprocessParameters, operator: str | None) -> ReprocessParameters:
        ids = list(session.scalars(_pumps(parameters, operator)))
        if not ids:
            raise NotFound(f"there is no pump {parameters.pump}" if parameters.pump else "there is no such pump")
        faults = [*_version_faults(session, parameters), *_twin_faults(session, parameters, operator, ids)]
        if faults:
            raise Invalid(f"{len(faults)} fault(s) in what was asked for; no job was started", faults)
        return parameters.model_copy(update={"up_to_pump": ids[-1]})

    def role_for(self, parameters: ReprocessParameters) -> str:
        """Verdicts by other thresholds are a change of thresholds."""
        holds = parameters.threshold_version is not None and not parameters.dry_run
        return "engineer" if holds else self.role

    @contextmanager
    def opened(self, work: Work[ReprocessParameters]) -> Iterator[list[int]]:
        with work.context.database.reading() as session:
            yield list(session.scalars(_pumps(work.parameters, work.operator)))

    def total(self, _work: Work[ReprocessParameters], pump_ids: list[int]) -> int:
        return len(pump_ids)

    def item(self, work: Work[ReprocessParameters], pump_ids: list[int], position: int) -> Item:
        asked, pump_id = work.parameters, pump_ids[position]
        kind = None
        if asked.twin_version is not None:
            with work.context.database.reading() as session:
                kind = twin_versions(session, work.operator).get(asked.twin_version)
            if kind is None:
                raise Invalid(
                    f"the twin {asked.twin_version} is of another release: ask again with one of this release"
                )
        wanted = Wanted(asked.threshold_version, kind, work.principal.owner)
        database, archive = work.context.database, work.context.archive
        reduce_anew = asked.only == "everything"
        if asked.dry_run:
            return _answered(
                work, pump_id, lambda: rehearsed(database, archive, pump_id, wanted, reduce_anew=reduce_anew)
            )
        return _answered(
            work,
            pump_id,
            lambda: reprocessed(database, archive, pump_id, REPROCESSED, reduce_anew=reduce_anew, wanted=wanted),
        )


class RefoldParameters(Parameters):
    """What has changed, and the pumps that it holds for."""

    scope: str
    id: str
    operator: str | None = None
    version: int
    change: Change = "thresholds_changed"
    at_once: bool = False
    """Set by the service for a few pumps: the process that stores the job works on it right after its answer."""


@register
class Refold(Kind[RefoldParameters, list[int]]):
    """Fold anew what a change of thresholds or of a measured healthy curve touches, one item per pump."""

    name = "refold"
    most_parts = 64
    over_api = False
    internal = frozenset({"at_once"})
    parameters = RefoldParameters

    @contextmanager
    def opened(self, work: Work[RefoldParameters]) -> Iterator[list[int]]:
        layer = work.parameters
        with work.context.database.reading() as session:
            yield [pump.id for pump in session.scalars(pumps_of(_scope(layer)))]

    def total(self, _work: Work[RefoldParameters], pump_ids: list[int]) -> int:
        return len(pump_ids)

    def item(self, work: Work[RefoldParameters], pump_ids: list[int], position: int) -> Item:
        pump_id, cause = pump_ids[position], cause_of(work.parameters.change, _scope(work.parameters))
        database, archive = work.context.database, work.context.archive
        return _answered(work, pump_id, lambda: reprocessed(database, archive, pump_id, cause))


def twin_versions(session: Session, operator: str | None) -> dict[str, str]:
    """Versions of the twin that an operator's pumps can be judged with, with the parameter set of each."""
    return {twin_version(kind): kind.name for kind in types(session, operator)}


def _version_faults(session: Session, parameters: ReprocessParameters) -> list[Fault]:
    newest, number = newest_number(session), parameters.threshold_version
    if number is None or number <= newest:
        return []
    return [Fault("parameters.threshold_version", f"is {number}: versions go from 0 (built in) to {newest}")]


def _twin_faults(
    session: Session, parameters: ReprocessParameters, operator: str | None, pump_ids: Sequence[int]
) -> list[Fault]:
    where, wanted = "parameters.twin_version", parameters.twin_version
    known = twin_versions(session, operator)
    if wanted is None:
        return []
    if wanted not in known:
        return [Fault(where, f"is {wanted}: this installation can run {', '.join(sorted(known))}")]
    kinds = set(session.scalars(select(Pump.pump_type).where(Pump.id.in_(pump_ids))))
    others = sorted(kinds - {known[wanted]})
    if others and not parameters.dry_run:
        words = f"is of {known[wanted]}, but there are pumps of {', '.join(others)}"
        return [Fault(where, f"{words}: register them as that type, or see in a dry run what it would change")]
    return []


def _answered(work: Work[Any], pump_id: int, changed: Callable[[], PumpChange]) -> Item:
    """One pump; where its raw bytes are missing it keeps its verdicts, and the others still get their turn."""
    try:
        change = changed()
    except Unavailable as problem:
        with work.context.database.reading() as session:
            pump = session.get_one(Pump, pump_id)
        names = {"pump": pump.serial, "operator": pump.operator}
        status = "left" if isinstance(problem, HeldByNewerError) else "failed"
        return Item(pump.serial, status, {**names, "problem": problem.body()})
    alarms = any(change.alarms.values())
    return Item(
        change.serial, "changed" if change.n_changed or alarms else "unchanged", jsonable_encoder(change.to_json())
    )


def _scope(layer: RefoldParameters) -> Scope:
    return Scope(layer.scope, layer.id, layer.operator)


def _pumps(parameters: ReprocessParameters, operator: str | None) -> Select[int]:
    query = select(Pump.id)
    if operator is not None:
        query = query.where(Pump.operator == operator)
    if parameters.pump is not None:
        query = query.where(Pump.serial == parameters.pump)
    if parameters.pump_type is not None:
        query = query.where(Pump.pump_type == parameters.pump_type)
    if parameters.up_to_pump is not None:
        query = query.where(Pump.id <= parameters.up_to_pump)
    return query.order_by(Pump.id)
