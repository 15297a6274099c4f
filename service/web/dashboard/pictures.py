"""Pictures of pumps with an address of their own: they load beside a page, and are drawn once for every state of a history."""

from collections import OrderedDict
from threading import Lock

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from detectors.curve.picture import curve_svg
from service.history.archive import Archive
from service.monitoring.succession import taken_over
from service.reading import queries
from service.reading.curve import curve_of
from service.storage.tables import Installation, MaintenanceEvent, Pump, ThresholdVersion
from service.units import UnitSystem

PICTURE_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; frame-ancestors 'none'; base-uri 'none'",
    "Cache-Control": "private, no-cache",
}
_MOST = 64
"""Pictures that a process keeps (our choice: some 40 kB each)."""
_DARK = """<style>@media (prefers-color-scheme: dark) {
[fill="#ffffff"] { fill: #12171e } [fill="#1b2430"] { fill: #e6ebf1 } [stroke="#1b2430"] { stroke: #e6ebf1 }
[fill="#5a6675"] { fill: #a9b4c2 } [stroke="#5a6675"] { stroke: #a9b4c2 } [stroke="#ffffff"] { stroke: #12171e }
[stroke="#e1e6ec"] { stroke: #2a333e } [fill="#cfe0f1"] { fill: #24405c }
[fill="#1f5f99"] { fill: #7db8f0 } [stroke="#1f5f99"] { stroke: #7db8f0 }
[fill="#8a1c1c"] { fill: #ff8f8f } [stroke="#8a1c1c"] { stroke: #ff8f8f } }</style>"""
_kept: OrderedDict[tuple[object, ...], str] = OrderedDict()
_lock = Lock()


def pictured_curve(session: Session, row: Pump, archive: Archive, system: UnitSystem) -> str:
    """The damage identification curve of a pump, drawn anew only where something that it rests on has changed."""
    key = (system.name, *_state(session, row))
    with _lock:
        if key in _kept:
            _kept.move_to_end(key)
            return _kept[key]
    found = curve_of(session, row, None, None, None, taken_over(session, row, archive)).curve
    svg = curve_svg(found, f"pump {row.serial}", system.scales())
    svg = svg.replace("<title>", f"{_DARK}<title>", 1)
    with _lock:
        _kept[key] = svg
        while len(_kept) > _MOST:
            _kept.popitem(last=False)
    return svg


def _state(session: Session, row: Pump) -> tuple[object, ...]:
    """What tells one state of a history from every other: its link in the chain, and what is entered besides."""
    last = queries.newest_assessments(session, row.id, 1)
    entered = [
        session.execute(
            select(func.max(table.row_id), func.max(table.withdrawn_at)).where(table.pump_id == row.id)
        ).one()
        for table in (Installation, MaintenanceEvent)
    ]
    thresholds = session.scalar(select(func.max(ThresholdVersion.number)))
    place = (last[-1].record_id, last[-1].chain) if last else None
    bind = str(session.get_bind().engine.url)
    return (bind, row.id, row.serial, row.pump_type, place, thresholds, *(tuple(e) for e in entered))
