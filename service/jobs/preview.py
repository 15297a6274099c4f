"""Preview of thresholds over more history than one answer may take, one item per pump; nothing is written."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import cast

from fastapi.encoders import jsonable_encoder
from pydantic import FiniteFloat

from service.answers.jobs import JobResult
from service.answers.thresholds import PumpPreview
from service.errors import Unavailable
from service.jobs import store
from service.jobs.kinds import Item, Kind, Parameters, Work, register
from service.monitoring.preview import compared, differs, pumps_with_records, totals
from service.storage.tables import Pump
from service.thresholds.layers import Scope

_FAILED = "failed"


class PreviewParameters(Parameters):
    """A candidate for one layer of thresholds."""

    scope: str
    id: str
    operator: str | None = None
    values: dict[str, FiniteFloat]


@register
class Preview(Kind[PreviewParameters, list[int]]):
    """One item per pump: ``changed`` or ``unchanged``, with its alarms on both sides; the result holds the totals.

    A pump whose raw bytes are needed and missing is ``failed`` and counts in no total.
    """

    name = "preview"
    most_parts = 64
    over_api = False
    parameters = PreviewParameters

    @contextmanager
    def opened(self, work: Work[PreviewParameters]) -> Iterator[list[int]]:
        with work.context.database.reading() as session:
            ids = [pump.id for pump, _ in pumps_with_records(session, work.operator, _scope(work))]
        yield ids

    def total(self, _work: Work[PreviewParameters], pump_ids: list[int]) -> int:
        return len(pump_ids)

    def item(self, work: Work[PreviewParameters], pump_ids: list[int], position: int) -> Item:
        context = work.context
        with context.database.reading() as session:
            pump = session.get_one(Pump, pump_ids[position])
            try:
                found = compared(session, context.archive, pump, _scope(work), work.parameters.values)
            except Unavailable as problem:
                return Item(pump.serial, _FAILED, {"pump_serial": pump.serial, "problem": problem.body()})
        return Item(found["pump_serial"], "changed" if differs(found) else "unchanged", jsonable_encoder(found))

    def result(self, work: Work[PreviewParameters], _pump_ids: list[int], counts: dict[str, int]) -> JobResult:
        with work.context.database.reading() as session:
            details = [i.detail for i in session.scalars(store.items(work.job_id)) if i.status != _FAILED]
        return {"counts": counts, "totals": totals(cast("list[PumpPreview]", details))}


def _scope(work: Work[PreviewParameters]) -> Scope:
    return Scope(work.parameters.scope, work.parameters.id, work.parameters.operator)
