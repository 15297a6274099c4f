"""A backup: database, job engine and raw bytes as one consistent set, made while the service works."""

import json
import uuid
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path

from alembic.migration import MigrationContext

from service.errors import Unavailable
from service.identity import software
from service.keeping.consistent import State, consistent, engine_is_read, engine_version
from service.keeping.container import Target, Written, written
from service.keeping.installation import Installation
from service.keeping.manifest import (
    AUDIT_KEY_FILE,
    FORMAT,
    MANIFEST,
    RAW_LIST,
    BackupManifest,
    EngineState,
    described,
    raw_name,
    rows_name,
    sealed,
)
from service.keeping.needs import needed, welcome
from service.keeping.rows import lines_of
from service.storage.audit_chain import HEAD_ID, head_of
from service.storage.raw_store import RawStore
from service.storage.tables import AuditHead, Backup, Base

_ATTEMPTS = 3
"""Bytes may leave by retention or deletion after the state was taken: then another one is."""
_MOST_NAMED = 5


class _StaleError(Exception):
    """Bytes of the state are gone."""


def make_backup(kept: Installation, place: Path, *, with_gaps: bool = False) -> BackupManifest:
    """Write a backup to a folder, or to one file where ``place`` ends in ``.zip``; gives its manifest.

    It appears under its name when it is whole. That it was made is noted in the database, so that who deletes an
    operator is told of it.

    Raises
    ------
    ValueError
        when raw bytes are missing or damaged, unless ``with_gaps`` leaves them out and says so.
    FileExistsError
        when something is at the place already.
    """
    backup_id = uuid.uuid4().hex
    with kept.database.writing() as session:
        row = Backup(id=backup_id, started_at=datetime.now(UTC), finished_at=None, removed_at=None, place=str(place))
        session.add(row)
    try:
        manifest = _attempted(kept, place, backup_id, with_gaps)
    except BaseException:
        with kept.database.writing() as session:
            session.delete(session.get_one(Backup, backup_id))
        raise
    with kept.database.writing() as session:
        session.get_one(Backup, backup_id).finished_at = datetime.now(UTC)
    return manifest


def forget_backup(kept: Installation, backup_id: str) -> None:
    """Note that a backup is no more.

    Raises
    ------
    ValueError
        when there is none of that id.
    """
    with kept.database.writing() as session:
        row = session.get(Backup, backup_id)
        if row is None:
            raise ValueError(f"there is no backup {backup_id}")
        row.removed_at = datetime.now(UTC)


def _attempted(kept: Installation, place: Path, backup_id: str, with_gaps: bool) -> BackupManifest:
    for attempt in range(_ATTEMPTS):
        try:
            with written(place) as target:
                return _write(kept, target, backup_id, with_gaps)
        except _StaleError as gone:
            if attempt == _ATTEMPTS - 1:
                raise ValueError(str(gone)) from None
    raise AssertionError("unreachable")


def _write(kept: Installation, target: Target, backup_id: str, with_gaps: bool) -> BackupManifest:
    files: dict[str, Written] = {}

    def add(name: str, parts: Iterator[bytes]) -> None:
        files[name] = target.add(name, parts)

    made_at = datetime.now(UTC)
    with consistent(kept.database) as state:
        engine = _engine(state, add)
        engine_is_read(kept.database, state)
        tables = []
        for table in Base.metadata.sorted_tables:
            add(rows_name("rows", table.name), lines_of(state.main, table))
            tables.append(described(table))
        head = state.main.execute(AuditHead.__table__.select().where(AuditHead.id == HEAD_ID)).one()
        revision = MigrationContext.configure(state.main).get_current_revision() or "base"
        wanted, spare = needed(state.main), set(welcome(state.main))
    raw, gaps = _raw(kept.raw_store, target, wanted, spare - set(wanted))
    if gaps:
        _judge(kept, gaps, with_gaps)
    lines = (json.dumps([digest, size]).encode() + b"\n" for digest, size in sorted(raw.items()))
    add(RAW_LIST, lines)
    if kept.audit_key.file is not None and kept.audit_key.file.exists():
        add(AUDIT_KEY_FILE, iter([kept.audit_key.file.read_bytes()]))
    body: BackupManifest = {
        "format": FORMAT,
        "id": backup_id,
        "made_at": made_at.isoformat(),
        "software": software().to_json(),
        "database": {"kind": state.main.dialect.name, "revision": revision, "tables": tables},
        "engine": engine,
        "audit": head_of(head).to_json(),  # type: ignore[arg-type]
        "raw_files": len(raw),
        "raw_bytes": sum(raw.values()),
        "gaps": sorted(gaps),
        "files": {name: {"bytes": done.n_bytes, "sha256": done.sha256} for name, done in files.items()},
    }
    target.add(MANIFEST, iter([sealed(body)]))
    return body


def _engine(state: State, add: Callable[[str, Iterator[bytes]], None]) -> EngineState | None:
    if state.engine is None:
        return None
    tables = []
    for table in state.engine_tables:
        add(rows_name("engine", table.name), lines_of(state.engine, table))
        tables.append(described(table))
    return {"version": engine_version(state.engine), "tables": tables}


def _raw(
    store: RawStore, target: Target, wanted: dict[str, str], spare: set[str]
) -> tuple[dict[str, int], dict[str, str]]:
    """Copy raw bytes, whole or not at all: sizes by hash, and those that are needed and cannot be had, with who needs them."""
    sizes: dict[str, int] = {}
    gaps: dict[str, str] = {}
    for digest in [*wanted, *sorted(spare)]:
        try:
            for _ in store.chunks(digest):  # a damaged file shows at its end only, and a ZIP takes nothing back
                pass
            sizes[digest] = target.add(raw_name(digest), store.chunks(digest)).n_bytes
        except Unavailable:
            if digest in wanted:
                gaps[digest] = wanted[digest]
    return sizes, gaps


def _judge(kept: Installation, gaps: dict[str, str], with_gaps: bool) -> None:
    with kept.database.engine.connect() as connection:
        still = needed(connection)
    if any(digest not in still for digest in gaps):
        raise _StaleError(
            "raw bytes go faster than they can be copied: a retention or a deletion is at work, try later"
        )
    if not with_gaps:
        named = "; ".join(f"{digest} of {who}" for digest, who in sorted(gaps.items())[:_MOST_NAMED])
        raise ValueError(
            f"{len(gaps)} raw files are missing or damaged, nothing was written: {named}. "
            "`casedrain check` lists all; with --with-gaps the rest is kept"
        )
