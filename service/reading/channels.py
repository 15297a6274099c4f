"""Channels of one record over time, with the windows that the analysis saw there and the twin's values."""

import math
from datetime import datetime
from typing import NamedTuple

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.access.security import Principal
from service.answers.records import RecordChannels, TwinValue
from service.history.overview import Stretch
from service.reading import queries
from service.reading.queries import windows_of
from service.storage.tables import ANALYSED, Record


class Other(NamedTuple):
    """A record that may lie over another one."""

    record_id: str
    flight_id: str
    segment: str
    started_at: datetime


def others_of(session: Session, asker: Principal, record_id: str, most: int = 100) -> list[Other]:
    """Records of the same pump that count, the newest first."""
    row = queries.record(session, asker, record_id)
    if row.pump_id is None:
        return []
    shown = select(Record.id, Record.flight_id, Record.segment, Record.started_at)
    query = shown.where(Record.pump_id == row.pump_id, Record.status == ANALYSED, Record.id != record_id)
    rows = session.execute(query.order_by(Record.started_at.desc()).limit(most))
    return [Other(name, flight or name, part, at) for name, flight, part, at in rows if at is not None]


def record_channels(row: Record, seen: Stretch, start_s: float = -math.inf, end_s: float = math.inf) -> RecordChannels:
    """A stretch of a decoded record's channels, [``start_s``, ``end_s``), with what the analysis saw there.

    Windows and the twin's values are those stored with the record.
    """
    windows = [w for w in windows_of(row) if w["start_s"] < end_s and w["end_s"] > start_s]
    zero = (row.reduction or {}).get("zero", {})
    return {
        "record_id": row.id,
        **seen,
        "windows": windows,
        "twin": [
            _twin_value(channel, window["start_s"], window["end_s"], residual["twin"], zero.get("offset_bar"))
            for window in windows
            for channel, residual in window["residuals"].items()
            if residual["twin"] is not None
        ],
    }


def _twin_value(channel: str, start_s: float, end_s: float, twin: float, zero: float | None) -> TwinValue:
    offset = zero if channel == "case_pressure_bar" and zero is not None else 0.0
    return {"channel": channel, "start_s": start_s, "end_s": end_s, "value": twin, "as_measured": twin + offset}
