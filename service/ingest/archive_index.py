"""Index of an upload of many records, made in the parser process: where each member lies, and why it may not be read.

It is written as a file beside the upload: one JSON document a member, and the places of these documents as int64, so that
whoever reads members holds one of them at a time.
"""

import json
import re
import stat
import zipfile
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path, PurePosixPath
from typing import TypedDict

import numpy as np

from service.errors import Fault, TooLarge, Undecodable
from service.ingest.file_formats import ANY_TYPE, SUFFIXES, by_suffix

MOST_MEMBERS = 100_000
MOST_DIRECTORY_BYTES = 64 * 2**20
"""Of a ZIP file: six hundred bytes for each member, where names and remarks take a hundred."""
ZIP_MAGIC = (b"PK\x03\x04", b"PK\x05\x06")
PLACES = ".places"
"""Suffix of the file of places beside the index."""
_CHUNK = 1 << 20
_ENTRY, _ZIP64_END = b"PK\x01\x02", b"PK\x06\x07"
_SHORTEST_ENTRY, _LOCAL_HEADER, _MOST_OF_AN_END = 46, 30, 65_557
"""Bytes of an entry in the directory and of one before its data, without names, and of the directory's end with a remark."""
_LINE_END = 10
_ARCHIVES = (".zip", ".tar", ".tgz", ".7z", ".rar", ".xz", ".bz2", ".zst")


class MemberFound(TypedDict):
    """A member of a ZIP file as its directory says it: sizes and places in bytes; ``fault`` where it may not be read."""

    name: str
    type: str
    fault: str | None
    offset: int
    packed: int
    size: int
    method: int
    flags: int
    sum: int


class LineFound(TypedDict):
    """A line that is not blank: its number from 1, where it begins and how long it is [bytes]."""

    number: int
    offset: int
    size: int


def write_index(path: Path, kind: str, output: Path) -> int:
    """Write the index of an upload, stopped at the limit: the number of its members.

    Raises
    ------
    Undecodable, TooLarge
        when it is damaged, empty or holds too many.
    """
    entries: Iterable[MemberFound | LineFound] = _of_zip(path) if kind == "zip" else _of_lines(path)
    places = [0]
    with output.open("wb") as index:
        for entry in entries:
            if len(places) > MOST_MEMBERS:
                raise TooLarge(f"the upload holds more than {MOST_MEMBERS} {_WORDS[kind]}: split it")
            index.write(json.dumps(entry, separators=(",", ":")).encode() + b"\n")
            places.append(index.tell())
    if len(places) == 1:
        raise Undecodable("there is no record in the upload", [Fault("body", "is empty")])
    np.array(places, np.int64).tofile(output.with_name(output.name + PLACES))
    return len(places) - 1


_WORDS = {"zip": "members", "ndjson": "lines"}


def _of_zip(path: Path) -> Iterator[MemberFound]:
    _check_directory(path)
    try:
        with zipfile.ZipFile(path) as file:
            everything = file.infolist()
    except (zipfile.BadZipFile, ValueError, OSError, NotImplementedError) as error:
        raise Undecodable("the ZIP file is damaged", [Fault("body", str(error)[:200])]) from None
    members = [m for m in everything if not m.is_dir() and not _is_of_the_packer(m.filename)]
    repeated = {name for name, n in Counter(m.filename for m in members).items() if n > 1}
    overlapping = _overlapping(everything)
    for member in members:
        fault = _name_fault(member.filename)
        if fault is None and member.filename in repeated:
            fault = "stands in the archive more than once"
        if fault is None and member.header_offset in overlapping:
            fault = "shares its bytes with another member"
        if fault is None and member.flag_bits & 0x1:
            fault = "is encrypted"
        if fault is None and stat.S_ISLNK(member.external_attr >> 16):
            fault = "is a link"
        yield {
            "name": _shown(member.filename),
            "type": _type_of(member.filename),
            "fault": fault,
            "offset": member.header_offset,
            "packed": member.compress_size,
            "size": member.file_size,
            "method": member.compress_type,
            "flags": member.flag_bits,
            "sum": member.CRC,
        }


_ELSEWHERE = 0xFFFFFFFF
"""Where a ZIP64 file would say how long its directory is."""


def _check_directory(path: Path) -> None:
    """Refuse a directory of too many members by its bytes, before any of them becomes an object.

    Raises
    ------
    TooLarge
        naming the limit.
    """
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(0, size - _MOST_OF_AN_END))
        tail = file.read()
        end = tail.rfind(ZIP_MAGIC[1])
        if end < 0:
            return  # the library says what is wrong
        # with more than 65,535 members the number stands elsewhere, and nobody holds it true: signatures are counted
        of_directory = int.from_bytes(tail[end + 12 : end + 16], "little")
        if of_directory > MOST_DIRECTORY_BYTES and of_directory != _ELSEWHERE:
            raise TooLarge(f"the directory of the ZIP file is larger than {MOST_DIRECTORY_BYTES} bytes: split it")
        if of_directory < _SHORTEST_ENTRY * MOST_MEMBERS and _ZIP64_END not in tail:
            return
        file.seek(0)
        n_entries = 0
        rest = b""
        while part := file.read(_CHUNK):
            n_entries += (rest + part).count(_ENTRY)
            rest = part[-len(_ENTRY) + 1 :]
            if n_entries > MOST_MEMBERS:
                raise TooLarge(f"the upload holds more than {MOST_MEMBERS} members: split it")


def _overlapping(members: Sequence[zipfile.ZipInfo]) -> set[int]:
    """Places of members whose bytes are, in part, another's: a small file could so hold any number of large records."""
    found: set[int] = set()
    last, end = -1, 0
    for member in sorted(members, key=lambda m: (m.header_offset, m.compress_size)):
        if last >= 0 and member.header_offset < end:
            found |= {last, member.header_offset}
        if member.header_offset + _LOCAL_HEADER + member.compress_size >= end:
            last, end = member.header_offset, member.header_offset + _LOCAL_HEADER + member.compress_size
    return found


def _of_lines(path: Path) -> Iterator[LineFound]:
    """Number, start and length of every line, found in parts: a line may be as long as the file; blank ones do not count."""
    start = place = 0
    number, is_blank = 1, True
    with path.open("rb") as file:
        while part := file.read(_CHUNK):
            ends = np.flatnonzero(np.frombuffer(part, np.uint8) == _LINE_END)
            if not part.strip() and is_blank and len(ends):  # a gigabyte of blank lines costs no more than its reading
                number, start, place = number + len(ends), place + int(ends[-1]) + 1, place + len(part)
                continue
            begin = 0
            for end in ends.tolist():
                if not (is_blank and not part[begin:end].strip()):
                    yield {"number": number, "offset": start, "size": place + end + 1 - start}
                number, start, is_blank, begin = number + 1, place + end + 1, True, end + 1
            is_blank = is_blank and not part[begin:].strip()
            place += len(part)
    if not is_blank:
        yield {"number": number, "offset": start, "size": place - start}


def _is_of_the_packer(name: str) -> bool:
    """Whether a member is what a file manager leaves beside the files that somebody packed."""
    return name.startswith("__MACOSX/") or PurePosixPath(name).name in (".DS_Store", "Thumbs.db", "desktop.ini")


def _name_fault(name: str) -> str | None:
    """Why a member of this name is not taken; nothing is ever written under it, but who plays tricks is told."""
    path = PurePosixPath(name)
    if name.startswith("/") or re.match(r"[A-Za-z]:", name) or "\\" in name or ".." in path.parts:
        return "has a path that leads out of the archive"
    if any(ord(c) < 32 or ord(c) == 127 for c in name):
        return "has control characters in its name"
    if name.lower().endswith((*_ARCHIVES, ".tar.gz")):
        return "is an archive itself"
    if by_suffix(path) is None:
        return f"is of no known type; known: {', '.join(SUFFIXES)}"
    return None


def _type_of(name: str) -> str:
    named = by_suffix(PurePosixPath(name))
    return named.content_types[0] if named else ANY_TYPE


def _shown(name: str) -> str:
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in name)[:200]
