"""Exports: rows read in pages and written as they are read, so that a fleet's history needs no more memory than a page.

Rows follow ISO 13374's blocks: windows are state detection, trends health assessment, verdicts advisory generation.
Every row names the twin's version and the software that made it, which is not always the one that writes the export.
"""

import csv
import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import Select, select, tuple_

from detectors.words.verdict import TREND_METRICS
from service.access.security import Principal
from service.answers import cells
from service.answers.documents import RowValues
from service.errors import NotFound, UnknownType
from service.storage.database import Database
from service.storage.tables import ANALYSED, Pump, Record, StoredAssessment

Row = RowValues
_PAGE = 500
_MEANS = (
    "discharge_pressure_bar",
    "case_pressure_bar",
    "reservoir_pressure_bar",
    "shaft_speed_rpm",
    "fluid_temperature_degc",
)
_RESIDUALS = ("discharge_pressure_bar", "case_pressure_bar")
_PLACE = ("operator", "pump_serial", "record_id")
_SOFTWARE = ("release", "commit", "sources")
_VERDICT = ("side", "confidence", "since", "secondary", "sensor", "advice", "twin_version", "threshold_version")


@dataclass(frozen=True, slots=True)
class Export:
    """One kind of export: its columns with their types, and the rows that one stored row becomes."""

    columns: dict[str, type]
    rows: Callable[[str, Record, StoredAssessment], Iterator[Row]]


def _trend_rows(serial: str, record: Record, assessment: StoredAssessment) -> Iterator[Row]:
    for metric, point in assessment.trend.items():
        yield _place(serial, record) | {
            "at": assessment.at,
            "metric": metric,
            "unit": TREND_METRICS.get(metric),
            "value": point.get("mean"),
            "low": point.get("low"),
            "high": point.get("high"),
            "twin_version": assessment.verdict.get("twin_version"),
            **_made_by(assessment.verdict.get("software")),
        }


def _verdict_rows(serial: str, record: Record, assessment: StoredAssessment) -> Iterator[Row]:
    verdict = assessment.verdict
    yield _place(serial, record) | {
        "at": assessment.at,
        "state": assessment.state,
        "candidates": " ".join(verdict.get("candidates") or ()),
        **{name: verdict.get(name) for name in _VERDICT},
        **_made_by(verdict.get("software")),
    }


def _window_rows(serial: str, record: Record, assessment: StoredAssessment) -> Iterator[Row]:
    for i, window in enumerate((record.reduction or {}).get("windows", [])):
        residuals = (record.residuals or {}).get(str(i), {})
        row = _place(serial, record) | {
            "flight_id": record.flight_id,
            "aircraft": assessment.aircraft,
            "position": assessment.position,
            "started_at": record.started_at,
            **{name: window[name] for name in ("kind", "start_s", "end_s", "accepted", "reason")},
        }
        for name in _MEANS:
            mean = window["means"].get(name)
            row |= {
                f"mean_{name}": mean["mean"] if mean else None,
                f"standard_error_{name}": mean["standard_error"] if mean else None,
            }
        for name in _RESIDUALS:
            residual = residuals.get(name)
            row |= {f"residual_{name}": residual["residual"] if residual else None}
            row |= {f"standard_deviation_{name}": residual["standard_deviation"] if residual else None}
        yield row | {"twin_version": assessment.verdict.get("twin_version"), **_made_by(record.reduced_by)}


def _made_by(software: Mapping[str, Any] | None) -> Row:
    """Columns of the software that made a row; empty where it was made before software was named."""
    return {f"software_{name}": (software or {}).get(name) for name in _SOFTWARE}


def _place(serial: str, record: Record) -> Row:
    return {"operator": record.operator, "pump_serial": serial, "record_id": record.id}


def _texts(*names: str) -> dict[str, type]:
    return dict.fromkeys(names, str)


_MADE_BY = _texts(*(f"software_{name}" for name in _SOFTWARE))

EXPORTS: dict[str, Export] = {
    "trends": Export(
        {
            **_texts(*_PLACE),
            "at": datetime,
            **_texts("metric", "unit"),
            "value": float,
            "low": float,
            "high": float,
            **_texts("twin_version"),
            **_MADE_BY,
        },
        _trend_rows,
    ),
    "verdicts": Export(
        {
            **_texts(*_PLACE),
            "at": datetime,
            **_texts("state", "candidates", "side"),
            "confidence": float,
            **_texts("since", "secondary", "sensor", "advice", "twin_version"),
            "threshold_version": int,
            **_MADE_BY,
        },
        _verdict_rows,
    ),
    "windows": Export(
        {
            **_texts(*_PLACE, "flight_id", "aircraft", "position"),
            "started_at": datetime,
            "kind": str,
            "start_s": float,
            "end_s": float,
            "accepted": bool,
            "reason": str,
            **{f"{what}_{name}": float for name in _MEANS for what in ("mean", "standard_error")},
            **{f"{what}_{name}": float for name in _RESIDUALS for what in ("residual", "standard_deviation")},
            **_texts("twin_version"),
            **_MADE_BY,
        },
        _window_rows,
    ),
}


def exported(
    database: Database,
    principal: Principal,
    name: str,
    form: str,
    *,
    pump: str | None = None,
    since: datetime | None = None,
    until: datetime | None = None,
) -> Iterator[bytes]:
    """An export in parts; everything that can be refused is refused before the first.

    Raises
    ------
    NotFound
        when there is no such export or form.
    UnknownType
        when Parquet is asked for and pyarrow is not installed.
    """
    if name not in EXPORTS or form not in ("csv", "parquet"):
        raise NotFound(f"there is no export {name}.{form}; there are {', '.join(EXPORTS)} as csv or parquet")
    export = EXPORTS[name]
    pages = _pages(database, principal, export, pump, since, until)
    return _csv(export, pages) if form == "csv" else _parquet(export, pages)


def _pages(
    database: Database,
    principal: Principal,
    export: Export,
    pump: str | None,
    since: datetime | None,
    until: datetime | None,
) -> Iterator[list[Row]]:
    """Rows in event order, one page after the other, each read in a session of its own."""
    query = _query(principal, pump, since, until)
    after: tuple[datetime, str] | None = None
    while True:
        wanted = (
            query if after is None else query.where(tuple_(StoredAssessment.at, StoredAssessment.record_id) > after)
        )
        with database.reading() as session:
            found: Sequence[Any] = session.execute(wanted.limit(_PAGE)).all()
            yield [row for serial, record, assessment in found for row in export.rows(serial, record, assessment)]
        if len(found) < _PAGE:
            return
        after = (found[-1][2].at, found[-1][2].record_id)


def _query(
    principal: Principal, pump: str | None, since: datetime | None, until: datetime | None
) -> Select[str, Record, StoredAssessment]:
    query = (
        select(Pump.serial, Record, StoredAssessment)
        .join(Record, Record.id == StoredAssessment.record_id)
        .join(Pump, Pump.id == StoredAssessment.pump_id)
        .where(Record.status == ANALYSED)
    )
    if principal.operator is not None:
        query = query.where(Pump.operator == principal.operator)
    if pump is not None:
        query = query.where(Pump.serial == pump)
    if since is not None:
        query = query.where(StoredAssessment.at >= since)
    if until is not None:
        query = query.where(StoredAssessment.at < until)
    return query.order_by(StoredAssessment.at, StoredAssessment.record_id)


def _csv(export: Export, pages: Iterator[list[Row]]) -> Iterator[bytes]:
    out = io.StringIO()
    writer = csv.DictWriter(out, list(export.columns), lineterminator="\n")
    writer.writeheader()
    for rows in pages:
        for row in rows:
            writer.writerow({k: v.isoformat() if isinstance(v, datetime) else cells.written(v) for k, v in row.items()})
        yield out.getvalue().encode()
        out.seek(0)
        out.truncate()


def _parquet(export: Export, pages: Iterator[list[Row]]) -> Iterator[bytes]:
    try:
        import pyarrow as pa  # noqa: PLC0415 - an extra
        import pyarrow.parquet as pq  # noqa: PLC0415
    except ImportError:
        raise UnknownType("writing Parquet needs the extra on the server: pip install 'casedrain[parquet]'") from None
    types = {str: pa.string(), float: pa.float64(), int: pa.int64(), bool: pa.bool_()}
    types[datetime] = pa.timestamp("us", tz="UTC")
    schema = pa.schema([(name, types[kind]) for name, kind in export.columns.items()])

    def parts() -> Iterator[bytes]:
        sink = _Sink()
        with pq.ParquetWriter(sink, schema) as writer:
            for rows in pages:
                writer.write_table(pa.Table.from_pylist(rows, schema=schema))
                yield sink.taken()
        yield sink.taken()

    return parts()


class _Sink(io.RawIOBase):
    """Write-only file that gives up what was written so far."""

    def __init__(self) -> None:
        super().__init__()
        self._parts: list[bytes] = []
        self._size = 0

    def writable(self) -> bool:
        return True

    def write(self, part: Any) -> int:
        self._parts.append(bytes(part))
        self._size += len(self._parts[-1])
        return len(self._parts[-1])

    def tell(self) -> int:
        return self._size

    def taken(self) -> bytes:
        parts, self._parts = self._parts, []
        return b"".join(parts)
