"""The only file that imports numba.

Compiled code is cached on disk in a folder named after a hash of every source file of ``twin`` and
``detectors``: numba's own cache looks at the edited file only and would silently keep a stale caller when a
*called* file changed. ``CASEDRAIN_COMPILE_CACHE`` moves the cache (a read-only home, an image build).
"""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
import platformdirs

F = TypeVar("F", bound=Callable[..., Any])

_PACKAGES = ("twin", "detectors")


def _source_hash() -> str:
    """Hash of every Python file of the compiled packages, with numba's version."""
    digest = hashlib.sha256(numba.__version__.encode())
    root = Path(__file__).resolve().parent.parent
    for package in _PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            digest.update(str(path.relative_to(root)).encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def cache_folder() -> Path:
    """Folder that holds the compiled code of exactly these sources."""
    base = os.environ.get("CASEDRAIN_COMPILE_CACHE") or platformdirs.user_cache_dir("casedrain")
    return Path(base) / "compiled" / _source_hash()


numba.config.CACHE_DIR = str(cache_folder())


def compiled(function: F) -> F:
    """Compile a function of plain floats and arrays to machine code.

    IEEE rules are kept (no ``fastmath``: it makes ``isnan(nan)`` false) and a division by zero gives
    infinity instead of raising: kernels return a status, the typed shell above them writes the message.
    """
    return numba.njit(cache=True, error_model="numpy", nogil=True)(function)  # type: ignore[no-any-return]


def inlined(function: F) -> F:
    """Compile a function into each of its callers: for kernels whose many parameters cost more to pass than to use."""
    return numba.njit(inline="always", error_model="numpy", nogil=True)(function)  # type: ignore[no-any-return]
