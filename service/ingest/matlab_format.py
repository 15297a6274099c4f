"""MATLAB v5: variables and structs of them at any depth; texts and single numbers are metadata. 7.3 is HDF5."""

import io
import struct
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from service.errors import Fault, TooLarge, Undecodable, UnknownType
from service.ingest import hdf5_format
from service.ingest.file_formats import MATLAB
from service.ingest.hdf5_format import opaque
from service.ingest.nested import Leaf, Tree, by_name, leaf_of, tables_of
from service.ingest.raw import Limits, RawFile, check_size, plain

_MAGIC_OF_HDF5 = b"MATLAB 7.3 MAT-file"
_HEADER_BYTES = 128
_COMPRESSED = 15
_CHUNK = 1 << 20
_MOST_MEMBERS = 10_000
_OPAQUE = "an object"
"""The name that SciPy's reader leaves to objects of MATLAB's."""


def parsed(content: bytes, limits: Limits) -> RawFile:
    """Read a MATLAB record; what compressed variables inflate to is counted before they are decoded.

    Raises
    ------
    UnknownType
        when SciPy's reader is not installed.
    Undecodable, TooLarge
        when it is no MATLAB 5 or 7.3 file, or is larger than the limits.
    """
    if content.startswith(_MAGIC_OF_HDF5):
        try:
            return hdf5_format.parsed(content, limits)
        except Undecodable as error:
            raise Undecodable("the MATLAB 7.3 file is damaged: save it again, or with '-v7'", error.errors) from None
    if not MATLAB.begins(content):
        raise Undecodable("the body is not a MATLAB v5 file", [Fault("body", "no MATLAB 5.0 mark at its start")])
    try:
        from scipy.io import loadmat  # noqa: PLC0415 - heavy, and an extra by its name
    except ImportError:
        raise UnknownType("reading MATLAB needs the extra: pip install 'casedrain[matlab]'") from None
    _check_inflation(content, limits)
    file: Any = io.BytesIO(content)
    variables = loadmat(file, squeeze_me=False, struct_as_record=True, chars_as_strings=True)
    held = {
        _OPAQUE if name == "None" else name: value for name, value in variables.items() if not name.startswith("__")
    }
    return tables_of(_tree(held, limits))


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
            total += _inflated_size(content, place + 8, end, limits.inflated_bytes - total)
            if total > limits.inflated_bytes:
                raise TooLarge(f"the file inflates to more than {limits.inflated_bytes} bytes")
        place = end


def _inflated_size(content: bytes, start: int, end: int, most: int) -> int:
    """Bytes that a stream inflates to, or a little more than ``most``; fed by the chunk, so that no tail is copied twice.

    A stream without its end, or one shorter than the variable in it says, ends SciPy's reader and the process with it.
    """
    stream, total, tag = zlib.decompressobj(), 0, b""
    for place in range(start, end, _CHUNK):
        data = content[place : min(place + _CHUNK, end)]
        while data and not stream.eof:
            part = stream.decompress(data, _CHUNK)
            total, tag = total + len(part), (tag + part[:8])[:8]
            data = stream.unconsumed_tail
            if total > most:
                return total
    held = int.from_bytes(tag[4:8], "big" if content[126:128] == b"MI" else "little") + 8
    if not stream.eof or total < max(held, 8):
        raise Undecodable(
            "the MATLAB file is damaged", [Fault("body", f"the variable at byte {start - 8} is cut short")]
        )
    return total


def _tree(variables: Mapping[str, Any], limits: Limits) -> Tree:
    """Variables as nested groups: structs are groups, arrays of structs and cells groups by name or by place."""
    return {name: _item(name, value, limits) for name, value in variables.items()}


def _item(name: str, value: Any, limits: Limits) -> "Leaf | Tree":
    kind = type(value).__name__
    if kind in ("MatlabOpaque", "MatlabFunction"):
        return Leaf(None, what=opaque(_class_of(value)))
    if not isinstance(value, np.ndarray):
        return Leaf(None, what=f"a {kind}")
    if value.dtype.names:
        members = [(entry, entry.dtype.names) for entry in value.reshape(-1)[:_MOST_MEMBERS]]
        structs = [_tree({n: entry[n] for n in names}, limits) for entry, names in members]
        return structs[0] if len(structs) == 1 else by_name(name, structs)
    if value.dtype.kind == "O":
        if value.size > _MOST_MEMBERS:
            return Leaf(None, what="a cell array")
        cells = {f"{name}({i + 1})": _item(name, cell, limits) for i, cell in enumerate(value.reshape(-1))}
        words = [cell.value for cell in cells.values() if isinstance(cell, Leaf) and isinstance(cell.value, str)]
        return Leaf(words) if words and len(words) == len(cells) else cells
    leaf = leaf_of(value)
    if isinstance(leaf.value, np.ndarray):
        check_size(len(leaf.value), 1, limits)
    return leaf


def _class_of(value: Any) -> str:
    try:
        return str(plain(value.reshape(-1)[0]["s2"]))
    except (IndexError, KeyError, TypeError, ValueError):
        return ""
