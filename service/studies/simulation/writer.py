"""Flight records written piece by piece, as the readers of ``service.ingest`` take them."""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self

import numpy as np

from twin.recording import TIME, Recording

SUFFIXES = (".parquet", ".csv")
ROW_GROUP = 65_536
"""Rows that are held before they are written: some ten megabytes."""
# 1e-9 of a value; of time a microsecond in an hour, and more
_FORMAT, _TIME_FORMAT = "%.9g", "%.13g"


class Writer(Protocol):
    """Takes the pieces of one recording."""

    def append(self, piece: Recording) -> None:
        """Write a piece."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class CsvWriter:
    """CSV with the metadata in leading lines."""

    def __init__(self, path: Path, names: list[str], metadata: Mapping[str, str]) -> None:
        self._names = names
        self._formats = [_TIME_FORMAT if name == TIME else _FORMAT for name in names]
        self._file = path.open("w", encoding="utf-8", newline="\n")
        for key, value in metadata.items():
            # a line each, whatever kinds of line break a title holds
            self._file.write(f"# {key}: {' '.join(value.splitlines())}\n")
        self._file.write(",".join(names) + "\n")

    def append(self, piece: Recording) -> None:
        """Write a piece."""
        table = np.column_stack([piece[name] for name in self._names])
        np.savetxt(self._file, table, self._formats, delimiter=",")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()


class ParquetWriter:
    """Parquet with the metadata in the schema, a row group at a time."""

    def __init__(self, path: Path, names: list[str], metadata: Mapping[str, str]) -> None:
        try:
            import pyarrow as pa  # noqa: PLC0415 - an extra
            import pyarrow.parquet as pq  # noqa: PLC0415
        except ImportError:
            raise RuntimeError("writing Parquet needs the extra: pip install 'casedrain[parquet]'") from None
        self._table = pa.table
        self._names = names
        self._schema = pa.schema([(name, pa.float64()) for name in names], metadata=dict(metadata))
        self._writer: Any = pq.ParquetWriter(path, self._schema)
        self._waiting: list[Recording] = []

    def append(self, piece: Recording) -> None:
        """Write a piece, or keep it until there are rows enough for a group."""
        self._waiting.append(piece)
        if sum(map(len, self._waiting)) >= ROW_GROUP:
            self._flush()

    def _flush(self) -> None:
        columns = {name: np.concatenate([piece[name] for piece in self._waiting]) for name in self._names}
        self._writer.write_table(self._table(columns, schema=self._schema))
        self._waiting = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None and self._waiting:
            self._flush()
        self._writer.close()


@contextmanager
def record_writer(path: Path, names: list[str], metadata: Mapping[str, str]) -> Iterator[Writer]:
    """Writer by the suffix of ``path``; the file gets its name when it is whole, and leaves nothing behind if it fails.

    Raises
    ------
    RuntimeError
        when Parquet is asked for and its reader is not installed.
    """
    kind = ParquetWriter if path.suffix.lower() == ".parquet" else CsvWriter
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with kind(unfinished, names, metadata) as writer:
            yield writer
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)
