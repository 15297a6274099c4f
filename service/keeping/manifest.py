"""What a backup says of itself: who made it of what, every table and every file with size and SHA-256."""

import contextlib
import hashlib
import json
from typing import Any, cast

from sqlalchemy import Table

from service.keeping.container import Source, parts_of
from service.keeping.rows import Rows, shape_of

MANIFEST = "manifest.json"
FORMAT = "casedrain backup 1"
BUNDLE = "casedrain bundle 1"
AUDIT_KEY_FILE = "audit-key"
RAW_LIST = "raw.jsonl"
"""One raw file a line: its hash and its size [bytes]."""


def raw_name(digest: str) -> str:
    """Name of raw bytes in a backup."""
    return f"raw/{digest[:2]}/{digest}"


def rows_name(kind: str, table: str) -> str:
    """Name of a table's rows; ``kind`` is ``rows`` or ``engine``."""
    return f"{kind}/{table}.jsonl"


def sealed(body: dict[str, Any]) -> bytes:
    """A manifest as its file holds it, with the hash over itself."""
    return json.dumps({**body, "sha256": _hash(body)}, indent=1, sort_keys=True).encode()


def read_manifest(source: Source, form: str = FORMAT) -> dict[str, Any]:
    """The manifest of a backup, or of another set whose format is ``form``.

    Raises
    ------
    ValueError
        when there is none, it was changed, or this release does not read its format.
    """
    try:
        with source.open(MANIFEST) as file:
            found = cast("dict[str, Any]", json.loads(file.read()))
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


def described(table: Table) -> dict[str, Any]:
    """A table as a manifest names it, with what its columns hold."""
    shape = shape_of(table)
    return {"table": shape.table, "columns": [list(column) for column in shape.columns]}


def shapes(found: dict[str, Any], kind: str) -> list[Rows]:
    """Tables of a backup in the order in which they go back; ``kind`` is ``database`` or ``engine``."""
    tables = found[kind]["tables"] if found[kind] else []
    return [Rows(t["table"], tuple((name, what) for name, what in t["columns"])) for t in tables]


def faults_of_files(source: Source, found: dict[str, Any]) -> list[str]:
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


def _hash(body: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(body, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
