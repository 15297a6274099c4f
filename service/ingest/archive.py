"""Many records in one upload: members of a ZIP file or lines of NDJSON, each taken out with bounds of its own."""

import json
import tempfile
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, cast

import numpy as np

from service.errors import Fault, Invalid, Problem, TooLarge, Undecodable, UnknownType
from service.ingest.archive_index import PLACES, ZIP_MAGIC, LineFound, MemberFound, write_index
from service.ingest.file_formats import ANY_TYPE

ZIP_TYPES = ("application/zip", "application/x-zip-compressed")
NDJSON_TYPES = ("application/x-ndjson", "application/ndjson", "application/jsonl")
INDEX = "index.jsonl"
"""Name of the index in its folder."""
_CHUNK = 1 << 20
_LOCAL_HEADER = 30
_ARCHIVE_MAGIC = (b"PK\x03\x04", b"7z\xbc\xaf\x27\x1c", b"Rar!\x1a\x07", b"\xfd7zXZ\x00", b"BZh")


@dataclass(frozen=True, slots=True)
class Member:
    """One record inside an upload of many."""

    name: str
    content_type: str


class Archive(ABC):
    """Members by position, read through an index in a folder of its own, which goes when the archive is closed."""

    def __init__(self, path: Path, folder: tempfile.TemporaryDirectory[str], most_bytes: int) -> None:
        index = Path(folder.name) / INDEX
        self._folder, self._most_bytes = folder, most_bytes
        self._places = np.fromfile(index.with_name(index.name + PLACES), np.int64)
        self._index: IO[bytes] = index.open("rb")
        self._file: IO[bytes] = path.open("rb")

    def __len__(self) -> int:
        return len(self._places) - 1

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

    def close(self) -> None:
        """Close the files and remove the index."""
        self._file.close()
        self._index.close()
        self._folder.cleanup()

    def _written(self, position: int) -> bytes:
        """The index's entry of a member, as JSON."""
        start, end = (int(place) for place in self._places[position : position + 2])
        self._index.seek(start)
        return self._index.read(end - start)


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
        if head.startswith(ZIP_MAGIC):
            return "zip"
        if head.lstrip().startswith(b"{"):
            return "ndjson"
        raise Undecodable("the body is neither a ZIP file nor NDJSON", [Fault("body", "has no known start")])
    if kind in ZIP_TYPES:
        if not head.startswith(ZIP_MAGIC):
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
    """Index an upload of many records in this process and open it; ``most_bytes`` bounds each member.

    What comes from a network is indexed by ``ParserPool.opened`` instead.

    Raises
    ------
    Undecodable, TooLarge
        when it is damaged, empty or holds too many.
    """
    folder = tempfile.TemporaryDirectory(prefix="casedrain-index-")
    try:
        write_index(path, kind, Path(folder.name) / INDEX)
        return indexed_archive(path, kind, folder, most_bytes)
    except BaseException:
        folder.cleanup()
        raise


def indexed_archive(path: Path, kind: str, folder: tempfile.TemporaryDirectory[str], most_bytes: int) -> Archive:
    """Open an upload whose index is in a folder, which the archive removes with itself."""
    return _Zip(path, folder, most_bytes) if kind == "zip" else _Lines(path, folder, most_bytes)


class _Zip(Archive):
    def name(self, position: int) -> str:
        return self._entry(position)["name"]

    def _entry(self, position: int) -> MemberFound:
        return cast("MemberFound", json.loads(self._written(position)))

    def member(self, position: int) -> Member:
        entry = self._entry(position)
        name, fault = entry["name"], entry["fault"]
        if fault is not None:
            raise Invalid(f"the member {fault}", [Fault(name, fault)])
        if entry["size"] > self._most_bytes:
            raise TooLarge(f"the member is larger than {self._most_bytes} bytes")
        return Member(name, entry["type"])

    def parts(self, position: int) -> Iterator[bytes]:
        entry = self._entry(position)
        total = 0
        try:
            with self._unpacked(entry) as file:
                while part := file.read(_CHUNK):
                    if total == 0 and part.startswith(_ARCHIVE_MAGIC):
                        raise Invalid("the member is an archive", [Fault(entry["name"], "is an archive itself")])
                    total += len(part)
                    # what the directory says of a size is the sender's word
                    if total > self._most_bytes:
                        raise TooLarge(f"the member inflates to more than {self._most_bytes} bytes")
                    yield part
        except Problem:
            raise
        except Exception as error:  # a damaged member raises whatever its decompressor does
            what = f"{type(error).__name__}: {error}"[:200]
            raise Undecodable("the member is damaged", [Fault(entry["name"], what)]) from None

    def _unpacked(self, entry: MemberFound) -> IO[bytes]:
        """A member as a file: what the library reads after it has found an entry, without reading the directory again."""
        self._file.seek(entry["offset"])
        head = self._file.read(_LOCAL_HEADER)
        if len(head) < _LOCAL_HEADER or not head.startswith(ZIP_MAGIC[0]):
            raise zipfile.BadZipFile("no member begins where the directory says")
        self._file.seek(int.from_bytes(head[26:28], "little") + int.from_bytes(head[28:30], "little"), 1)
        info = zipfile.ZipInfo("member")
        info.compress_type, info.flag_bits, info.CRC = entry["method"], entry["flags"], entry["sum"]
        info.compress_size, info.file_size = entry["packed"], entry["size"]
        return cast("IO[bytes]", zipfile.ZipExtFile(self._file, "r", info))


class _Lines(Archive):
    """NDJSON: one JSON record a line; empty lines do not count."""

    def name(self, position: int) -> str:
        return f"line {self._entry(position)['number']}"

    def _entry(self, position: int) -> LineFound:
        return cast("LineFound", json.loads(self._written(position)))

    def member(self, position: int) -> Member:
        if self._entry(position)["size"] > self._most_bytes:
            raise TooLarge(f"the line is longer than {self._most_bytes} bytes")
        return Member(self.name(position), "application/json")

    def parts(self, position: int) -> Iterator[bytes]:
        entry = self._entry(position)
        self._file.seek(entry["offset"])
        yield self._file.read(entry["size"]).strip()
