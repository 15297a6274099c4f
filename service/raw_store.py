"""Raw bytes by content hash in any file store that fsspec reaches."""

import hashlib
import os
import uuid

import fsspec

from service.errors import Unavailable


def content_hash(content: bytes) -> str:
    """SHA-256 of the bytes as hexadecimal text: their name in the store."""
    return hashlib.sha256(content).hexdigest()


class RawStore:
    """Write-once store; the same bytes are kept once, and reading checks them against their name."""

    def __init__(self, url: str) -> None:
        self._files, self._root = fsspec.core.url_to_fs(url)
        self._files.makedirs(self._root, exist_ok=True)

    def _path(self, digest: str) -> str:
        return f"{self._root}/{digest[:2]}/{digest}"

    def put(self, content: bytes) -> str:
        """Keep bytes and return their hash; a crash leaves either all of them or none."""
        digest = content_hash(content)
        path = self._path(digest)
        if self._files.exists(path):
            return digest
        self._files.makedirs(path.rpartition("/")[0], exist_ok=True)
        partial = f"{path}.{uuid.uuid4().hex}.partial"
        with self._files.open(partial, "wb") as file:
            file.write(content)
            file.flush()
            if hasattr(file, "fileno"):
                os.fsync(file.fileno())
        self._files.mv(partial, path)
        return digest

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

    def ping(self) -> None:
        """Write and read back a few bytes; raises what the store raises."""
        path = f"{self._root}/.probe-{uuid.uuid4().hex}"
        with self._files.open(path, "wb") as file:
            file.write(b"ok")
        self._files.rm_file(path)
