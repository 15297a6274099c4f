"""Parquet: one table of channels, metadata in the schema's key-value pairs; needs the extra ``parquet``."""

import io
from typing import Any

import numpy as np

from service.errors import Fault, Undecodable, UnknownType
from service.ingest.raw import Limits, RawFile, Table, check_size


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
        table = file.read()
    except (pa.ArrowException, OSError, ValueError) as error:
        raise Undecodable("the body is not a readable Parquet file", [Fault("body", str(error)[:200])]) from None
    metadata: dict[str, Any] = {
        key.decode(errors="replace"): value.decode(errors="replace")
        for key, value in (table.schema.metadata or {}).items()
        if not key.startswith((b"ARROW:", b"pandas"))
    }
    channels: dict[str, Any] = {}
    faults: list[Fault] = []
    for name, column in zip(table.column_names, table.columns, strict=True):
        if name in channels:
            faults.append(Fault(f"column {name}", "appears twice"))
            continue
        if pa.types.is_integer(column.type) or pa.types.is_floating(column.type) or pa.types.is_null(column.type):
            channels[name] = np.array(column.cast(pa.float64()).to_numpy(), dtype=np.float64)
        else:
            faults.append(Fault(f"column {name}", f"holds {column.type}, not numbers"))
    return RawFile(metadata, (Table(channels),), faults)
