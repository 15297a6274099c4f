"""What a record holds, sample by sample: its channels over time, and the spectrum of one of them."""

import math
from typing import Annotated

from fastapi import APIRouter, Query

from service.access.security import Principal
from service.answers.records import RecordChannels, Spectrum
from service.context import Context
from service.errors import Conflict, Fault, Invalid
from service.history.overview import POINTS, kept_overview, stretch_of
from service.pump_types.parameter_sets import held_type
from service.reading import queries
from service.reading.channel_spectrum import channel_spectrum
from service.reading.channels import record_channels
from service.storage.tables import Pump, Record
from service.web.answer_route import AnswerRoute
from service.web.dependencies import Asker, ContextOf
from twin.parameters import PumpType

router = APIRouter(prefix="/records", tags=["records"], route_class=AnswerRoute)


@router.get("/{record_id}/channels", summary="Channels of one record over time")
def channels(
    record_id: str,
    context: ContextOf,
    asker: Asker,
    points: Annotated[int, Query(ge=4, le=10_000, description="About so many of each channel")] = POINTS,
    start_s: Annotated[float | None, Query(alias="from", description="Start of the stretch [s]")] = None,
    end_s: Annotated[float | None, Query(alias="to", description="End of the stretch [s]")] = None,
) -> RecordChannels:
    """Samples thinned without losing extremes, with the windows and the twin's values over them."""
    row, kind, kept = _decodable(context, asker, record_id, start_s is None and end_s is None and points == POINTS)
    first, last = -math.inf if start_s is None else start_s, math.inf if end_s is None else end_s
    seen = kept_overview(kept) or stretch_of(context.archive.recording(row, kind), first, last, points)
    return record_channels(row, seen, first, last)


@router.get("/{record_id}/spectrum", summary="Spectrum of one channel of one record")
def spectrum(
    record_id: str,
    context: ContextOf,
    asker: Asker,
    channel: str,
    start_s: Annotated[float | None, Query(description="Start of the stretch [s]")] = None,
    end_s: Annotated[float | None, Query(description="End of the stretch [s]")] = None,
) -> Spectrum:
    """Power spectral density and orders of the shaft; by default in the last accepted zero-flow window."""
    row, kind, _ = _decodable(context, asker, record_id)
    first, last = _stretch(row, start_s, end_s)
    recording = context.archive.recording(row, kind)
    return {"record_id": record_id, **channel_spectrum(recording, channel, kind, first, last)}


def _decodable(
    context: Context, asker: Principal, record_id: str, thinned: bool = False
) -> tuple[Record, PumpType, bytes | None]:
    """A record that was decoded once, with the type of its pump and, where asked for, the thinned copy kept of it."""
    with context.database.reading() as session:
        row = queries.record(session, asker, record_id)
        if row.pump_id is None or row.reduction is None:
            raise Conflict(f"record {record_id} is {row.status}: there is nothing decoded to look at")
        pump = session.get_one(Pump, row.pump_id)
        return row, held_type(session, pump.operator, pump.pump_type), row.overview if thinned else None


def _stretch(row: Record, start_s: float | None, end_s: float | None) -> tuple[float, float]:
    if start_s is None and end_s is None:
        windows = [w for w in (row.reduction or {}).get("windows", []) if w["kind"] == "zero_flow" and w["accepted"]]
        return (windows[-1]["start_s"], windows[-1]["end_s"]) if windows else (-math.inf, math.inf)
    first = -math.inf if start_s is None else start_s
    last = math.inf if end_s is None else end_s
    if not first < last:
        raise Invalid("the stretch is empty", [Fault("query.end_s", "is not after start_s")])
    return first, last
