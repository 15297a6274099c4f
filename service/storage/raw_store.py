"""Raw bytes by content hash in any file store that fsspec reaches."""

import hashlib
import os
import shutil
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import fsspec
from fsspec.implementations.local import LocalFileSystem

from service.errors import Unavailable

_CHUNK = 1 << 20
_PARTIAL = ".partial"
_LEFT_BEHIND_S = 24 * 3600.0


def content_hash(content: bytes) -> str:
    """SHA-256 of the bytes as hexadecimal text: their name in the store."""
    return hashlib.sha256(content).hexdigest()


class RawStore:
    """Write-once store; the same bytes are kept once, and reading checks them against their name."""

    def __init__(self, url: str) -> None:
        self._files, self._root = fsspec.core.url_to_fs(url)
        self._is_local = isinstance(self._files, LocalFileSystem)
        self._files.makedirs(self._root, exist_ok=True)
        self._remove_left_behind()

    def _path(self, digest: str) -> str:
        return f"{self._root}/{digest[:2]}/{digest}"

    @property
    def folders(self) -> list[Path]:
        """Folder of a store on a disk of ours; none for one across the network."""
        return [Path(self._root)] if self._is_local else []

    def put(self, content: bytes) -> str:
        """Keep bytes and return their hash; a crash or a full disk leaves either all of them or none."""
        digest = content_hash(content)
        if not self._files.exists(self._path(digest)):
            with self._written(digest) as file:
                file.write(content)
        return digest

    def put_file(self, path: Path, digest: str) -> None:
        """Keep a file's bytes, whose hash is known, with bounded memory; as whole as ``put``."""
        if not self._files.exists(self._path(digest)):
            with path.open("rb") as source, self._written(digest) as file:
                shutil.copyfileobj(source, file, _CHUNK)

    @contextmanager
    def _written(self, digest: str) -> Iterator[Any]:
        """A file beside the place of a hash, moved there when the block has ended well and removed when it has not."""
        path = self._path(digest)
        self._files.makedirs(path.rpartition("/")[0], exist_ok=True)
        partial = f"{path}.{uuid.uuid4().hex}{_PARTIAL}"
        try:
            with self._files.open(partial, "wb") as file:
                yield file
                file.flush()
                if hasattr(file, "fileno"):
                    os.fsync(file.fileno())
            self._files.mv(partial, path)
        except BaseException:
            with suppress(OSError):
                self._files.rm_file(partial)
            raise

    def _remove_left_behind(self) -> None:
        """Parts that a process was killed over; another one that writes beside us is given a day."""
        for path in Path(self._root).glob(f"*/*{_PARTIAL}") if self._is_local else ():
            with suppress(OSError):
                if time.time() - path.stat().st_mtime > _LEFT_BEHIND_S:
                    path.unlink()

    def chunks(self, digest: str) -> Iterator[bytes]:
        """Bytes of a hash in parts, checked at their end.

        Raises
        ------
        Unavailable
            when they are gone, or have turned out not to be what their name says.
        """
        hashed = hashlib.sha256()
        try:
            with self._files.open(self._path(digest), "rb") as file:
                while part := file.read(_CHUNK):
                    hashed.update(part)
                    yield part
        except FileNotFoundError:
            raise Unavailable(f"raw bytes {digest} are not in the raw store: check CASEDRAIN_RAW_STORE_URL") from None
        if hashed.hexdigest() != digest:
            raise Unavailable(f"the raw bytes {digest} are damaged in the raw store: restore them from a backup")

    def get(self, digest: str) -> bytes:
        """Bytes of a hash.

        Raises
        ------
        Unavailable
            when they are gone or no longer what their name says.
        """
        try:
            content: bytes = self._files.cat_file(self._path(digest))
        except FileNotFoundError:
            raise Unavailable(f"raw bytes {digest} are not in the raw store: check CASEDRAIN_RAW_STORE_URL") from None
        if content_hash(content) != digest:
            raise Unavailable(f"the raw bytes {digest} are damaged in the raw store: restore them from a backup")
        return content

    def remove(self, digest: str) -> bool:
        """Remove the bytes of a hash: True when they were there."""
        try:
            self._files.rm_file(self._path(digest))
        except FileNotFoundError:
            return False
        return True

    def has(self, digest: str) -> bool:
        """True when bytes of that name are there; whether they are whole only reading tells."""
        return bool(self._files.exists(self._path(digest)))

    def files(self) -> Iterator[tuple[str, float | None]]:
        """Everything in the store: its path below the root, and when it was written [s since 1970] where that is known."""
        found = self._files.find(self._root, detail=True)
        for path, about in found.items():
            yield path[len(self._root) :].strip("/"), about.get("mtime")

    def ping(self) -> None:
        """Write and read back a few bytes; raises what the store raises."""
        path = f"{self._root}/.probe-{uuid.uuid4().hex}"
        try:
            with self._files.open(path, "wb") as file:
                file.write(b"ok")
        finally:
            with suppress(FileNotFoundError):
                self._files.rm_file(path)
