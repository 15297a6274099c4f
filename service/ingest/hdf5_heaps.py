"""Heaps of an HDF5 file, where texts of any length lie: looked at before the library is, which one of them can hold for ever."""

import struct

import numpy as np

from service.errors import Fault, Undecodable

_MARK = b"GCOL\x01\x00\x00\x00"
_ENTRY_BYTES = 16
_OBJECT = struct.Struct("<HHIQ")


def longest_text(content: bytes, offset: int, n: int) -> int:
    """Longest of n texts of any length as their entries state it, which the library would make room for."""
    entries = np.frombuffer(content, np.uint8, _ENTRY_BYTES * n, offset).reshape(n, _ENTRY_BYTES)
    return int(np.ascontiguousarray(entries[:, :4]).view("<u4").max(initial=0))


def check_heaps(content: bytes) -> None:
    """Refuse a heap in which free space has no size: the library would step on by nothing.

    Raises
    ------
    Undecodable
        naming where the heap is.
    """
    place = content.find(_MARK)
    while place >= 0:
        size = int.from_bytes(content[place + 8 : place + 16], "little")
        end = min(place + size, len(content))
        at = place + 16
        while at + _OBJECT.size <= end:
            index, _, _, held = _OBJECT.unpack_from(content, at)
            if index == 0 and held < _OBJECT.size:
                raise Undecodable("the HDF5 file is damaged", [Fault("body", f"heap at byte {place} runs in a circle")])
            # free space counts its own head, and the library looks behind it as well where it does not reach the end
            at += held if index == 0 else _OBJECT.size + (held + 7) // 8 * 8
        place = content.find(_MARK, place + len(_MARK))
