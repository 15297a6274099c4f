"""The folder of an inbox in any file store that fsspec lists: what lies in it, and moving what is done with."""

import contextlib
from dataclasses import dataclass
from datetime import datetime
from pathlib import PurePosixPath
from typing import Any

import fsspec

from service.answers.documents import JsonObject
from service.ingest.file_formats import SUFFIXES

DONE, REFUSED, HIDDEN = "done", "refused", "."
PROBLEM = ".problem.json"
_UNFINISHED = (".part", ".partial", ".tmp", ".filepart", ".crdownload", ".download")
_TIMES = ("mtime", "LastModified", "last_modified", "modified", "updated", "created")
_TAGS = ("ETag", "etag", "md5Hash", "checksum")


@dataclass(frozen=True, slots=True)
class Look:
    """What lies in an inbox.

    Attributes
    ----------
    states
        State (size, time of change, the store's own tag) by name of every flight record.
    empty
        Names of records without a byte.
    passed_over
        Names of files of no known type.
    markers
        Names of all files, for markers among them.
    """

    states: dict[str, str]
    empty: list[str]
    passed_over: list[str]
    markers: frozenset[str]


class Place:
    """One folder of a file store.

    Parameters
    ----------
    url
        A path, or what fsspec reads: ``s3://…``, ``sftp://…``, ``memory://…``.

    Raises
    ------
    ValueError, ImportError
        when there is no such kind of store.
    """

    def __init__(self, url: str) -> None:
        self._files, root = fsspec.core.url_to_fs(url)
        self.root = str(root).rstrip("/") or "/"

    @property
    def is_local(self) -> bool:
        """Whether it is a folder of this machine."""
        protocol: Any = self._files.protocol
        return "file" in ((protocol,) if isinstance(protocol, str) else protocol)

    def look(self) -> Look:
        """What lies there now.

        Raises
        ------
        OSError
            when it cannot be listed.
        """
        with contextlib.suppress(AttributeError):
            self._files.invalidate_cache()
        if not self._files.isdir(self.root):
            raise FileNotFoundError(f"there is no folder {self.root}")
        found: dict[str, JsonObject] = self._files.find(self.root, detail=True)
        states: dict[str, str] = {}
        empty, passed_over, names = [], [], set()
        for path, about in sorted(found.items()):
            name = path[len(self.root) :].lstrip("/")
            parts = PurePosixPath(name).parts
            if parts[0] in (DONE, REFUSED) or any(part.startswith(HIDDEN) for part in parts):
                continue
            names.add(name)
            suffix = PurePosixPath(name).suffix.lower()
            if suffix in SUFFIXES and not name.endswith(PROBLEM):
                if not about.get("size"):
                    empty.append(name)
                else:
                    states[name] = _state(about)
            elif suffix not in _UNFINISHED:
                passed_over.append(name)
        return Look(states, empty, passed_over, frozenset(names))

    def read(self, name: str) -> bytes:
        """Bytes of a file.

        Raises
        ------
        OSError
            when it cannot be read.
        """
        content: bytes = self._files.cat_file(f"{self.root}/{name}")
        return content

    def state(self, name: str) -> str | None:
        """State of a file now; None when it is gone."""
        with contextlib.suppress(AttributeError):
            self._files.invalidate_cache()
        try:
            return _state(self._files.info(f"{self.root}/{name}"))
        except FileNotFoundError:
            return None

    def move(self, name: str, target: str) -> None:
        """Move a file inside the inbox; one that is gone has been moved already."""
        path = f"{self.root}/{target}"
        self._files.makedirs(path.rpartition("/")[0], exist_ok=True)
        with contextlib.suppress(FileNotFoundError):
            self._files.mv(f"{self.root}/{name}", path)

    def write(self, name: str, content: bytes) -> None:
        """Write a small file, whole or not at all where the store can."""
        path = f"{self.root}/{name}"
        self._files.makedirs(path.rpartition("/")[0], exist_ok=True)
        self._files.pipe_file(f"{path}.tmp", content)
        self._files.mv(f"{path}.tmp", path)


def target_of(name: str, folder: str, digest: str, taken: bool) -> str:
    """Where a file goes; its digest stands in the name where another of this name went before."""
    path = PurePosixPath(name)
    called = f"{path.stem}-{digest[:12]}{path.suffix}" if taken else path.name
    return str(PurePosixPath(folder) / path.parent / called)


def _state(about: JsonObject) -> str:
    time = next((about[name] for name in _TIMES if about.get(name)), "")
    # a store may list numbers and tell instants
    time = time.timestamp() if isinstance(time, datetime) else time
    tag = next((about[name] for name in _TAGS if about.get(name)), "")
    return f"{about.get('size')} {time} {tag}".rstrip()
