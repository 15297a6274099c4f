"""Whether an installation or a backup is whole: every fault named, nothing changed."""

import re
import tempfile
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypedDict

from sqlalchemy import Connection, exists, select

from service.access.audit_proof import Findings, Verified, verify_database
from service.errors import Unavailable
from service.keeping.consistent import consistent, engine_is_read
from service.keeping.container import Source, read
from service.keeping.installation import Installation
from service.keeping.manifest import AUDIT_KEY_FILE, faults_of_files, raw_files, read_backup
from service.keeping.needs import needed, welcome
from service.keeping.restore import fill_sqlite
from service.storage.audit_anchor import Anchor, read_anchor
from service.storage.audit_key import AuditKey
from service.storage.database import Database, upgrade
from service.storage.tables import ANALYSED, Job, Pump, Record, StoredAssessment

IN_FLIGHT_S = 3600.0
"""Bytes stand in the store before their row does: so long nobody calls them orphans (our choice)."""
_NAME = re.compile(r"[0-9a-f]{2}/([0-9a-f]{64})")


class CheckSaid(TypedDict):
    """A check as JSON: counts, bytes of raw files, the audit log's verification, sentences."""

    whole: bool
    records: int
    raw_files: int
    raw_bytes: int
    audit: Verified | None
    faults: list[str]
    remarks: list[str]


@dataclass(slots=True)
class Checked:
    """What a check found: counts of what was looked at, and every fault as a sentence."""

    records: int = 0
    raw_files: int = 0
    raw_bytes: int = 0
    audit: Findings | None = None
    faults: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    def to_json(self) -> CheckSaid:
        """As the command line says it."""
        return {
            "whole": not self.faults,
            "records": self.records,
            "raw_files": self.raw_files,
            "raw_bytes": self.raw_bytes,
            "audit": self.audit.to_json() if self.audit else None,
            "faults": self.faults,
            "remarks": self.remarks,
        }


def check_installation(kept: Installation, anchors: Iterable[Anchor] = ()) -> Checked:
    """Check a living installation: database, engine, every raw file against its name, the audit log."""
    found = Checked()
    # the store first: what comes in afterwards has its row in a later state and is not missed
    listed = list(kept.raw_store.files())
    with consistent(kept.database) as state:
        if state.engine is not None:
            _sound(state.engine, "job engine", found)
        engine_is_read(kept.database, state)
        _sound(state.main, "database", found)
        wanted = needed(state.main)
        known = set(wanted) | set(welcome(state.main))
        _rows(state.main, found)
    there = {named[1] for path, _ in listed if (named := _NAME.fullmatch(path))}
    spare = dict.fromkeys(sorted(there & known - set(wanted)), "a job that has ended, or of a record")
    for digest, who in (wanted | spare).items():
        try:
            found.raw_bytes += sum(len(part) for part in kept.raw_store.chunks(digest))
            found.raw_files += 1
        except Unavailable as problem:
            with kept.database.engine.connect() as connection:
                if digest in needed(connection) or kept.raw_store.has(digest):  # else it went while we looked
                    found.faults.append(f"raw bytes of {who}: {problem.detail}")
    _orphans(listed, known, found)
    _chain(kept.database, kept.audit_key.public, [*_anchor(kept.folder, found), *anchors], found)
    return found


def check_backup(place: Path, public_key: str | None = None) -> Checked:
    """Check a backup: its files, its rows and its audit log; rows are filled into a file of their own for that.

    Raises
    ------
    ValueError
        when there is no backup at the place that this release reads.
    """
    found = Checked()
    with read(place) as source:
        manifest = read_backup(source)
        found.faults += faults_of_files(source, manifest)
        found.faults += [f"raw bytes {digest} were missing when the backup was made" for digest in manifest["gaps"]]
        if any(".jsonl" in fault for fault in found.faults):
            return found
        raw = raw_files(source)
        found.raw_files, found.raw_bytes = len(raw), sum(size for _, size in raw)
        if public_key is None:
            public_key = _key_in(source)
        with tempfile.TemporaryDirectory(prefix="casedrain-check-") as folder:
            file = Path(folder) / "rows.sqlite"
            fill_sqlite(source, manifest, file)
            upgrade(f"sqlite:///{file}")
            database = Database(f"sqlite:///{file}")
            try:
                _filled(database, {digest for digest, _ in raw} | set(manifest["gaps"]), found)
                head = manifest["audit"]
                anchor = Anchor(head["chain_id"], head["count"], head["link"])
                _chain(database, public_key, [anchor], found)
            finally:
                database.close()
    return found


def _filled(database: Database, raw: set[str], found: Checked) -> None:
    with database.engine.connect() as connection:
        _sound(connection, "database", found)
        _rows(connection, found)
        wanted = needed(connection)
        known = set(wanted) | set(welcome(connection))
    found.faults += [f"raw bytes of {who} are missing: {d}" for d, who in wanted.items() if d not in raw]
    found.faults += [f"raw bytes {digest} belong to nothing" for digest in sorted(raw - known)]


def _sound(connection: Connection, what: str, found: Checked) -> None:
    """Ask the database itself; Postgres holds what refers to what by itself, and its pages are its own to check."""
    if connection.dialect.name != "sqlite":
        return
    for (said,) in connection.exec_driver_sql("PRAGMA integrity_check").all():
        if said != "ok":
            found.faults.append(f"{what}: {said}")
    for table, row, parent, _ in connection.exec_driver_sql("PRAGMA foreign_key_check").all():
        found.faults.append(f"{what}: row {row} of {table} refers to a row of {parent} that is not there")


def _rows(connection: Connection, found: Checked) -> None:
    found.records = len(connection.execute(select(Record.id)).all())
    judged = exists().where(StoredAssessment.record_id == Record.id)
    waits = select(Record.id).join(Pump, Pump.id == Record.pump_id)
    alone = waits.where(Record.status == ANALYSED, Record.reduction.is_not(None), ~judged, Pump.made_with.is_not(None))
    found.faults += [f"record {i} is analysed and has no verdict" for i in connection.scalars(alone)]
    unfinished = connection.execute(select(Job.id).where(Job.finished_at.is_(None))).all()
    if unfinished:
        found.remarks.append(f"{len(unfinished)} jobs have still to come to their end: the next start takes them up")


def _orphans(listed: Iterable[tuple[str, float | None]], known: set[str], found: Checked) -> None:
    now = time.time()
    for path, written_at in listed:
        named = _NAME.fullmatch(path)
        if named is not None and named[1] in known:
            continue
        if written_at is not None and now - written_at < IN_FLIGHT_S:
            continue
        what = "belongs to nothing" if named else "is no raw file: a process was killed over it, or it is not ours"
        found.faults.append(f"{path} in the raw store {what}")


def _chain(database: Database, public_key: str | None, anchors: list[Anchor], found: Checked) -> None:
    found.audit = verify_database(database, public_key, anchors)
    found.faults += [f"audit log: {fault}" for fault in found.audit.to_json()["faults"]]


def _anchor(folder: Path, found: Checked) -> list[Anchor]:
    try:
        anchor = read_anchor(folder)
    except ValueError as fault:
        found.faults.append(str(fault))
        return []
    return [anchor] if anchor else []


def _key_in(source: Source) -> str | None:
    """Public key of the signing key that a backup carries; None where the environment holds it."""
    if AUDIT_KEY_FILE not in source.names():
        return None
    with source.open(AUDIT_KEY_FILE) as file:
        return AuditKey(file.read().decode("ascii"), Path()).public
