"""The only file that imports numba.

Compiled code is cached on disk under a hash of the syntax trees that it was made from: numba's own cache looks at the
edited file only and would silently keep a stale caller when a *called* file changed. Neither the place nor the age of a
source file plays a part, so that a cache made in one folder serves another.

``CASEDRAIN_COMPILE_CACHE`` moves the cache (an image build, a home that cannot be written). Kernels in a cache that can
be read but not written are used all the same; what cannot be kept is said in one sentence and compiled again by every
process.
"""

import functools
import logging
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
import platformdirs
from numba.core import caching, cgutils, sigutils
from numba.extending import intrinsic, overload

from twin.sources import sources_hash

F = TypeVar("F", bound=Callable[..., Any])

numba_version: str = numba.__version__

log = logging.getLogger("casedrain")
_said: list[str] = []
"""Why kernels are not kept: said once, for every kernel lies in the same place."""


def cache_folder(module: str) -> Path | None:
    """Folder that holds the compiled code of exactly this module's sources; None where no home is known for one."""
    base = _base()
    return None if base is None else base / f"{module}-{_key(module)}"


def compiled(function: F) -> F:
    """Compile a function of plain floats and arrays to machine code.

    IEEE rules are kept (no ``fastmath``: it makes ``isnan(nan)`` false) and a division by zero gives
    infinity instead of raising: kernels return a status, the typed shell above them writes the message.
    """
    dispatcher = numba.njit(error_model="numpy", nogil=True)(function)
    if not numba.config.DISABLE_JIT:
        kept = cache_folder(function.__module__) is not None
        dispatcher._cache = _KernelCache(function) if kept else _NoCache()  # what numba's own `cache=True` sets
    return dispatcher  # type: ignore[no-any-return]


def inlined(function: F) -> F:
    """Compile a function into each of its callers: for kernels whose many parameters cost more to pass than to use."""
    return numba.njit(inline="always", error_model="numpy", nogil=True)(function)  # type: ignore[no-any-return]


A = TypeVar("A")


def lent(array: A) -> A:
    """The same array inside a kernel, with nobody counting who holds it: the caller keeps it alive.

    Whenever a counted array is taken out of a tuple, or a row out of a table, the processor waits for a locked counter, some
    ten nanoseconds; a row of a lent array is lent too. For loops that do so by the million. Never to be returned, and an array that
    the kernel itself has made is used once more behind the last use of what was lent: else it is freed before.
    """
    return array


@overload(lent, inline="always", strict=False)  # type: ignore[untyped-decorator]
def _lent(array: Any) -> Any:
    return lambda array: _uncounted(array)  # noqa: PLW0108 - numba takes plain functions only


@intrinsic  # type: ignore[untyped-decorator]
def _uncounted(_typing: Any, array: Any) -> Any:
    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        view = context.make_array(signature.args[0])(context, builder, arguments[0])
        view.meminfo = cgutils.get_null_value(view.meminfo.type)
        view.parent = cgutils.get_null_value(view.parent.type)
        return view._getvalue()

    return array(array), code


class _SourcesLocator(caching._CacheLocator):  # type: ignore[misc]
    """Where a kernel's compiled code lies: a function of its sources alone."""

    def __init__(self, module: str, file: str) -> None:
        folder = cache_folder(module)
        assert folder is not None  # `compiled` asks for a cache only where there is one
        self._folder, self._stamp = folder, _key(module)
        self._py_file = file

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return self._stamp

    def get_disambiguator(self) -> str:
        return "kernel"

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> "_SourcesLocator":
        return cls(py_func.__module__, py_file)


class _KernelCacheFiles(caching.CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes = (_SourcesLocator,)


class _KernelCache(caching.Cache):  # type: ignore[misc]
    """numba's cache of one function, which reads where it cannot write and outlives what another left half written."""

    _impl_class = _KernelCacheFiles

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            found = super().load_overload(sig, target_context)
        except Exception:  # unreadable or no index at all: as if it were not there
            return None
        # two processes that compile at once may name the same file for two signatures
        return found if found is not None and found.signature.args == sigutils.normalize_signature(sig)[0] else None

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            self._save(sig, data)
        except OSError as error:
            _say_unkept(f"{_base()} cannot be written ({error.strerror or error})")

    def _save(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)
        except OSError:
            raise
        except Exception:  # the index that stands there is none: begin it anew
            self.flush()
            super().save_overload(sig, data)


class _NoCache(caching.NullCache):  # type: ignore[misc]
    """Where no folder is known for compiled code."""

    def save_overload(self, sig: Any, cres: Any) -> None:
        _say_unkept("there is no home folder")


def _base() -> Path | None:
    named = os.environ.get("CASEDRAIN_COMPILE_CACHE")
    try:
        folder = Path(named or platformdirs.user_cache_dir("casedrain"))
    except RuntimeError:  # no home folder can be told
        return None
    return folder / "compiled" if named or folder.is_absolute() else None


@functools.cache
def _key(module: str) -> str:
    return f"{sources_hash(module)}-numba{numba_version}"


def _say_unkept(why: str) -> None:
    if _said:
        return
    _said.append(why)
    log.warning(
        "compiled kernels are not kept, every start compiles them again (about 100 s): %s; "
        "set CASEDRAIN_COMPILE_CACHE to a folder that can be written",
        why,
    )
