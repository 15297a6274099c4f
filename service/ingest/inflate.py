"""Bounded decompression: a small file may not grow beyond the limit."""

import zlib

from service.errors import Fault, TooLarge, Undecodable

_CHUNK = 1 << 20


def inflated(content: bytes, limit: int) -> bytes:
    """Content of a gzip file (all members).

    Raises
    ------
    Undecodable
        when it is damaged or cut short.
    TooLarge
        when it would grow beyond ``limit`` bytes.
    """
    parts: list[bytes] = []
    total, rest = 0, content
    while rest:
        stream = zlib.decompressobj(wbits=31)
        data = rest
        while not stream.eof:
            try:
                part = stream.decompress(data, _CHUNK)
            except zlib.error as error:
                raise Undecodable("the gzip data is damaged", [Fault("body", str(error))]) from None
            if not part and not stream.unconsumed_tail and not stream.eof:
                fault = Fault("body", f"the gzip stream ends after {total} inflated bytes without its end mark")
                raise Undecodable("the gzip data is cut short: upload the whole file", [fault])
            total += len(part)
            if total > limit:
                raise TooLarge(f"the file inflates to more than {limit} bytes")
            parts.append(part)
            data = stream.unconsumed_tail
        rest = stream.unused_data.lstrip(b"\0")
    return b"".join(parts)
