"""Everything that belongs to an operator as one ZIP: rows as JSON lines, raw bytes as they came."""

import base64
import hashlib
import io
import json
import zipfile
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, TypedDict

from sqlalchemy import Table, select

from service.answers.documents import RowValues
from service.errors import Unavailable
from service.identity import software
from service.registry.ownership import owned_tables, rows_of
from service.storage.database import Database
from service.storage.raw_store import RawStore

if TYPE_CHECKING:
    from service.answers import verdicts as answers

_SECRET_COLUMNS = frozenset({"key_hash", "password_hash", "token_hash", "csrf_token", "secret"})
"""Never leave the database, not even for their owner."""
EXPORT = "casedrain export 1"
MANIFEST = "manifest.json"
_BATCH = 200
"""Rows that a stream fetches at once (our choice)."""


class ExportManifest(TypedDict):
    """What an export says of itself: the schema's revision, and SHA-256 of each table's file."""

    format: str
    operator: str
    made_at: str
    software: "answers.Software"
    revision: str | None
    tables: dict[str, str]


class _Drain(io.RawIOBase):
    """What the ZIP writer has written since it was last asked; it cannot seek, so the ZIP is streamed."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []

    def writable(self) -> bool:
        return True

    def write(self, data: Any) -> int:
        self._parts.append(bytes(data))
        return len(data)

    def fresh_bytes(self) -> bytes:
        """Bytes since the last call."""
        found = b"".join(self._parts)
        self._parts.clear()
        return found


def export_stream(database: Database, raw_store: RawStore, operator: str) -> Iterator[bytes]:
    """Bytes of the ZIP, one row batch and one raw file in memory at a time.

    ``tables/<name>.jsonl`` holds one row a line, ``raw/<sha256>`` the uploads, ``manifest.json`` at the end the hash of
    each table's file: `casedrain import-operator` takes it in. Raw bytes that are no longer there
    (retention, damage) are listed in ``missing.txt``.
    """
    drain = _Drain()
    digests: dict[str, None] = {}
    missing: list[str] = []
    sums: dict[str, str] = {}
    with zipfile.ZipFile(drain, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, table in owned_tables().items():
            hashed = hashlib.sha256()
            with archive.open(f"tables/{name}.jsonl", "w", force_zip64=True) as file:
                for row in _rows(database, table, operator):
                    digests |= {row["content_hash"]: None} if name == "records" else {}
                    line = json.dumps(row, default=_as_json).encode() + b"\n"
                    hashed.update(line)
                    file.write(line)
                    yield drain.fresh_bytes()
            sums[name] = hashed.hexdigest()
        for digest in digests:
            try:
                content = raw_store.get(digest)
            except Unavailable as problem:
                missing.append(f"{digest}: {problem.detail}")
                continue
            archive.writestr(f"raw/{digest}", content)
            yield drain.fresh_bytes()
        if missing:
            archive.writestr("missing.txt", "\n".join(missing) + "\n")
        archive.writestr(MANIFEST, json.dumps(_manifest(database, operator, sums), indent=1))
    yield drain.fresh_bytes()


def _manifest(database: Database, operator: str, sums: dict[str, str]) -> ExportManifest:
    return {
        "format": EXPORT,
        "operator": operator,
        "made_at": datetime.now(UTC).isoformat(),
        "software": software().to_json(),
        "revision": database.revision(),
        "tables": sums,
    }


def _rows(database: Database, table: Table, operator: str) -> Iterator[RowValues]:
    columns = [column for column in table.c if column.name not in _SECRET_COLUMNS]
    query = select(*columns).where(rows_of(table, operator)).order_by(*table.primary_key)
    with database.reading() as session:
        for row in session.execute(query.execution_options(yield_per=_BATCH)):
            yield dict(row._mapping)


def _as_json(value: Any) -> Any:
    if isinstance(value, bytes):
        return base64.b64encode(value).decode("ascii")
    return value.astimezone(UTC).isoformat() if isinstance(value, datetime) else str(value)
