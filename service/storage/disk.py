"""Room on the disks that the service writes to: uploads leave a reserve, so that the database and the log go on."""

import shutil
from collections.abc import Iterable
from pathlib import Path

from service.errors import StorageFull

_MOST_OF_A_DISK = 0.1
"""The reserve is never more than this part of a disk (our choice: a small disk may be filled too)."""
_WARNED_AT = 2
"""Readiness ends at this many reserves, before uploads are refused."""


def reserve_of(folder: Path, wanted: int) -> int:
    """Bytes that uploads leave on the disk of a folder, of which ``wanted`` are wanted."""
    return min(wanted, int(_MOST_OF_A_DISK * shutil.disk_usage(folder).total))


def check_room(folder: Path, needed: int, wanted: int) -> None:
    """Refuse what does not fit.

    Raises
    ------
    StorageFull
        when ``needed`` bytes would touch the reserve.
    """
    free = shutil.disk_usage(folder).free
    if free - needed < reserve_of(folder, wanted):
        raise StorageFull(
            f"the disk has {free // 2**20} MiB left, which are kept for the database; nothing was changed: "
            "what is stored can be read, uploads wait for space"
        )


def shortage(folders: Iterable[Path], wanted: int) -> str | None:
    """Sentence about the first disk that is nearly full; None when there is room on all."""
    for folder in folders:
        free, limit = shutil.disk_usage(folder).free, _WARNED_AT * reserve_of(folder, wanted)
        if free < limit:
            return f"{free // 2**20} MiB are left, less than {limit // 2**20} MiB: uploads will be refused soon"
    return None
