"""What a backup says of itself: who made it of what, every table and every file with size and SHA-256."""

import contextlib
import hashlib
import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, TypedDict, cast

from sqlalchemy import Table

from service.answers.documents import JsonObject
from service.keeping.container import Source, parts_of
from service.keeping.rows import Rows, shape_of
from service.storage.audit_chain import HeadSaid

if TYPE_CHECKING:
    from service.answers import verdicts as answers

MANIFEST = "manifest.json"
FORMAT = "casedrain backup 1"
BUNDLE = "casedrain bundle 1"
AUDIT_KEY_FILE = "audit-key"
RAW_LIST = "raw.jsonl"
"""One raw file a line: its hash and its size [bytes]."""


class TableShape(TypedDict):
    """A table as a manifest names it: pairs of a column and what it holds."""

    table: str
    columns: list[list[str]]


class FileSum(TypedDict):
    """Size [bytes] and SHA-256 of a file."""

    bytes: int
    sha256: str


class DatabaseState(TypedDict):
    """A database: its kind, the revision of its schema, its tables in the order in which they go back."""

    kind: str
    revision: str
    tables: list[TableShape]


class EngineState(TypedDict):
    """The job engine: how many of its migrations have run, its tables."""

    version: int
    tables: list[TableShape]


class Manifest(TypedDict):
    """What every set says of itself; as its file holds it, ``sha256`` stands beside."""

    format: str
    made_at: str
    software: "answers.Software"
    database: DatabaseState
    raw_files: int
    files: dict[str, FileSum]


class BackupManifest(Manifest):
    """A backup's: ``raw_bytes`` in all, ``gaps`` the hashes of raw files that were missing."""

    id: str
    engine: EngineState | None
    audit: HeadSaid
    raw_bytes: int
    gaps: list[str]


class BundleManifest(Manifest):
    """A pump's bundle: whose verdict it holds, and what made that."""

    issued_by: "answers.Software | None"
    operator: str
    pump: str
    pump_id: int
    twin_version: str | None
    threshold_version: int | None


def raw_name(digest: str) -> str:
    """Name of raw bytes in a backup."""
    return f"raw/{digest[:2]}/{digest}"


def rows_name(kind: str, table: str) -> str:
    """Name of a table's rows; ``kind`` is ``rows`` or ``engine``."""
    return f"{kind}/{table}.jsonl"


def sealed(body: Manifest) -> bytes:
    """A manifest as its file holds it, with the hash over itself."""
    return json.dumps({**body, "sha256": _hash(body)}, indent=1, sort_keys=True).encode()


def read_backup(source: Source) -> BackupManifest:
    """The manifest of a backup; raises as ``read_bundle``."""
    return cast("BackupManifest", _read(source, FORMAT))


def read_bundle(source: Source) -> BundleManifest:
    """The manifest of a pump's bundle.

    Raises
    ------
    ValueError
        when there is none, it was changed, or this release does not read its format.
    """
    return cast("BundleManifest", _read(source, BUNDLE))


def _read(source: Source, form: str) -> JsonObject:
    try:
        with source.open(MANIFEST) as file:
            found: JsonObject = json.loads(file.read())
        body = {key: value for key, value in found.items() if key != "sha256"}
    except KeyError:
        raise ValueError("there is no manifest.json: this is none, or one that never came to its end") from None
    except (ValueError, AttributeError, EOFError, OSError):
        raise ValueError("manifest.json is damaged") from None
    if found.get("format") != form:
        raise ValueError(f"manifest.json says format {found.get('format')!r}, wanted is {form!r}")
    if found.get("sha256") != _hash(body):
        raise ValueError("manifest.json was changed: its own hash does not fit")
    return found


def described(table: Table) -> TableShape:
    """A table as a manifest names it, with what its columns hold."""
    shape = shape_of(table)
    return {"table": shape.table, "columns": [list(column) for column in shape.columns]}


def shapes(found: DatabaseState | EngineState) -> list[Rows]:
    """Tables of a set in the order in which they go back."""
    return [Rows(t["table"], tuple((name, what) for name, what in t["columns"])) for t in found["tables"]]


def faults_of_files(source: Source, found: Manifest) -> list[str]:
    """Files that are missing, damaged or too many."""
    faults = []
    named: dict[str, tuple[int, str]] = {n: (f["bytes"], f["sha256"]) for n, f in found["files"].items()}
    there = source.names()
    if RAW_LIST in there:
        with contextlib.suppress(OSError, ValueError, EOFError):  # said below, as a file that is damaged
            named |= {raw_name(digest): (size, digest) for digest, size in raw_files(source)}
    for name, (size, sha256) in named.items():
        if name not in there:
            faults.append(f"{name} is missing")
            continue
        if _sum_of(source, name) != (size, sha256):
            faults.append(f"{name} is damaged: it is not what the manifest says")
    faults += [f"{name} is no part of the backup" for name in sorted(there - set(named) - {MANIFEST})]
    return faults


def raw_files(source: Source) -> list[tuple[str, int]]:
    """Hashes and sizes [bytes] of the raw files of a backup."""
    with source.open(RAW_LIST) as file:
        return [(str(digest), int(size)) for digest, size in map(json.loads, file)]


def _sum_of(source: Source, name: str) -> tuple[int, str] | None:
    hashed, n_bytes = hashlib.sha256(), 0
    try:
        with source.open(name) as file:
            for part in parts_of(file):
                hashed.update(part)
                n_bytes += len(part)
    except Exception:  # zlib, zipfile and the disk each have errors of their own: all say that it cannot be read
        return None
    return n_bytes, hashed.hexdigest()


def _hash(body: Mapping[str, object]) -> str:
    return hashlib.sha256(json.dumps(body, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
