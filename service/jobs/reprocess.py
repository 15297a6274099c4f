"""Reprocess: records reduced again from their raw bytes and pumps folded anew, with today's twin and thresholds."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Literal

from pydantic import model_validator
from sqlalchemy import Select, select
from sqlalchemy.orm import Session

from service.errors import NotFound, Unavailable
from service.jobs.kinds import Item, Kind, Parameters, Work, register
from service.monitoring.reanalysis import Change, cause_of, pumps_of, reprocessed
from service.monitoring.refold import REPROCESSED, Cause
from service.tables import Pump
from service.threshold_layers import Scope


class ReprocessParameters(Parameters):
    """Which pumps; without ``pump``, ``pump_type`` or ``scope`` all that the key may see."""

    pump: str | None = None
    pump_type: str | None = None
    dry_run: bool = False
    only: Literal["everything", "verdicts"] = "everything"
    """``verdicts`` folds the stored windows and reads no raw bytes unless thresholds of windows ask for it."""
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
    parameters = ReprocessParameters
    internal = frozenset({"up_to_pump"})

    def prepared(self, session: Session, parameters: ReprocessParameters, operator: str | None) -> ReprocessParameters:
        ids = list(session.scalars(_pumps(parameters, operator)))
        if not ids:
            raise NotFound(f"there is no pump {parameters.pump}" if parameters.pump else "there is no such pump")
        return parameters.model_copy(update={"up_to_pump": ids[-1]})

    @contextmanager
    def opened(self, work: Work[ReprocessParameters]) -> Iterator[list[int]]:
        with work.context.database.reading() as session:
            yield list(session.scalars(_pumps(work.parameters, work.operator)))

    def total(self, _work: Work[ReprocessParameters], pump_ids: list[int]) -> int:
        return len(pump_ids)

    def item(self, work: Work[ReprocessParameters], pump_ids: list[int], position: int) -> Item:
        parameters = work.parameters
        return _refolded(
            work,
            pump_ids[position],
            REPROCESSED,
            reduce_anew=parameters.only == "everything",
            dry_run=parameters.dry_run,
        )


class RefoldParameters(Parameters):
    """What has changed, and the pumps that it holds for."""

    scope: str
    id: str
    operator: str | None = None
    version: int
    change: Change = "thresholds_changed"


@register
class Refold(Kind[RefoldParameters, list[int]]):
    """Fold anew what a change of thresholds or of a measured healthy curve touches, one item per pump."""

    name = "refold"
    over_api = False
    parameters = RefoldParameters

    @contextmanager
    def opened(self, work: Work[RefoldParameters]) -> Iterator[list[int]]:
        layer = work.parameters
        with work.context.database.reading() as session:
            yield [pump.id for pump in session.scalars(pumps_of(_scope(layer)))]

    def total(self, _work: Work[RefoldParameters], pump_ids: list[int]) -> int:
        return len(pump_ids)

    def item(self, work: Work[RefoldParameters], pump_ids: list[int], position: int) -> Item:
        cause = cause_of(work.parameters.change, _scope(work.parameters))
        return _refolded(work, pump_ids[position], cause)


def _refolded(work: Work[Any], pump_id: int, cause: Cause, *, reduce_anew: bool = False, dry_run: bool = False) -> Item:
    """One pump; where its raw bytes are missing it keeps its verdicts, and the others still get their turn."""
    database, archive = work.context.database, work.context.archive
    try:
        change = reprocessed(database, archive, pump_id, cause, reduce_anew=reduce_anew, dry_run=dry_run)
    except Unavailable as problem:
        with database.reading() as session:
            pump = session.get_one(Pump, pump_id)
        names = {"pump": pump.serial, "operator": pump.operator}
        return Item(pump.serial, "failed", {**names, "problem": problem.body()})
    return Item(change.serial, "changed" if change.n_changed else "unchanged", change.to_json())


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
