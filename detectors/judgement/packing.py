"""Nested dataclasses with arrays as plain bytes and back, bit for bit; nothing in the bytes is ever executed.

The bytes are the length of a JSON head (8 bytes, little-endian), the head, and the numbers of all arrays one after
another as the head describes them (little-endian). Types are not in the bytes: whoever reads says what to expect.
"""

import json
import types
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from datetime import datetime
from enum import StrEnum
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

AnyArray = NDArray[Any]

_DTYPES = ("<f8", "<i8", "|b1")
_LENGTH = 8
"""Bytes of the head's length."""


def packed(value: Any) -> bytes:
    """Bytes of a tree of dataclasses, tuples, lists, mappings with string keys, enums, instants, numbers and arrays.

    Raises
    ------
    TypeError
        naming what cannot be packed.
    """
    arrays: list[AnyArray] = []
    tree = _tree(value, arrays)
    head = json.dumps({"tree": tree, "arrays": [_description(a) for a in arrays]}, separators=(",", ":")).encode()
    return b"".join((len(head).to_bytes(_LENGTH, "little"), head, *(_numbers(a) for a in arrays)))


def unpacked(kind: Any, content: bytes) -> Any:
    """Value of a type from its bytes.

    Raises
    ------
    ValueError
        when the bytes do not hold a value of this type.
    """
    start = _LENGTH + int.from_bytes(content[:_LENGTH], "little")
    try:
        head = json.loads(content[_LENGTH:start])
        arrays = []
        for dtype, shape, triangle in head["arrays"]:
            array, start = _array(content, start, dtype, tuple(shape), triangle=triangle)
            arrays.append(array)
        return _built(kind, head["tree"], arrays)
    except (KeyError, TypeError, IndexError, AttributeError, ValueError) as error:
        raise ValueError(f"these bytes are no {kind!r}: {error}") from error


def _tree(value: Any, arrays: list[AnyArray]) -> Any:
    if isinstance(value, np.ndarray):
        arrays.append(value)
        return len(arrays) - 1
    if isinstance(value, StrEnum):
        return value.value
    if isinstance(value, datetime):
        return value.isoformat()
    if is_dataclass(value):
        return [_tree(getattr(value, f.name), arrays) for f in fields(value)]
    if isinstance(value, Mapping):
        return {str(_tree(key, arrays)): _tree(item, arrays) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_tree(item, arrays) for item in value]
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise TypeError(f"cannot pack a {type(value).__name__}")


def _built(kind: Any, tree: Any, arrays: list[AnyArray]) -> Any:
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        (kind,) = (k for k in arguments if k is not type(None))
        return None if tree is None else _built(kind, tree, arrays)
    if origin is np.ndarray:
        return arrays[tree]
    if origin is tuple and (len(arguments) != 2 or arguments[1] is not Ellipsis):
        return tuple(_built(k, item, arrays) for k, item in zip(arguments, tree, strict=True))
    if origin in (tuple, list):
        return origin(_built(arguments[0], item, arrays) for item in tree)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return {_built(arguments[0], key, arrays): _built(arguments[1], item, arrays) for key, item in tree.items()}
    if kind is datetime:
        return datetime.fromisoformat(tree)
    if is_dataclass(kind) and isinstance(kind, type):
        hints = get_type_hints(kind)
        parts = zip(fields(kind), tree, strict=True)
        return kind(**{f.name: _built(hints[f.name], item, arrays) for f, item in parts})
    if issubclass(kind, StrEnum):
        return kind(tree)
    if not isinstance(tree, (float, int) if kind is float else kind):
        raise ValueError(f"{tree!r} is no {kind.__name__}")
    return tree


def _description(array: AnyArray) -> tuple[str, tuple[int, ...], bool]:
    dtype = array.dtype.newbyteorder("<").str
    if dtype not in _DTYPES:
        raise TypeError(f"cannot pack an array of {array.dtype}")
    return dtype, array.shape, _is_symmetric(array)


def _is_symmetric(array: AnyArray) -> bool:
    """True for matrices, also a stack of them, that equal their transpose to the last bit."""
    if array.ndim < 2 or array.shape[-1] != array.shape[-2] or array.dtype != np.float64:
        return False
    bits = np.ascontiguousarray(array).view(np.int64)
    return bool(np.array_equal(bits, bits.swapaxes(-1, -2)))


def _numbers(array: AnyArray) -> bytes:
    if _is_symmetric(array):
        rows, columns = np.tril_indices(array.shape[-1])
        array = array[..., rows, columns]
    return np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<")).tobytes()


def _array(content: bytes, start: int, dtype: str, shape: tuple[int, ...], *, triangle: bool) -> tuple[AnyArray, int]:
    """One array, and where the next one starts."""
    if dtype not in _DTYPES:
        raise ValueError(f"arrays of {dtype} are not expected")
    size = shape[-1] if triangle else 0
    stored = (*shape[:-2], size * (size + 1) // 2) if triangle else shape
    count = int(np.prod(stored, dtype=np.int64))
    flat = np.frombuffer(content, dtype, count, start).reshape(stored).astype(np.dtype(dtype).newbyteorder("="))
    end = start + count * np.dtype(dtype).itemsize
    if not triangle:
        return flat, end
    array = np.empty(shape)
    rows, columns = np.tril_indices(size)
    array[..., rows, columns] = flat
    array[..., columns, rows] = flat
    return array, end
