"""Parquet: one table of channels, metadata in the schema's key-value pairs; needs the extra ``parquet``."""

import io
from typing import Any

import numpy as np

from service.errors import Fault, TooLarge, Undecodable, UnknownType
from service.ingest.raw import RawRecord

CONTENT_TYPES = ("application/vnd.apache.parquet",)
_MAGIC = b"PAR1"


def recognises(content: bytes) -> bool:
    """Whether the bytes begin like a Parquet file."""
    return content.startswith(_MAGIC)


def parsed(content: bytes, max_rows: int) -> RawRecord:
    """Read a Parquet record; the row count is read from the footer before anything is decoded.

    Raises
    ------
    UnknownType
        when pyarrow is not installed.
    Undecodable, TooLarge
        when it is no Parquet file, or has more than ``max_rows`` rows.
    """
    try:
        import pyarrow as pa  # noqa: PLC0415 - an extra
        import pyarrow.parquet as pq  # noqa: PLC0415
    except ImportError:
        raise UnknownType("reading Parquet needs the extra: pip install 'casedrain[parquet]'") from None
    try:
        file = pq.ParquetFile(io.BytesIO(content))
        if file.metadata.num_rows > max_rows:
            raise TooLarge(f"the file has more than {max_rows} rows")
        table = file.read()
    except (pa.ArrowException, OSError, ValueError) as error:
        raise Undecodable("the body is not a readable Parquet file", [Fault("body", str(error)[:200])]) from None
    metadata: dict[str, Any] = {
        key.decode(errors="replace"): value.decode(errors="replace")
        for key, value in (table.schema.metadata or {}).items()
        if not key.startswith((b"ARROW:", b"pandas"))
    }
    channels, faults = {}, []
    for name in table.column_names:
        column = table.column(name)
        if pa.types.is_integer(column.type) or pa.types.is_floating(column.type) or pa.types.is_null(column.type):
            channels[name] = np.array(column.cast(pa.float64()).to_numpy(), dtype=np.float64)
        else:
            faults.append(Fault(f"column {name}", f"holds {column.type}, not numbers"))
    return RawRecord(metadata, channels, faults)
