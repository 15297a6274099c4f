"""Identity of code: a hash over the syntax trees of modules and of every module of this project that they import.

Docstrings, comments and layout leave no trace in a syntax tree's hash: what cannot change a number changes no identity.
Modules are named, never files, so that one that has moved away is an error and not silently left out. A data file that
stands in a package (a fitted surface) belongs to every module of that package.
"""

import ast
import functools
import hashlib
import threading
from pathlib import Path
from typing import NamedTuple

_ROOT = Path(__file__).resolve().parent.parent
_PACKAGES = ("twin", "detectors", "service")
_HEX = 16
_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
_SILENT = frozenset({"ctx", "kind", "type_comment", "type_ignores"})
"""Fields of a syntax tree that say nothing, or only what their place says."""
_PARSING = threading.Lock()
"""Python 3.11 counts the depth of a syntax tree for all threads together: two parsers at once may end in a SystemError."""


class _Source(NamedTuple):
    """What a module's source says: modules of this project that it imports, and the hash of its syntax tree."""

    imports: tuple[str, ...]
    hash: str


@functools.cache
def sources_hash(*modules: str) -> str:
    """Hash over the sources of modules and of all modules of this project that they import, directly or not.

    Parameters
    ----------
    modules
        Dotted names, e.g. ``twin.operating_point``; a package stands for what its ``__init__`` imports.

    Returns
    -------
    str
        16 hexadecimal digits, the same on every machine and for every supported Python.

    Raises
    ------
    ModuleNotFoundError
        for a name that is no module of this project.

    Examples
    --------
    >>> sources_hash("twin.units") == sources_hash("twin.units")
    True
    """
    digest = hashlib.sha256()
    names = imported_modules(*modules)
    for name in names:
        digest.update(f"{name} {_read(name).hash};".encode())
    for folder in sorted({_path(name).parent for name in names}):
        for file in _data_files(folder):
            digest.update(f"{file.name} ".encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()[:_HEX]


@functools.cache
def package_hash(*packages: str) -> str:
    """Hash over every module below packages, whether anything imports it or not.

    Raises
    ------
    ModuleNotFoundError
        for a name that is no package of this project.
    """
    return sources_hash(*(module for package in packages for module in modules_of(package)))


def modules_of(package: str) -> tuple[str, ...]:
    """Dotted names of a package and of all modules below it, in order.

    Raises
    ------
    ModuleNotFoundError
        for a name that is no package of this project.
    """
    folder = _path(package).parent
    files = sorted(file for file in folder.rglob("*.py"))
    found = (file.relative_to(_ROOT).with_suffix("").as_posix().replace("/", ".") for file in files)
    return tuple(sorted(name.removesuffix(".__init__") for name in found))


@functools.cache
def imported_modules(*modules: str) -> tuple[str, ...]:
    """Names of modules and of every module of this project that they import, anywhere in them, in order.

    Raises
    ------
    ModuleNotFoundError
        for a name that is no module of this project.
    """
    found: set[str] = set()
    waiting = list(modules)
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting.extend(_read(name).imports)
    return tuple(sorted(found))


def _path(module: str) -> Path:
    """File of a module of this project."""
    path = _file(module)
    if path is None:
        raise ModuleNotFoundError(f"{module} is no module of this project", name=module)
    return path


def _file(module: str) -> Path | None:
    base = _ROOT.joinpath(*module.split("."))
    return next((file for file in (base.with_suffix(".py"), base / "__init__.py") if file.is_file()), None)


@functools.cache
def _read(module: str) -> _Source:
    """A module parsed once; its tree, which is a hundred times as large, is not kept."""
    source = _path(module).read_bytes()
    with _PARSING:
        tree = ast.parse(source)
    pieces: list[str] = []
    _write(tree, pieces)
    return _Source(_imports(tree), hashlib.sha256("".join(pieces).encode()).hexdigest())


def _imports(tree: ast.Module) -> tuple[str, ...]:
    """Modules of this project that a source imports by name; a package that is passed through counts."""
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            # what is imported may itself be a module
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return tuple(sorted(n for n in names if n.partition(".")[0] in _PACKAGES and _file(n) is not None))


def _write(node: ast.AST, pieces: list[str]) -> None:
    """A syntax tree as text that no Python version writes otherwise: empty fields are left out, docstrings too."""
    kind = type(node)
    pieces.append(f"({kind.__name__}")
    for field in _fields(kind):  # type: ignore[arg-type]  # classes do have a hash
        value = getattr(node, field, None)
        if value is None or value == []:
            continue
        pieces.append(f" {field}=")
        if isinstance(value, ast.AST):
            _write(value, pieces)
        elif isinstance(value, list):
            for item in _without_docstring(value) if field == "body" and kind in _DOCUMENTED else value:
                if isinstance(item, ast.AST):
                    _write(item, pieces)
                else:
                    pieces.append(f"{item!r};")
        else:
            pieces.append(f"{type(value).__name__}:{value!r}")
    pieces.append(")")


@functools.cache
def _fields(kind: type[ast.AST]) -> tuple[str, ...]:
    return tuple(sorted(set(kind._fields) - _SILENT))


def _without_docstring(body: list[ast.stmt]) -> list[ast.stmt]:
    """A body without lone texts: the docstring, and those under an attribute."""
    return [s for s in body if not (isinstance(s, ast.Expr) and isinstance(getattr(s.value, "value", None), str))]


def _data_files(folder: Path) -> list[Path]:
    """Files of a package's folder that are no Python."""
    return [f for f in sorted(folder.iterdir()) if f.is_file() and f.suffix not in (".py", ".pyc", ".typed")]
