"""Many records in one upload: members of a ZIP file or lines of NDJSON, each taken out with bounds of its own."""

import re
import stat
import zipfile
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO

import numpy as np

from service.errors import Fault, Invalid, Problem, TooLarge, Undecodable, UnknownType
from service.ingest.file_formats import ANY_TYPE, SUFFIXES, by_suffix

ZIP_TYPES = ("application/zip", "application/x-zip-compressed")
NDJSON_TYPES = ("application/x-ndjson", "application/ndjson", "application/jsonl")
MOST_MEMBERS = 100_000
_CHUNK = 1 << 20
_ZIP_MAGIC = (b"PK\x03\x04", b"PK\x05\x06")
_ENTRY, _ZIP64_END = b"PK\x01\x02", b"PK\x06\x07"
_SHORTEST_ENTRY, _LOCAL_HEADER, _MOST_OF_AN_END = 46, 30, 65_557
"""Bytes of an entry in the directory and of one before its data, without names, and of the directory's end with a remark."""
_LINE_END = 10
_ARCHIVES = (".zip", ".tar", ".tgz", ".7z", ".rar", ".xz", ".bz2", ".zst")
_ARCHIVE_MAGIC = (b"PK\x03\x04", b"7z\xbc\xaf\x27\x1c", b"Rar!\x1a\x07", b"\xfd7zXZ\x00", b"BZh")


@dataclass(frozen=True, slots=True)
class Member:
    """One record inside an upload of many."""

    name: str
    content_type: str


class Archive(ABC):
    """Members by position."""

    @abstractmethod
    def __len__(self) -> int: ...

    @abstractmethod
    def name(self, position: int) -> str:
        """Name of a member as it is reported, harmless to show."""

    @abstractmethod
    def member(self, position: int) -> Member:
        """A member that may be read.

        Raises
        ------
        Problem
            why it may not.
        """

    @abstractmethod
    def parts(self, position: int) -> Iterator[bytes]:
        """Bytes of a member, bounded; raises ``TooLarge`` or ``Undecodable`` on the way."""

    @abstractmethod
    def close(self) -> None:
        """Close the file."""


def archive_kind(content_type: str, head: bytes) -> str:
    """``zip`` or ``ndjson``.

    Raises
    ------
    UnknownType
        for other types.
    Undecodable
        when the first bytes are not what the type says.
    """
    kind = content_type.partition(";")[0].strip().lower()
    if kind == ANY_TYPE:
        if head.startswith(_ZIP_MAGIC):
            return "zip"
        if head.lstrip().startswith(b"{"):
            return "ndjson"
        raise Undecodable("the body is neither a ZIP file nor NDJSON", [Fault("body", "has no known start")])
    if kind in ZIP_TYPES:
        if not head.startswith(_ZIP_MAGIC):
            raise Undecodable("the body is not a ZIP file", [Fault("body", "no ZIP mark at its start")])
        return "zip"
    if kind in NDJSON_TYPES:
        return "ndjson"
    offered = ", ".join((ZIP_TYPES[0], NDJSON_TYPES[0], ANY_TYPE))
    raise UnknownType(
        f"content type {kind or '(none)'} holds no records; send one of {offered}",
        [Fault("content-type", f"{kind or 'none'} is not one of {offered}")],
    )


def opened_archive(path: Path, kind: str, most_bytes: int) -> Archive:
    """Open an upload of many records; ``most_bytes`` bounds each member.

    Raises
    ------
    Undecodable, TooLarge
        when it is damaged, empty or holds too many.
    """
    found: Archive = _Zip(path, most_bytes) if kind == "zip" else _Lines(path, most_bytes)
    if not len(found):
        found.close()
        raise Undecodable("there is no record in the upload", [Fault("body", "is empty")])
    if len(found) > MOST_MEMBERS:
        found.close()
        raise TooLarge(f"the upload holds {len(found)} members, more than {MOST_MEMBERS}: split it")
    return found


class _Zip(Archive):
    def __init__(self, path: Path, most_bytes: int) -> None:
        self._most_bytes = most_bytes
        _check_directory(path)
        try:
            self._file = zipfile.ZipFile(path)
        except (zipfile.BadZipFile, ValueError, OSError, NotImplementedError) as error:
            raise Undecodable("the ZIP file is damaged", [Fault("body", str(error)[:200])]) from None
        self._members = [m for m in self._file.infolist() if not m.is_dir() and not _is_of_the_packer(m.filename)]
        self._repeated = {name for name, n in Counter(m.filename for m in self._members).items() if n > 1}
        self._overlapping = _overlapping(self._file.infolist())

    def __len__(self) -> int:
        return len(self._members)

    def name(self, position: int) -> str:
        return _shown(self._members[position].filename)

    def member(self, position: int) -> Member:
        info = self._members[position]
        fault = _name_fault(info.filename)
        if fault is None and info.filename in self._repeated:
            fault = "stands in the archive more than once"
        if fault is None and info.header_offset in self._overlapping:
            fault = "shares its bytes with another member"
        if fault is None and info.flag_bits & 0x1:
            fault = "is encrypted"
        if fault is None and stat.S_ISLNK(info.external_attr >> 16):
            fault = "is a link"
        if fault is not None:
            raise Invalid(f"the member {fault}", [Fault(self.name(position), fault)])
        if info.file_size > self._most_bytes:
            raise TooLarge(f"the member is larger than {self._most_bytes} bytes")
        return Member(self.name(position), _type_of(info.filename))

    def parts(self, position: int) -> Iterator[bytes]:
        total = 0
        try:
            with self._file.open(self._members[position]) as file:
                while part := file.read(_CHUNK):
                    if total == 0 and part.startswith(_ARCHIVE_MAGIC):
                        raise Invalid("the member is an archive", [Fault(self.name(position), "is an archive itself")])
                    total += len(part)
                    # what the directory says of a size is the sender's word
                    if total > self._most_bytes:
                        raise TooLarge(f"the member inflates to more than {self._most_bytes} bytes")
                    yield part
        except Problem:
            raise
        except Exception as error:  # a damaged member raises whatever its decompressor does
            what = f"{type(error).__name__}: {error}"[:200]
            raise Undecodable("the member is damaged", [Fault(self.name(position), what)]) from None

    def close(self) -> None:
        self._file.close()


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
        end = tail.rfind(_ZIP_MAGIC[1])
        if end < 0:
            return  # the library says what is wrong
        # with more than 65,535 members the number stands elsewhere, and nobody holds it true: signatures are counted
        of_directory = int.from_bytes(tail[end + 12 : end + 16], "little")
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


class _Lines(Archive):
    """NDJSON: one JSON record a line; empty lines do not count."""

    def __init__(self, path: Path, most_bytes: int) -> None:
        self._most_bytes = most_bytes
        self._file: IO[bytes] = path.open("rb")
        self._places: list[tuple[int, int, int]] = []
        self._index()

    def _index(self) -> None:
        """Number, start and length of every line, found in parts: a line may be as long as the file."""
        start = place = 0
        number, is_blank = 1, True
        while part := self._file.read(_CHUNK):
            ends = np.flatnonzero(np.frombuffer(part, np.uint8) == _LINE_END)
            if not part.strip() and is_blank and len(ends):  # a gigabyte of blank lines costs no more than its reading
                number, start, place = number + len(ends), place + int(ends[-1]) + 1, place + len(part)
                continue
            begin = 0
            for end in ends.tolist():
                if not (is_blank and not part[begin:end].strip()):
                    self._note(number, start, place + end + 1 - start)
                number, start, is_blank, begin = number + 1, place + end + 1, True, end + 1
            is_blank = is_blank and not part[begin:].strip()
            place += len(part)
        if not is_blank:
            self._note(number, start, place - start)

    def _note(self, number: int, start: int, length: int) -> None:
        self._places.append((number, start, length))
        if len(self._places) > MOST_MEMBERS:
            self.close()
            raise TooLarge(f"the upload holds more than {MOST_MEMBERS} lines: split it")

    def __len__(self) -> int:
        return len(self._places)

    def name(self, position: int) -> str:
        return f"line {self._places[position][0]}"

    def member(self, position: int) -> Member:
        if self._places[position][2] > self._most_bytes:
            raise TooLarge(f"the line is longer than {self._most_bytes} bytes")
        return Member(self.name(position), "application/json")

    def parts(self, position: int) -> Iterator[bytes]:
        _, start, length = self._places[position]
        self._file.seek(start)
        yield self._file.read(length).strip()

    def close(self) -> None:
        self._file.close()


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
