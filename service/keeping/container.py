"""Where a set of files is kept: a folder, or one ZIP file; it appears under its name when it is whole, or not at all."""

import hashlib
import os
import shutil
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, NamedTuple, Protocol

_CHUNK = 1 << 20
_PARTIAL = ".partial"
_ZIP = ".zip"


class Written(NamedTuple):
    """A file of a set: its size [bytes] and SHA-256."""

    n_bytes: int
    sha256: str


class Target(Protocol):
    """Takes files, each once."""

    def add(self, name: str, parts: Iterable[bytes]) -> Written:
        """Write one file; an error while its parts come leaves it broken."""


class Source(Protocol):
    """Gives files."""

    def names(self) -> set[str]:
        """Names of all files."""

    def open(self, name: str) -> IO[bytes]:
        """One file; raises ``KeyError`` where there is none."""


@contextmanager
def written(place: Path) -> Iterator[Target]:
    """Write a set: one file where the name ends in ``.zip``, else a folder; readable by its owner only.

    Raises
    ------
    FileExistsError
        when something is there already: nothing is overwritten.
    """
    if place.exists():
        raise FileExistsError(f"{place} exists already: name another place")
    partial = place.with_name(place.name + _PARTIAL)
    place.parent.mkdir(parents=True, exist_ok=True)
    _remove(partial)
    try:
        if place.suffix.lower() == _ZIP:
            with os.fdopen(os.open(partial, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600), "w+b") as file:
                with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
                    yield _ZipTarget(archive)
                file.flush()
                os.fsync(file.fileno())
        else:
            partial.mkdir(mode=0o700)
            yield _FolderTarget(partial)
        os.replace(partial, place)
        _sync_folder(place.parent)
    except BaseException:
        _remove(partial)
        raise


@contextmanager
def read(place: Path) -> Iterator[Source]:
    """Read a set.

    Raises
    ------
    ValueError
        when there is none at the place.
    """
    if place.is_dir():
        yield _FolderSource(place)
        return
    try:
        archive = zipfile.ZipFile(place)
    except (OSError, zipfile.BadZipFile) as error:
        raise ValueError(f"{place} is neither a folder nor a ZIP file that can be read ({error})") from None
    with archive:
        yield _ZipSource(archive)


def parts_of(file: IO[bytes]) -> Iterator[bytes]:
    """A file in parts."""
    while part := file.read(_CHUNK):
        yield part


class _FolderTarget:
    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def add(self, name: str, parts: Iterable[bytes]) -> Written:
        path = self._folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("xb") as file:
            done = _copied(parts, file)
            file.flush()
            os.fsync(file.fileno())
        return done


class _ZipTarget:
    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive = archive

    def add(self, name: str, parts: Iterable[bytes]) -> Written:
        with self._archive.open(name, "w", force_zip64=True) as file:
            return _copied(parts, file)


class _FolderSource:
    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def names(self) -> set[str]:
        return {p.relative_to(self._folder).as_posix() for p in self._folder.rglob("*") if p.is_file()}

    def open(self, name: str) -> IO[bytes]:
        try:
            return (self._folder / name).open("rb")
        except FileNotFoundError:
            raise KeyError(name) from None


class _ZipSource:
    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive = archive

    def names(self) -> set[str]:
        return set(self._archive.namelist())

    def open(self, name: str) -> IO[bytes]:
        return self._archive.open(name)


def _copied(parts: Iterable[bytes], file: IO[bytes]) -> Written:
    hashed, n_bytes = hashlib.sha256(), 0
    for part in parts:
        hashed.update(part)
        n_bytes += len(part)
        file.write(part)
    return Written(n_bytes, hashed.hexdigest())


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _sync_folder(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
