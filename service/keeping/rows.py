"""Rows of any table as JSON lines and back, to the last digit, from either database into either.

Values of JSON columns travel as the text that the database holds: an empty column and a JSON null stay two things.
"""

import base64
import json
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from typing import Any, NamedTuple

from sqlalchemy import (
    Column,
    ColumnElement,
    Connection,
    DateTime,
    LargeBinary,
    Table,
    Text,
    TypeDecorator,
    bindparam,
    cast,
    column,
    insert,
    select,
    table,
    type_coerce,
)
from sqlalchemy.dialects.postgresql import JSONB
from sqlalchemy.types import JSON

from service.answers.documents import RowValues
from service.storage.tables import UtcDateTime

PLAIN, AS_JSON, INSTANT, BYTES = "plain", "json", "instant", "bytes"
SKIPPED = "skipped"
"""What a column holds that goes nowhere: the other database has none of its name."""
_BATCH = 1000


class Rows(NamedTuple):
    """One table of a set: its columns with what they hold (``plain``, ``json``, ``instant``, ``bytes``)."""

    table: str
    columns: tuple[tuple[str, str], ...]
    schema: str | None = None


def shape_of(stored: Table) -> Rows:
    """Shape of a table, as tables or a look into the database describe it."""
    columns = tuple((c.name, _kind(c)) for c in stored.c if c.computed is None)
    return Rows(stored.name, columns, stored.schema)


def lines_of(connection: Connection, stored: Table, which: ColumnElement[bool] | None = None) -> Iterator[bytes]:
    """Rows of a table in the order of its key, all or some, one JSON array a line; few of them in memory at a time."""
    shape = shape_of(stored)
    is_postgres = connection.dialect.name == "postgresql"
    chosen: list[ColumnElement[Any]] = []
    for name, kind in shape.columns:
        held = stored.c[name]
        as_text = cast(held, Text) if is_postgres else type_coerce(held, Text)
        chosen.append(as_text if kind == AS_JSON else held)
    query = select(*chosen).order_by(*stored.primary_key)
    if which is not None:
        query = query.where(which)
    kinds = [kind for _, kind in shape.columns]
    with connection.execute(query.execution_options(yield_per=_BATCH)) as result:
        for rows in result.partitions(_BATCH):
            lines = [json.dumps([_out(k, v) for k, v in zip(kinds, row, strict=True)]) for row in rows]
            yield ("\n".join(lines) + "\n").encode()


def load(connection: Connection, shape: Rows, lines: Iterable[bytes]) -> int:
    """Insert rows that ``lines_of`` has given; how many they were.

    Raises
    ------
    ValueError
        when a line is no row of that shape.
    """
    is_postgres = connection.dialect.name == "postgresql"
    kept = [(name, kind) for name, kind in shape.columns if kind != SKIPPED]
    light = table(shape.table, *(_light(name, kind) for name, kind in kept), schema=shape.schema)
    values = {
        name: cast(bindparam(name, type_=Text()), JSONB) if is_postgres and kind == AS_JSON else bindparam(name)
        for name, kind in kept
    }
    statement = insert(light).values(values)
    n_rows = 0
    for batch in _batches(lines):
        connection.execute(statement, [_in(shape, line) for line in batch])
        n_rows += len(batch)
    return n_rows


def _light(name: str, kind: str) -> Any:
    if kind == INSTANT:
        return column(name, UtcDateTime())
    if kind == BYTES:
        return column(name, LargeBinary())
    return column(name, Text()) if kind == AS_JSON else column(name)


def _kind(held: Column[Any]) -> str:
    kind = held.type.impl_instance if isinstance(held.type, TypeDecorator) else held.type
    if isinstance(kind, JSON):
        return AS_JSON
    if isinstance(kind, DateTime):
        return INSTANT
    return BYTES if isinstance(kind, LargeBinary) else PLAIN


def _out(kind: str, value: Any) -> Any:
    if isinstance(value, datetime):
        return (value if value.tzinfo else value.replace(tzinfo=UTC)).astimezone(UTC).isoformat()
    if kind == BYTES and value is not None:
        return base64.b64encode(value).decode("ascii")
    return value


def _in(shape: Rows, line: bytes) -> RowValues:
    found = json.loads(line)
    if not isinstance(found, list) or len(found) != len(shape.columns):
        raise ValueError(f"a line of {shape.table} has not its {len(shape.columns)} columns")
    row: RowValues = {}
    for (name, kind), value in zip(shape.columns, found, strict=True):
        if kind == SKIPPED:
            continue
        if value is not None and kind == INSTANT:
            row[name] = datetime.fromisoformat(value)
        elif value is not None and kind == BYTES:
            row[name] = base64.b64decode(value)
        else:
            row[name] = value
    return row


def _batches(lines: Iterable[bytes]) -> Iterator[list[bytes]]:
    batch: list[bytes] = []
    for line in lines:
        if line.strip():
            batch.append(line)
        if len(batch) == _BATCH:
            yield batch
            batch = []
    if batch:
        yield batch
