"""Heaps of an HDF5 file, where texts of any length lie: looked at before the library is, which one of them can hold for ever."""

import struct

from service.errors import Fault, Undecodable

_MARK = b"GCOL\x01\x00\x00\x00"
_OBJECT = struct.Struct("<HHIQ")


def check_heaps(content: bytes) -> None:
    """Refuse a heap whose free space has no size: the library would step on by nothing.

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
            if index == 0:
                break
            at += _OBJECT.size + (held + 7) // 8 * 8
        place = content.find(_MARK, place + len(_MARK))
