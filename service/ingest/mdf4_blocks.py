"""Links of an MDF4 file, followed before its reader does: circles and shared blocks would hold or blow up any reader."""

import struct
from collections.abc import Iterator

from service.errors import Fault, TooLarge, Undecodable

_HEADER = 64
_PREFIX = struct.Struct("<4s4xQQ")
_MOST_BLOCKS = 500_000
_MOST_EXPANDED = 20_000
_MOST_LINKS = 1_000_000
_DATA = 5
# by block: the links that lead on in a chain, and those that lead into chains of their own
_CHAINS: dict[bytes, tuple[tuple[int, ...], tuple[int, ...]]] = {
    b"##HD": ((), (0, 1, 2, 3, 4)),
    b"##DG": ((0,), (1, 2)),
    b"##CG": ((0,), (1,)),
    b"##CN": ((0,), (1, 5)),
    b"##CA": ((), (0,)),
    b"##FH": ((0,), ()),
    b"##CH": ((0,), (1,)),
    b"##AT": ((0,), ()),
    b"##EV": ((0,), ()),
    b"##DL": ((0,), ()),
    b"##LD": ((0,), ()),
    b"##HL": ((), (0,)),
}
# where each of these links may lead: a reader takes what it finds there for such a block, whatever it is
_KINDS: dict[tuple[bytes, int], bytes] = {
    (b"##HD", 0): b"##DG",
    (b"##HD", 1): b"##FH",
    (b"##DG", 0): b"##DG",
    (b"##DG", 1): b"##CG",
    (b"##CG", 0): b"##CG",
    (b"##CG", 1): b"##CN",
    (b"##CN", 0): b"##CN",
    (b"##FH", 0): b"##FH",
    (b"##DL", 0): b"##DL",
    (b"##LD", 0): b"##LD",
}


def check_links(content: bytes) -> None:
    """Refuse a file whose blocks lead back to themselves, or whose conversions are nested without end.

    Raises
    ------
    Undecodable
        for a circle, a block that two chains share, or one of another kind than the chain that leads to it.
    TooLarge
        for more blocks than any recorder writes.
    """
    seen: set[int] = set()
    conversions: set[int] = set()
    waiting = [_HEADER]
    while waiting:
        place = waiting.pop()
        if place == 0:
            continue
        if place + _PREFIX.size > len(content):
            fault = Fault("body", f"ends after {len(content)} bytes, before a block at {place}")
            raise Undecodable("the MDF4 file is cut short or damaged: copy it again from the recorder", [fault])
        kind, links = _block(content, place)
        if kind not in _CHAINS:
            continue
        if place in seen:
            raise _circle(kind, place)
        seen.add(place)
        if len(seen) > _MOST_BLOCKS:
            raise TooLarge(f"the MDF4 file holds more than {_MOST_BLOCKS} blocks: leave out channels")
        _check_kinds(content, kind, links)
        onward, inner = _CHAINS[kind]
        waiting += [
            links[i] for i in (*onward, *inner) if i < len(links) and not _is_told_apart(content, kind, i, links)
        ]
        if kind == b"##CN" and len(links) > 4:
            conversions.add(links[4])
    _check_conversions(content, conversions)


def _check_kinds(content: bytes, kind: bytes, links: tuple[int, ...]) -> None:
    for number, link in enumerate(links[:2]):
        wanted = _KINDS.get((kind, number))
        if link and wanted and content[link : link + 4] != wanted:
            fault = Fault(f"block at {link}", f"is no {wanted.decode()} block")
            raise Undecodable("the MDF4 file is cut short or damaged: copy it again from the recorder", [fault])


def _is_told_apart(content: bytes, kind: bytes, number: int, links: tuple[int, ...]) -> bool:
    """Whether a channel's texts lie among the records of a group of their own: that group stands in its own chain."""
    return kind == b"##CN" and number == _DATA and content[links[number] : links[number] + 4] == b"##CG"


def _check_conversions(content: bytes, places: set[int]) -> None:
    """Count what each conversion expands to: tables may name other conversions, and those others again."""
    sizes: dict[int, int] = {}
    for first in places:
        stack: list[tuple[int, Iterator[int]]] = []
        open_now: set[int] = set()
        stack.append((first, iter(_referred(content, first))))
        open_now.add(first)
        sizes.setdefault(first, 1)
        while stack:
            place, rest = stack[-1]
            child = next(rest, None)
            if child is None:
                stack.pop()
                open_now.discard(place)
                if stack:
                    sizes[stack[-1][0]] += sizes[place]
                if sizes[place] > _MOST_EXPANDED:
                    fault = Fault(f"block at {place}", "is nested without end")
                    raise Undecodable("the MDF4 file has conversions that no reader can follow", [fault])
            elif child in open_now:
                raise _circle(b"##CC", child)
            elif child in sizes:
                sizes[place] += sizes[child]
            else:
                sizes[child] = 1
                open_now.add(child)
                stack.append((child, iter(_referred(content, child))))


def _referred(content: bytes, place: int) -> tuple[int, ...]:
    """Conversions that one refers to, its inverse among them."""
    if place == 0 or place + _PREFIX.size > len(content):
        return ()
    kind, links = _block(content, place)
    if kind != b"##CC":
        return ()
    inner = (links[i] for i in (2, *range(4, len(links))) if i < len(links))
    return tuple(link for link in inner if content[link : link + 4] == b"##CC")


def _block(content: bytes, place: int) -> tuple[bytes, tuple[int, ...]]:
    kind, _, n_links = _PREFIX.unpack_from(content, place)
    if n_links > _MOST_LINKS:
        fault = Fault(f"block at {place}", f"has {n_links} links")
        raise Undecodable("the MDF4 file is damaged", [fault])
    first = place + _PREFIX.size
    held = min(n_links, max(0, (len(content) - first) // 8))
    return kind, struct.unpack_from(f"<{held}Q", content, first)


def _circle(kind: bytes, place: int) -> Undecodable:
    fault = Fault(
        f"block at {place}", f"{kind.decode(errors='replace')} leads back to itself, or belongs to two chains"
    )
    return Undecodable("the MDF4 file's links run in a circle: it is damaged", [fault])
