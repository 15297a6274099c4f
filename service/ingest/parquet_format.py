"""Parquet: a table of columns, nested ones by their leaves, metadata in the schema's pairs; needs the extra ``parquet``.

A file of one row whose columns are lists is a table of those lists; a struct of lists, or a list of structs, is a table
of its own in it.
"""

import io
import json
from collections import Counter
from collections.abc import Collection
from typing import Any

import numpy as np

from service.errors import Fault, Undecodable, UnknownType
from service.ingest.nested import MOST_TEXTS
from service.ingest.raw import ForeignMetadata, Limits, RawFile, Samples, Table, check_size
from service.ingest.time_words import clock_in, clock_of_instants, is_time_name, texts_of_instants
from twin.recording import TIME

_DEEPEST = 10
_UNITS = (b"unit", b"units", b"Unit", b"Units")
Columns = dict[str, Any]


def parsed(content: bytes, limits: Limits) -> RawFile:
    """Read a Parquet record; the row count is read from the footer before anything is decoded.

    Raises
    ------
    UnknownType
        when pyarrow is not installed.
    Undecodable, TooLarge
        when it is no Parquet file, or is larger than the limits.
    """
    try:
        import pyarrow as pa  # noqa: PLC0415 - an extra
        import pyarrow.parquet as pq  # noqa: PLC0415
    except ImportError:
        raise UnknownType("reading Parquet needs the extra: pip install 'casedrain[parquet]'") from None
    try:
        file = pq.ParquetFile(io.BytesIO(content))
        check_size(file.metadata.num_rows, file.metadata.num_columns, limits)
        return _Reader(pa, limits).file(file.read())
    except (pa.ArrowException, OSError) as error:
        raise Undecodable("the body is not a readable Parquet file", [Fault("body", str(error)[:200])]) from None


class _Reader:
    """One file's columns, flattened to their leaves and told apart by type."""

    def __init__(self, pa: Any, limits: Limits) -> None:
        self._pa, self._limits = pa, limits
        self._not_kept: dict[str, str] = {}
        self._index: Collection[str] = ()

    def file(self, table: Any) -> RawFile:
        """The table and those that are nested in its single row."""
        metadata = {
            key.decode(errors="replace"): value.decode(errors="replace")
            for key, value in (table.schema.metadata or {}).items()
            if not key.startswith((b"ARROW:", b"pandas"))
        }
        self._index = _index_of_pandas(table.schema.metadata or {})
        names = Counter(table.column_names)
        faults = [Fault(f"column {name}", "appears twice") for name, n in names.items() if n > 1]
        columns, units = self._leaves(table)
        if table.num_rows == 1 and any(self._is_list(column.type) for column in columns.values()):
            tables = self._nested(columns, units, metadata)
        else:
            leaf = Counter(path.rpartition(".")[2] for path in columns)
            short = {path: path.rpartition(".")[2] for path in columns}
            named = {short[p] if leaf[short[p]] == 1 or p == short[p] else p: p for p in columns}
            tables = [
                self._table(
                    "", {n: columns[p] for n, p in named.items()}, {n: units.get(p, "") for n, p in named.items()}
                )
            ]
        return RawFile(metadata, tuple(tables), faults, self._not_kept)

    def _leaves(self, table: Any) -> tuple[Columns, dict[str, str]]:
        """Columns by their dotted path, structs opened, and the units that their fields state."""
        for _ in range(_DEEPEST):
            if not any(self._pa.types.is_struct(kind) for kind in table.schema.types):
                break
            table = table.flatten()
        units = {}
        for entry in table.schema:
            stated = next((entry.metadata[key] for key in _UNITS if entry.metadata and key in entry.metadata), b"")
            if stated:
                units[entry.name] = stated.decode(errors="replace").strip()
        return dict(zip(table.column_names, table.columns, strict=True)), units

    def _nested(self, columns: Columns, units: dict[str, str], metadata: ForeignMetadata) -> list[Table]:
        """Tables of a file of one row: lists by the struct that holds them, each list of structs a table."""
        groups: dict[str, Columns] = {}
        for path, column in columns.items():
            where, _, name = path.rpartition(".")
            if not self._is_list(column.type):
                value = column[0].as_py()
                if isinstance(value, (str, int, float)):
                    metadata.setdefault(name, value)
                continue
            values = column.combine_chunks().flatten()
            check_size(len(values), 1, self._limits)
            if self._pa.types.is_struct(values.type):
                inner, stated = self._leaves(self._pa.Table.from_struct_array(values))
                check_size(len(values), len(inner), self._limits)
                groups.setdefault(path, {}).update(inner)
                units |= {f"{path}.{n}": unit for n, unit in stated.items()}
            else:
                groups.setdefault(where, {})[name] = values
        return [
            self._table(where, held, {n: units.get(f"{where}.{n}" if where else n, "") for n in held})
            for where, held in groups.items()
        ]

    def _table(self, name: str, columns: Columns, units: dict[str, str]) -> Table:
        channels: dict[str, Samples] = {}
        texts: dict[str, list[str | None]] = {}
        time = start = None
        for column, stored in columns.items():
            coded = self._pa.types.is_dictionary(stored.type)
            values = stored.cast(stored.type.value_type) if coded else stored
            kind = values.type
            if self._pa.types.is_timestamp(kind) or self._pa.types.is_date(kind):
                instants, utc = self._instants(values, kind)
                clock = clock_of_instants(instants, utc=utc)
                if clock is not None and self._may_be_a_clock(column) and (column == TIME or TIME not in columns):
                    time, start = clock
                self._say(column, texts, instants, utc)
            elif self._pa.types.is_duration(kind):
                channels[column] = self._seconds(values)
                units[column] = "s"
            elif (numbers := self._numbers(values, kind)) is not None:
                channels[column] = numbers
            elif self._pa.types.is_string(kind) or self._pa.types.is_large_string(kind):
                if len(values) <= MOST_TEXTS:
                    texts[column] = values.to_pylist()
                else:
                    self._not_kept[column] = "text"
            else:
                self._not_kept[column] = f"of the type {kind}"[:100]
        units = {n: unit for n, unit in units.items() if unit and n in channels}
        if time is None and TIME not in channels:
            stated = next((n for n in channels if is_time_name(n) and clock_in(channels[n], units.get(n, ""))), None)
            clock = clock_in(channels[stated], units[stated]) if stated is not None else None
            time, start = clock or (None, None)
        return Table(channels, texts, name, time, start, units=units)

    def _may_be_a_clock(self, column: str) -> bool:
        return is_time_name(column) or column in self._index

    def _instants(self, values: Any, kind: Any) -> tuple[Any, bool]:
        """Column as datetime64, shape (n,), and whether that is UTC: Parquet keeps instants with a zone so."""
        if self._pa.types.is_date(kind):
            return self._numpy(values.cast(self._pa.timestamp("us"))), False
        return self._numpy(values), kind.tz is not None

    def _say(self, column: str, texts: dict[str, list[str | None]], instants: Any, zoned: bool) -> None:
        if len(instants) <= MOST_TEXTS:
            texts[column] = texts_of_instants(instants, utc=zoned)
        else:
            self._not_kept[column] = "instants"

    def _numbers(self, values: Any, kind: Any) -> Any:
        """Column as float64, shape (n,); None for what is no number."""
        types = self._pa.types
        if types.is_integer(kind) or types.is_floating(kind) or types.is_null(kind) or types.is_decimal(kind):
            # an integer beyond 2^53 loses its last digits as a float, which no channel of ours has
            numbers = values.cast(self._pa.float64(), safe=False)
        elif types.is_boolean(kind):
            numbers = values.cast(self._pa.uint8()).cast(self._pa.float64())
        else:
            return None
        return np.array(self._numpy(numbers), dtype=np.float64)

    def _seconds(self, values: Any) -> Any:
        durations = self._numpy(values)
        unit = np.datetime_data(durations.dtype)[0]
        seconds = durations.astype(np.int64) / {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}[unit]
        return np.where(np.isnat(durations), np.nan, seconds)

    def _is_list(self, kind: Any) -> bool:
        types = self._pa.types
        return bool(types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind))

    @staticmethod
    def _numpy(values: Any) -> Any:
        return values.to_numpy() if hasattr(values, "chunks") else values.to_numpy(zero_copy_only=False)


def _index_of_pandas(metadata: dict[bytes, bytes]) -> list[str]:
    """Columns that pandas wrote as the index of a frame, whatever they are called."""
    try:
        columns = json.loads(metadata.get(b"pandas", b"{}")).get("index_columns", [])
    except (ValueError, AttributeError, RecursionError):
        return []
    return [name for name in columns if isinstance(name, str)] if isinstance(columns, list) else []
