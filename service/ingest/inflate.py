"""Bounded decompression: a small file may not grow beyond the limit."""

import zlib

from service.errors import Fault, TooLarge, Undecodable

_CHUNK = 1 << 20
_FED = 1 << 14
"""Bytes that go in at a time: what is left over behind each member is copied."""
_MOST_MEMBERS = 10_000
"""Members of one stream; each costs a decompressor of its own, however empty."""


def inflated(content: bytes, limit: int) -> tuple[bytes, bool]:
    """Content of a gzip file (all members), and whether the stream ends before its end mark.

    Raises
    ------
    Undecodable
        when it is damaged, or cut before anything came out.
    TooLarge
        when it would grow beyond ``limit`` bytes.
    """
    parts: list[bytes] = []
    total = place = n_members = 0
    while place < len(content):
        n_members += 1
        if n_members > _MOST_MEMBERS:
            raise TooLarge(f"the gzip file has more than {_MOST_MEMBERS} members: compress it as one")
        stream = zlib.decompressobj(wbits=31)
        is_fed = False
        while not stream.eof:
            if is_fed and not stream.unconsumed_tail and place >= len(content):
                return b"".join(parts), _is_cut(total)
            data = stream.unconsumed_tail or content[place : place + _FED]
            if not stream.unconsumed_tail:
                place += len(data)
            is_fed = True
            try:
                part = stream.decompress(data, _CHUNK)
            except zlib.error as error:
                raise Undecodable("the gzip data is damaged", [Fault("body", str(error))]) from None
            total += len(part)
            if total > limit:
                raise TooLarge(f"the file inflates to more than {limit} bytes")
            parts.append(part)
        place -= len(stream.unused_data)
        place = _after_zeros(content, place)
    return b"".join(parts), False


def _is_cut(total: int) -> bool:
    if total == 0:
        fault = Fault("body", "the gzip stream ends after 0 inflated bytes without its end mark")
        raise Undecodable("the gzip data is cut short: upload the whole file", [fault])
    return True


def _after_zeros(content: bytes, place: int) -> int:
    """Place behind the padding between members."""
    while place < len(content) and content[place] == 0:
        block = content[place : place + _CHUNK]
        place += len(block) - len(block.lstrip(b"\0"))
    return place
