"""The only file that imports numba.

Compiled code is cached on disk, each file's in a folder named after a hash of that file and of every file of this
project that it imports, directly or not: numba's own cache looks at the edited file only and would silently keep a
stale caller when a *called* file changed. ``CASEDRAIN_COMPILE_CACHE`` moves the cache (a read-only home, an image
build).
"""

import ast
import functools
import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
import platformdirs

F = TypeVar("F", bound=Callable[..., Any])

_ROOT = Path(__file__).resolve().parent.parent
_PACKAGES = ("twin", "detectors")


@functools.cache
def _imports(module: str) -> tuple[str, ...]:
    """Modules of the compiled packages that a module's source imports by name, anywhere in it."""
    path = _source(module)
    if path is None:
        return ()
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            # what is imported may itself be a module
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return tuple(sorted(n for n in names if n.partition(".")[0] in _PACKAGES and _source(n) is not None))


def _source(module: str) -> Path | None:
    """File of a module of this project, None when there is none."""
    path = _ROOT.joinpath(*module.split("."))
    for candidate in (path.with_suffix(".py"), path / "__init__.py"):
        if candidate.is_file():
            return candidate
    return None


@functools.cache
def _source_hash(module: str) -> str:
    """Hash of a module with everything of this project that it imports, and of numba's version."""
    found: set[str] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting.extend(_imports(name))
    digest = hashlib.sha256(numba.__version__.encode())
    for name in sorted(found):
        path = _source(name)
        if path is not None:
            digest.update(name.encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def cache_folder(module: str) -> Path:
    """Folder that holds the compiled code of exactly this module's sources."""
    base = os.environ.get("CASEDRAIN_COMPILE_CACHE") or platformdirs.user_cache_dir("casedrain")
    return Path(base) / "compiled" / _source_hash(module)


def compiled(function: F) -> F:
    """Compile a function of plain floats and arrays to machine code.

    IEEE rules are kept (no ``fastmath``: it makes ``isnan(nan)`` false) and a division by zero gives
    infinity instead of raising: kernels return a status, the typed shell above them writes the message.
    """
    numba.config.CACHE_DIR = str(cache_folder(function.__module__))  # read when the cache is made, that is here
    return numba.njit(cache=True, error_model="numpy", nogil=True)(function)  # type: ignore[no-any-return]


def inlined(function: F) -> F:
    """Compile a function into each of its callers: for kernels whose many parameters cost more to pass than to use."""
    return numba.njit(inline="always", error_model="numpy", nogil=True)(function)  # type: ignore[no-any-return]
