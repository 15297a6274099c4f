"""An operator's export taken into another installation: registry, records, entries, thresholds, alarms and raw bytes.

What has no meaning elsewhere stays behind: keys and users, whose secrets an export does not hold, webhooks and what was
sent to them, jobs, and the audit log, which only its own installation can prove. Numbers are given anew, and verdicts
are made again with what holds for everybody here.
"""

import hashlib
import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypedDict

from sqlalchemy import Table, column, func, insert, select, table
from sqlalchemy.dialects.postgresql import JSONB
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session
from sqlalchemy.types import JSON, Integer, TypeEngine

from service.access import audit
from service.access.security import AT_THE_MACHINE
from service.answers.documents import RowValues
from service.keeping.container import Source, parts_of, read
from service.keeping.rows import AS_JSON, INSTANT, shape_of
from service.registry.export import EXPORT, MANIFEST, ExportManifest
from service.registry.ownership import owned_tables, rows_of
from service.storage.database import Database
from service.storage.raw_store import RawStore, content_hash
from service.storage.tables import ThresholdPin, ThresholdVersion, UtcDateTime

LEFT_BEHIND = frozenset(
    {
        "api_keys", "users", "sessions", "signed_in", "failed_sign_ins", "webhooks", "messages", "deliveries",
        "jobs", "job_items", "audit_entries", "fold_snapshots",
    }
)  # fmt: skip
_JSON = JSON(none_as_null=True).with_variant(JSONB(none_as_null=True), "postgresql")
_BATCH = 500


class Imported(TypedDict):
    """What came in: rows by table, raw files (counts)."""

    operator: str
    rows: dict[str, int]
    raw_files: int


def import_operator(database: Database, raw_store: RawStore, place: Path, revision: str) -> Imported:
    """Take an export in, all of it or nothing; gives what came in.

    Parameters
    ----------
    revision
        Of the database's schema: an export of another one is refused.

    Raises
    ------
    ValueError
        when the file is no export or not whole, was made by another release, or the operator is known here.
    """
    with read(place) as source:
        manifest, manifest_hash = _manifest(source, revision)
        operator = str(manifest["operator"])
        raw = _raw_in(source)
        for digest in raw:
            with source.open(f"raw/{digest}") as file:
                content = b"".join(parts_of(file))
            if content_hash(content) != digest:
                raise ValueError(f"raw/{digest} is damaged: nothing was imported")
            raw_store.put(content)
        try:
            with database.writing() as session:
                rows = _Import(session, source, operator, raw).run()
                advance_numbers(session)
                details = {
                    "rows": rows,
                    "raw_files": len(raw),
                    "export": manifest_hash,
                    "software": manifest["software"],
                }
                audit.note(session, AT_THE_MACHINE, "operator.import", f"operator/{operator}", operator, details)
        except IntegrityError as error:
            raise ValueError(f"rows of the export are here already, nothing was imported: {error.orig}") from None
    return {"operator": operator, "rows": rows, "raw_files": len(raw)}


class _Import:
    """Rows on their way in; numbers of this database by table and number of the other one."""

    def __init__(self, session: Session, source: Source, operator: str, raw: set[str]) -> None:
        self._session = session
        self._source = source
        self._operator = operator
        self._raw = raw
        self._numbers: dict[str, dict[int, int]] = {}

    def run(self) -> dict[str, int]:
        """Insert everything; how many rows by table."""
        names = self._source.names()
        wanted = {n: t for n, t in owned_tables().items() if n not in LEFT_BEHIND and f"tables/{n}.jsonl" in names}
        for name, stored in owned_tables().items():
            query = select(func.count()).select_from(stored).where(rows_of(stored, self._operator))
            if self._session.scalar(query):
                raise ValueError(f"operator {self._operator} has {name} here already: nothing was imported")
        return {name: self._table(stored) for name, stored in wanted.items()}

    def _table(self, stored: Table) -> int:
        kinds = dict(shape_of(stored).columns)
        number = _number_of(stored)
        newest = self._session.scalar(select(func.max(stored.c[number]))) if number else None
        count, batch = int(newest or 0), []
        n_rows = 0
        with self._source.open(f"tables/{stored.name}.jsonl") as lines:
            for line in lines:
                row = {name: value for name, value in json.loads(line).items() if name in kinds}
                if number is not None:
                    count += 1
                    self._numbers.setdefault(stored.name, {})[row[number]] = count
                    row[number] = count
                batch.append(self._row(stored, kinds, row))
                n_rows += 1
                if len(batch) == _BATCH:
                    self._insert(stored, kinds, batch)
                    batch = []
        if batch:
            self._insert(stored, kinds, batch)
        return n_rows

    def _row(self, stored: Table, kinds: dict[str, str], row: RowValues) -> RowValues:
        for key in stored.foreign_keys:
            numbers, old = self._numbers.get(key.column.table.name), row.get(key.parent.name)
            if numbers is not None and isinstance(old, int):
                row[key.parent.name] = numbers[old]
        for name, value in row.items():
            if value is not None and kinds[name] == INSTANT:
                row[name] = datetime.fromisoformat(value)
        if stored.name == "pumps":
            row |= {"made_by": None, "made_with": None}  # made again with what holds for everybody here
        if stored.name == "records" and row["content_hash"] not in self._raw and row["raw_removed_at"] is None:
            row["raw_removed_at"] = datetime.now(UTC)
        if stored.name == ThresholdPin.__tablename__:
            versions = self._numbers.get(ThresholdVersion.__tablename__, {})
            row["number"] = versions.get(row["number"])
            row["counter"] = int(self._session.scalar(select(func.max(ThresholdVersion.number))) or 0)
        return row

    def _insert(self, stored: Table, kinds: dict[str, str], rows: list[RowValues]) -> None:
        types: dict[str, TypeEngine[Any]] = {AS_JSON: _JSON, INSTANT: UtcDateTime()}
        columns: list[Any] = [
            column(n, types[k]) if k in types else column(n) for n, k in kinds.items() if n in rows[0]
        ]
        self._session.execute(insert(table(stored.name, *columns)), rows)


def advance_numbers(session: Session) -> None:
    """Let Postgres count on behind the numbers that were given here; SQLite does so by itself."""
    if session.get_bind().dialect.name != "postgresql":
        return
    for stored in owned_tables().values():
        number = _number_of(stored)
        if number is None or stored.name in LEFT_BEHIND:
            continue
        sequence = session.scalar(select(func.pg_get_serial_sequence(stored.name, number)))
        newest = session.scalar(select(func.max(stored.c[number])))
        if sequence is not None and newest is not None:
            session.execute(select(func.setval(sequence, newest)))


def _number_of(stored: Table) -> str | None:
    """The column that counts a table's rows; None where its key is something else."""
    keys = list(stored.primary_key)
    return keys[0].name if len(keys) == 1 and isinstance(keys[0].type, Integer) and not keys[0].foreign_keys else None


def _manifest(source: Source, revision: str) -> tuple[ExportManifest, str]:
    """What an export says of itself, and the hash of that."""
    try:
        with source.open(MANIFEST) as file:
            content = file.read()
        manifest: ExportManifest = json.loads(content)
        found = manifest["format"], manifest["revision"]
        sums = manifest["tables"]
    except (KeyError, TypeError, ValueError):
        raise ValueError("this is no export of an operator, or one of a release that wrote no manifest.json") from None
    if found != (EXPORT, revision):
        raise ValueError(
            f"the export is {found[0]!r} at revision {found[1]}, this installation is at {revision}: "
            "export it with the release that runs here"
        )
    for name, expected in sums.items():
        hashed = hashlib.sha256()
        try:
            with source.open(f"tables/{name}.jsonl") as file:
                for part in parts_of(file):
                    hashed.update(part)
        except Exception:  # zlib, zipfile and the disk each have errors of their own: all say that it cannot be read
            hashed = hashlib.sha256(b"unreadable")
        if hashed.hexdigest() != expected:
            raise ValueError(f"tables/{name}.jsonl is damaged or missing: nothing was imported")
    return manifest, hashlib.sha256(content).hexdigest()


def _raw_in(source: Source) -> set[str]:
    return {name.removeprefix("raw/") for name in source.names() if name.startswith("raw/")}
