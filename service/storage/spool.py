"""Uploads on their way in: streamed to a file of the data folder while they are hashed, removed when done."""

import hashlib
import shutil
import tempfile
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from starlette.concurrency import run_in_threadpool

from service.errors import TooLarge
from service.storage.disk import check_room

_FLUSH_BYTES = 1 << 20
_LEFT_BEHIND_S = 24 * 3600.0


@dataclass(frozen=True, slots=True)
class SpooledFile:
    """Bytes of an upload in a file, with their SHA-256."""

    path: Path
    digest: str
    size: int


class Spool:
    """A folder for files that live as long as the request or the job that works on them.

    ``reserve`` are bytes that uploads leave on its disk.
    """

    def __init__(self, folder: Path, reserve: int = 0) -> None:
        self._folder = folder
        self._reserve = reserve
        folder.mkdir(parents=True, exist_ok=True)
        self._remove_left_behind()

    @property
    def folder(self) -> Path:
        """Where the files lie."""
        return self._folder

    @asynccontextmanager
    async def received(self, stream: AsyncIterator[bytes], declared: str, limit: int) -> AsyncIterator[SpooledFile]:
        """A body of at most ``limit`` bytes, read with bounded memory; ``declared`` is its Content-Length.

        Raises
        ------
        TooLarge
            before a byte is read where the declared length says so, else as soon as the limit is passed.
        StorageFull
            when the disk has no room for it beside the reserve.
        """
        too_large = TooLarge(f"the upload is larger than {limit} bytes: split the record into segments")
        if declared.isdigit() and int(declared) > limit:
            raise too_large
        check_room(self._folder, int(declared) if declared.isdigit() else 0, self._reserve)
        path = self._new()
        hashed, size = hashlib.sha256(), 0
        try:
            with path.open("wb") as file:
                waiting: list[bytes] = []
                n_waiting = 0
                async for part in stream:
                    size += len(part)
                    if size > limit:
                        raise too_large
                    hashed.update(part)
                    waiting.append(part)
                    n_waiting += len(part)
                    if n_waiting >= _FLUSH_BYTES:
                        # a slow disk must not hold up the other requests of the event loop
                        await run_in_threadpool(file.writelines, waiting)
                        waiting, n_waiting = [], 0
                await run_in_threadpool(file.writelines, waiting)
            yield SpooledFile(path, hashed.hexdigest(), size)
        finally:
            path.unlink(missing_ok=True)

    @contextmanager
    def of(self, content: bytes) -> Iterator[SpooledFile]:
        """Bytes at hand as a spooled file."""
        with self.of_parts(iter((content,))) as file:
            yield file

    @contextmanager
    def of_parts(self, parts: Iterator[bytes]) -> Iterator[SpooledFile]:
        """Bytes that come in parts as a spooled file; whatever the parts raise passes through."""
        path = self._new()
        hashed, size = hashlib.sha256(), 0
        try:
            with path.open("wb") as file:
                for part in parts:
                    hashed.update(part)
                    size += len(part)
                    file.write(part)
            yield SpooledFile(path, hashed.hexdigest(), size)
        finally:
            path.unlink(missing_ok=True)

    def _new(self) -> Path:
        descriptor, name = tempfile.mkstemp(dir=self._folder, prefix="upload-")
        with open(descriptor, "wb"):
            return Path(name)

    def _remove_left_behind(self) -> None:
        """Files of a process that was killed; another one that runs beside us is given a day."""
        for path in (*self._folder.glob("upload-*"), *self._folder.glob("parsed-*")):
            with suppress(FileNotFoundError):
                if time.time() - path.stat().st_mtime > _LEFT_BEHIND_S:
                    shutil.rmtree(path) if path.is_dir() else path.unlink()
