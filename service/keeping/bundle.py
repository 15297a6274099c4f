"""A pump's bundle: inputs, versions and the verdict that they gave, in one file that can be replayed anywhere."""

import json
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

from alembic.migration import MigrationContext
from sqlalchemy import ColumnElement, Connection, Table, or_, select
from sqlalchemy.orm import Session

from service.errors import NotFound
from service.identity import software
from service.keeping.container import Target, Written, written
from service.keeping.manifest import BUNDLE, MANIFEST, RAW_LIST, BundleManifest, described, raw_name, rows_name, sealed
from service.keeping.rows import lines_of
from service.monitoring.succession import neighbours_at
from service.reading import queries
from service.reading.forecast import with_crossing
from service.storage.database import Database
from service.storage.raw_store import RawStore
from service.storage.tables import ANALYSED, Base, Installation, Pump, Record, ThresholdVersion

EXPECTED = "expected.json"
_ANSWERS = frozenset(
    {"assessments", "fold_snapshots", "verdict_revisions", "alarms", "alarm_actions", "messages", "deliveries"}
)
"""Made by the fold, and no input of it."""
_OF_OPERATORS = frozenset({"aircraft", "registry_versions", "pump_types", "reference_curves", "threshold_versions"})
"""What an operator, or everybody, has said and a verdict may rest on."""


def make_bundle(database: Database, raw_store: RawStore, pump_id: int, place: Path) -> BundleManifest:
    """Write a pump's bundle to a folder, or to one file where ``place`` ends in ``.zip``; gives its manifest.

    It holds the pump and those that shared its places, with their records and what was entered about them, the registry
    of their operator, every threshold and type that holds for them, and the raw bytes of all records that count.

    Raises
    ------
    NotFound
        when there is no such pump.
    Unavailable
        when raw bytes are missing or damaged.
    """
    with written(place) as target, database.snapshot() as session:
        pump = session.get(Pump, pump_id)
        if pump is None:
            raise NotFound("there is no such pump")
        return _write(session, raw_store, pump, target)


def inputs_of(operator: str, pumps: list[int]) -> Iterator[tuple[Table, ColumnElement[bool]]]:
    """Tables that verdicts of these pumps rest on, and which of their rows; those referred to come first."""
    records = select(Record.id).where(Record.pump_id.in_(pumps))
    for table in Base.metadata.sorted_tables:
        if table.name in _ANSWERS:
            continue
        if table.name == Pump.__tablename__:
            yield table, table.c.id.in_(pumps)
        elif table.name in _OF_OPERATORS:
            yield table, _said_of(table, operator)
        elif "pump_id" in table.c:
            yield table, table.c.pump_id.in_(pumps)
        elif any(key.column.table.name == Record.__tablename__ for key in table.foreign_keys):
            (key,) = (k for k in table.foreign_keys if k.column.table.name == Record.__tablename__)
            yield table, key.parent.in_(records)


def _write(session: Session, raw_store: RawStore, pump: Pump, target: Target) -> BundleManifest:
    files: dict[str, Written] = {}
    connection: Connection = session.connection()
    pumps = _neighbours(session, pump)
    verdict = with_crossing(session, pump, queries.verdict(session, pump))
    tables = []
    for table, which in inputs_of(pump.operator, pumps):
        name = rows_name("rows", table.name)
        files[name] = target.add(name, lines_of(connection, table, which))
        tables.append(described(table))
    raw: dict[str, int] = {}
    counting = select(Record.content_hash).where(Record.pump_id.in_(pumps), Record.status == ANALYSED)
    for digest in session.scalars(counting.where(Record.raw_removed_at.is_(None)).distinct()):
        raw[digest] = target.add(raw_name(digest), raw_store.chunks(digest)).n_bytes
    lines = (json.dumps(item).encode() + b"\n" for item in sorted(raw.items()))
    files[RAW_LIST] = target.add(RAW_LIST, lines)
    files[EXPECTED] = target.add(EXPECTED, iter([json.dumps(verdict, sort_keys=True).encode()]))
    body: BundleManifest = {
        "format": BUNDLE,
        "made_at": datetime.now(UTC).isoformat(),
        "software": software().to_json(),
        "issued_by": verdict.get("software"),
        "operator": pump.operator,
        "pump": pump.serial,
        "pump_id": pump.id,
        "twin_version": verdict.get("twin_version"),
        "threshold_version": verdict.get("threshold_version"),
        "database": {
            "kind": connection.dialect.name,
            "revision": MigrationContext.configure(connection).get_current_revision() or "base",
            "tables": tables,
        },
        "raw_files": len(raw),
        "files": {name: {"bytes": done.n_bytes, "sha256": done.sha256} for name, done in files.items()},
    }
    target.add(MANIFEST, iter([sealed(body)]))
    return body


def _neighbours(session: Session, pump: Pump) -> list[int]:
    """The pump and all of its operator that sat where it sat, by record or by entry, and where those sat, and so on.

    What one pump has learnt of a position is taken over by the next, which hands on what it took over.
    """
    found, new = {pump.id}, {pump.id}
    seen: set[tuple[str, str]] = set()
    while new:
        places: set[tuple[str, str]] = set()
        for table in (Record, Installation):
            said = select(table.aircraft, table.position).where(table.pump_id.in_(new)).distinct()
            places |= {(row.aircraft, row.position) for row in session.execute(said) if row.aircraft is not None}
        new = neighbours_at(session, pump.operator, places - seen) - found
        seen, found = seen | places, found | new
    return sorted(found)


def _said_of(table: Table, operator: str) -> ColumnElement[bool]:
    everybodys: ColumnElement[bool] = table.c.operator.is_(None)
    if table.name == ThresholdVersion.__tablename__:
        # the layer of an operator is nobody's by its column and names it as what it is about
        everybodys &= (table.c.scope != "operator") | (table.c.scope_id == operator)
    return or_(table.c.operator == operator, everybodys)
