"""MATLAB v5: variables named as channels, or one struct of them; texts and single numbers are metadata."""

import io
import struct
import zlib
from typing import Any

import numpy as np

from service.errors import Fault, TooLarge, Undecodable, UnknownType
from service.ingest.file_formats import MATLAB
from service.ingest.raw import Limits, RawFile, Table, check_size, plain

_MAGIC_OF_HDF5 = b"MATLAB 7.3 MAT-file"
_HEADER_BYTES = 128
_COMPRESSED = 15
_CHUNK = 1 << 20


def parsed(content: bytes, limits: Limits) -> RawFile:
    """Read a MATLAB v5 record; what its compressed variables inflate to is counted before they are decoded.

    Raises
    ------
    UnknownType
        when SciPy's reader is not installed.
    Undecodable, TooLarge
        when it is no MATLAB v5 file, or is larger than the limits.
    """
    if content.startswith(_MAGIC_OF_HDF5):
        fault = Fault("body", "is a MATLAB 7.3 file")
        raise Undecodable("save it with save(…, '-v7'), or write HDF5", [fault])
    if not MATLAB.begins(content):
        raise Undecodable("the body is not a MATLAB v5 file", [Fault("body", "no MATLAB 5.0 mark at its start")])
    try:
        from scipy.io import loadmat  # noqa: PLC0415 - heavy, and an extra by its name
    except ImportError:
        raise UnknownType("reading MATLAB needs the extra: pip install 'casedrain[matlab]'") from None
    _check_inflation(content, limits)
    file: Any = io.BytesIO(content)
    variables = loadmat(file, squeeze_me=False, struct_as_record=True, chars_as_strings=True)
    return _sorted({name: value for name, value in variables.items() if not name.startswith("__")}, limits)


def _check_inflation(content: bytes, limits: Limits) -> None:
    """Inflate every compressed variable with a bound, keeping nothing."""
    order = ">" if content[126:128] == b"MI" else "<"
    place, total = _HEADER_BYTES, 0
    while place + 8 <= len(content):
        kind, size = struct.unpack_from(f"{order}II", content, place)
        end = place + 8 + size
        if end > len(content):
            raise Undecodable(
                "the MATLAB file is cut short", [Fault("body", f"ends inside a variable at byte {place}")]
            )
        if kind == _COMPRESSED:
            stream, data = zlib.decompressobj(), content[place + 8 : end]
            while data and not stream.eof:
                total += len(stream.decompress(data, _CHUNK))
                data = stream.unconsumed_tail
                if total > limits.inflated_bytes:
                    raise TooLarge(f"the file inflates to more than {limits.inflated_bytes} bytes")
        place = end


def _sorted(variables: dict[str, Any], limits: Limits) -> RawFile:
    """Variables told apart into channels and metadata."""
    structs = [v for v in variables.values() if getattr(v, "dtype", None) is not None and v.dtype.names]
    if len(structs) == 1 and structs[0].size == 1:
        record = structs[0].reshape(-1)[0]
        outer = {name: value for name, value in variables.items() if value is not structs[0]}
        variables = outer | {name: record[name] for name in structs[0].dtype.names}
    metadata: dict[str, Any] = {}
    channels: dict[str, Any] = {}
    faults: list[Fault] = []
    for name, value in variables.items():
        array = np.asarray(value)
        if array.dtype.kind in "US" or array.size == 1:
            text = plain(array)
            metadata[name] = text.strip() if isinstance(text, str) else text
        elif array.dtype.kind not in "fiu" or max(array.shape, default=0) != array.size:
            what = f"has shape {array.shape} of {array.dtype}, not one row of numbers"
            faults.append(Fault(f"channels.{name}", what))
        else:
            channels[name] = array.reshape(-1)
    check_size(max((len(c) for c in channels.values()), default=0), len(channels), limits)
    return RawFile(metadata, (Table({n: np.array(c, dtype=np.float64) for n, c in channels.items()}),), faults)
